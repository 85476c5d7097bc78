"""When a pad is touched, let go, and slipped over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.slip.offline import HindsightSession
    from taxelflow.slip.session import SlipSession


@dataclass(frozen=True)
class SlipMonitor:
    """Slip = a motion that noise, load and creep explain more seldom than so many times an hour."""

    alarms_per_hour: float = 1.0
    """False alarms that noise may make of a still object, per hour of contact and per pad. Fewer cost a later onset."""
    creep_m_s: float = 1e-4
    """Usual speed of what is not to count as a slip, m/s; a slip is several times faster."""
    load_m: float = 1e-3
    """How far a still object seems to move when the load grows by a factor of e, m; what it really does is learned."""
    settle_s: float = 0.1
    """A contact younger than this is not judged, s."""

    def __post_init__(self) -> None:
        if not 0 < self.alarms_per_hour < float("inf"):
            raise ParameterInvalid("monitor.alarms_per_hour", self.alarms_per_hour, "be a finite number above 0")
        for name in ("creep_m_s", "load_m", "settle_s"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise ParameterInvalid(f"monitor.{name}", getattr(self, name), "be 0 or more")

    @property
    def numbers(self) -> tuple[float, ...]:
        """Mean time between false alarms in s, then the other fields, as `watch.follow` takes them."""
        return (
            3600.0 / self.alarms_per_hour,
            self.load_m,
            self.creep_m_s,
            self.settle_s,
        )

    def begin(self, pads: tuple[str, ...]) -> SlipSession:
        """Begin a session over pads of these names: what it says of a scan, it says at once."""
        from taxelflow.slip.session import SlipSession

        return SlipSession(self, pads)

    def look_back(self, pads: tuple[str, ...]) -> HindsightSession:
        """Begin a session for a recording: slips are dated from the scans after them, too."""
        from taxelflow.slip.offline import HindsightSession

        return HindsightSession(self, pads)
