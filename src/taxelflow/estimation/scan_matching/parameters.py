"""Registration of two scans: the motion from the last scan to this one, and nothing remembered beyond."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.scan_matching.session import RegistrationSession
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class Registration:
    """Motion, turn and gain that lay this scan on the one before, by Gauss-Newton; a pose is the sum of the steps.

    It learns nothing, so it needs no time to learn, forgets nothing wrong, and drifts. No theta where the contact is
    too round to show a turn.
    """

    def start(self, layout: Layout, mode: Mode) -> RegistrationSession:
        """Begin a session; kernels are compiled here."""
        from taxelflow.estimation.scan_matching.session import RegistrationSession

        return RegistrationSession(layout)
