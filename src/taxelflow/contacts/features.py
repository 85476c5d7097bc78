"""Parameters of the contact stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.runtime.checks import not_negative

if TYPE_CHECKING:
    from taxelflow.contacts.session import ContactSession
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True)
class ContactFeatures:
    """Force, area, peak, centroid and principal axes of each pad's contact."""

    threshold: float = 4.0
    """Threshold of a loaded taxel, standard deviations of its noise."""

    def __post_init__(self) -> None:
        not_negative("features.threshold", self.threshold)

    def start(self, sensor: Sensor, contact_on: float, contact_off: float, *, stream: bool = False) -> ContactSession:
        """Begin a session of the contact stage; the thresholds are those of `Conditioner`.

        stream: compile all that any scan may need before the first scan.
        """
        from taxelflow.contacts.session import ContactSession

        return ContactSession(sensor, self.threshold, contact_on, contact_off, stream=stream)
