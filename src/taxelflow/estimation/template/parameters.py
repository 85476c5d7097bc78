"""The learned template: poses from a pressure pattern that is learned while the object moves over the skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import numeric

if TYPE_CHECKING:
    from taxelflow.estimation.base import EstimatorSession, Mode
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class Template:
    """Estimate the object's pressure pattern and the pose of every scan on it, by maximum likelihood.

    Batch: all scans of a contact together. Stream: scan by scan, causal; the pattern is refined in the background.
    """

    window_scans: int = 1000
    """Largest number of scans solved at once in a batch; longer contacts are solved in overlapping windows."""

    latency_s: float = 0.1
    """Time from a scan to the use of what is learned from it, in a stream, s; where learning takes longer, the stream
    waits."""

    def __post_init__(self) -> None:
        numeric(self)
        if not 20 <= self.window_scans <= 100_000 or self.window_scans % 1:
            raise ParameterInvalid("window_scans", self.window_scans, "be between 20 and 100000 scans")
        if not 0 <= self.latency_s < float("inf"):
            raise ParameterInvalid("latency_s", self.latency_s, "be a finite time, 0 s or more")

    def start(self, layout: Layout, mode: Mode) -> EstimatorSession:
        """Begin a session; kernels are compiled here."""
        if mode == "batch":
            from taxelflow.estimation.template.batch_session import BatchSession

            return BatchSession(layout, self.window_scans)
        from taxelflow.estimation.template.online.session import StreamSession

        return StreamSession(layout, self.latency_s)
