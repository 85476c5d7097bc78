"""When a pad is touched, let go, and slipped over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.monitor.hysteresis import HysteresisSession


@dataclass(frozen=True)
class SlipMonitor:
    """Slip = a displacement larger than noise can make it, with hysteresis."""

    start: float = 5.0
    """A pad starts slipping when a scan's displacement exceeds so many of its standard deviations."""
    stop: float = 2.5
    """... and stops when it falls below so many."""

    def __post_init__(self) -> None:
        if not 0 < self.stop <= self.start:
            raise ParameterInvalid("monitor stop", self.stop, f"it lies above 0, up to start = {self.start}")

    def begin(self, pads: tuple[str, ...]) -> HysteresisSession:
        """Begin a session over pads of these names."""
        from taxelflow.monitor.hysteresis import HysteresisSession

        return HysteresisSession(self, pads)
