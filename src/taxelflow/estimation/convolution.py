"""Method II of the paper: optical flow by convolution, equations (1) to (6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.translation import TranslationSession
    from taxelflow.layout import Layout


@dataclass(frozen=True)
class Convolution:
    """The slip vector S of the paper, halved to one scan's motion; two scans long and half a scan late."""

    gain: float = 1.0
    """Factor on the index, the paper's calibration without its unit; 1 takes one column for one pitch."""

    def __post_init__(self) -> None:
        if not 0 < self.gain < float("inf"):
            raise ParameterInvalid("gain", self.gain, "it is a number above 0, and 1 when uncalibrated")

    def start(self, layout: Layout, mode: Mode) -> TranslationSession:
        """Begin a session. The fast form is used: centroids add under convolution."""
        from taxelflow.estimation.flow import MEMORY, convolution_flow, long_rows, pad_moments
        from taxelflow.estimation.translation import TranslationSession

        return TranslationSession(layout, convolution_flow, MEMORY, self.gain, long_rows(layout), prepare=pad_moments)
