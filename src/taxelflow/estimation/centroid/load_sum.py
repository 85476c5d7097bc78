"""The sum of a pad's taxels, high-passed: the measure the paper contrasts itself with (Romano et al., its [19])."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class Sum:
    """Knows load and contact, no position and no direction. Slip = a fast change of the load.

    A grip that tightens, a touch and a release look the same to it, and a slip at constant load does not show.
    """

    cutoff_hz: float = 1.0
    """Changes of the load slower than this are held to be the grip's, Hz."""

    def __post_init__(self) -> None:
        if not 0 < self.cutoff_hz < float("inf"):
            raise ParameterInvalid("cutoff_hz", self.cutoff_hz, "be a finite number above 0, in Hz")

    def start(self, layout: Layout, mode: Mode) -> CentroidSession:
        """Begin a session."""
        from taxelflow.estimation.centroid.load_sum_kernel import Memory, load_change
        from taxelflow.estimation.centroid.session import CentroidSession

        return CentroidSession(layout, load_change, Memory, self.cutoff_hz)
