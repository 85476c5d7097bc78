"""Method II of the paper: optical flow by convolution, equations (1) to (6)."""

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
class Convolution:
    """Estimate displacement by convolution of two scans (the paper's slip vector S, halved); half a scan late."""

    gain: float = 1.0
    """Factor on the index, the paper's calibration without its unit; 1: one column is one pitch."""

    pitches_per_index: ClassVar[float] = 0.5
    """Pitches that one unit of the paper's index stands for."""

    def __post_init__(self) -> None:
        numeric(self)
        if not 0 < self.gain < float("inf"):
            raise ParameterInvalid("gain", self.gain, "be a finite number above 0; 1 if uncalibrated")

    def start(self, layout: Layout, mode: Mode, calibrated: Floats | None = None) -> CentroidSession:
        """Begin a session. The fast form is used: centroids add under convolution.

        calibrated: (pads, 2), factors along x, y besides `gain`.
        """
        from taxelflow.estimation.centroid.convolution_kernel import Memory, convolution_flow, noise_sums
        from taxelflow.estimation.centroid.session import CentroidSession, pad_gains

        gains = pad_gains(layout, self.gain, calibrated)
        return CentroidSession(layout, convolution_flow, Memory, gains=gains, prepare=noise_sums)
