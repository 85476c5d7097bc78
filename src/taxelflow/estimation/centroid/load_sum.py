"""The sum of a pad's taxels, high-passed: the measure the paper contrasts itself with (Romano et al., its [19])."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import numeric

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class Sum:
    """Detect slip by fast changes of the load; gives neither position nor direction.

    Changes of the grip have the same effect as a slip; a slip at constant load has none.
    """

    cutoff_hz: float = 1.0
    """Cut-off frequency of the high-pass filter of the load, Hz; slower changes are attributed to the grip."""

    def __post_init__(self) -> None:
        numeric(self)
        if not 0 < self.cutoff_hz < float("inf"):
            raise ParameterInvalid("cutoff_hz", self.cutoff_hz, "be a finite number above 0, in Hz")

    def start(self, layout: Layout, mode: Mode) -> CentroidSession:
        """Begin a session."""
        from taxelflow.estimation.centroid.load_sum_kernel import Memory, load_change
        from taxelflow.estimation.centroid.session import CentroidSession

        return CentroidSession(layout, load_change, Memory, self.cutoff_hz)
