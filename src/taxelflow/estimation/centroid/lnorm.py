"""Method I of the paper: the place of the largest pressure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class LNorm:
    """Position = centre of the taxel with the largest pressure (the L-infinity norm); moves in whole taxels."""

    gain: float = 1.0
    """Factor on the taxel's place, to calibrate it like Method II; 1 takes one column for one pitch."""

    pitches_per_index: ClassVar[float] = 1.0
    """Pitches that one unit of the paper's index stands for."""

    def __post_init__(self) -> None:
        if not 0 < self.gain < float("inf"):
            raise ParameterInvalid("gain", self.gain, "be a finite number above 0, and 1 where it is not calibrated")

    def start(self, layout: Layout, mode: Mode, calibrated: Floats | None = None) -> CentroidSession:
        """Begin a session. calibrated: (pads, 2), factors along x, y besides `gain`."""
        from taxelflow.estimation.centroid.lnorm_kernel import Memory, peak_flow
        from taxelflow.estimation.centroid.session import CentroidSession, pad_gains

        return CentroidSession(layout, peak_flow, Memory, gains=pad_gains(layout, self.gain, calibrated))
