"""Method I of the paper: the place of the largest pressure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import numeric

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class LNorm:
    """Estimate position as the centre of the taxel with the largest pressure (L-infinity norm)."""

    gain: float = 1.0
    """Factor on the position, to calibrate it like Method II; 1: one column is one pitch."""

    pitches_per_index: ClassVar[float] = 1.0
    """Pitches that one unit of the paper's index stands for."""

    def __post_init__(self) -> None:
        numeric(self)
        if not 0 < self.gain < float("inf"):
            raise ParameterInvalid("gain", self.gain, "be a finite number above 0; 1 if uncalibrated")

    def start(self, layout: Layout, mode: Mode, calibrated: Floats | None = None) -> CentroidSession:
        """Begin a session. calibrated: (pads, 2), factors along x, y besides `gain`."""
        from taxelflow.estimation.centroid.lnorm_kernel import Memory, peak_flow
        from taxelflow.estimation.centroid.session import CentroidSession, pad_gains
        from taxelflow.numerics.centroid import CELL_ERROR

        share = CELL_ERROR if layout.unseen_error else 0.0
        return CentroidSession(layout, peak_flow, Memory, share, gains=pad_gains(layout, self.gain, calibrated))
