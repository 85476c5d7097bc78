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
    """Register each scan to the one before by Gauss-Newton: displacement, rotation, gain; a pose is their sum.

    It has no map, so its error grows with time. Theta is empty where the contact is too round.
    """

    def start(self, layout: Layout, mode: Mode) -> RegistrationSession:
        """Begin a session; kernels are compiled here."""
        from taxelflow.estimation.scan_matching.session import RegistrationSession

        return RegistrationSession(layout)
