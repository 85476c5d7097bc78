"""Options of the slip detector."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from taxelflow.runtime.checks import not_negative, positive

if TYPE_CHECKING:
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.offline import OfflineSlipSession
    from taxelflow.slip.session import SlipSession
    from taxelflow.slip.stage import SlipStage


@dataclass(frozen=True)
class SlipMonitor:
    """Slip detector. The threshold is set by the accepted false-alarm rate (alarms per hour)."""

    alarms_per_hour: float = 1.0
    """Accepted false alarms of an object at rest, per hour of contact and pad. A lower rate delays detection."""
    creep_m_s: float = 1e-4
    """Standard deviation of the creep of an object at rest, m/s. A slip ends below three times this speed."""
    load_m: float = 1e-3
    """Prior standard deviation of the apparent displacement of an object at rest when the load grows by a factor of e,
    m. The displacement itself is estimated."""
    settle_s: float = 0.1
    """Age of a contact from which on slips are detected, s."""

    def __post_init__(self) -> None:
        positive("monitor.alarms_per_hour", self.alarms_per_hour)
        for name in ("creep_m_s", "load_m", "settle_s"):
            not_negative(f"monitor.{name}", getattr(self, name))

    def watch(self, layout: Layout, *, stream: bool, judged: bool = False) -> SlipStage:
        """Start the slip stage: poses, patterns and facing pads together, of a stream or of a recording.

        judged: whether the method itself judges poses of contacts that a border cuts.
        """
        from taxelflow.slip.stage import SlipStage

        return SlipStage(layout, **asdict(self), stream=stream, judged=judged)

    def begin(self, pads: tuple[str, ...]) -> SlipSession:
        """Start a session for a stream by poses alone, over pads of these names: each scan is decided at once."""
        from taxelflow.slip.measurement import parameter_records
        from taxelflow.slip.session import SlipSession

        return SlipSession(pads, parameter_records(**asdict(self)))

    def look_back(self, pads: tuple[str, ...]) -> OfflineSlipSession:
        """Start a session for a recording by poses alone: onsets and ends are refined by the scans after them."""
        from taxelflow.slip.measurement import parameter_records
        from taxelflow.slip.offline import OfflineSlipSession

        return OfflineSlipSession(pads, parameter_records(**asdict(self)))
