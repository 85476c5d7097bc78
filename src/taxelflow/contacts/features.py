"""What a contact is like, pad by pad: force, area, peak, place, shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.contacts.moments import ShapeSession
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True)
class ContactFeatures:
    """Force, area, peak, centroid and principal axes of each pad's contact."""

    threshold: float = 4.0
    """A taxel belongs to the contact when it reads above so many standard deviations of its noise."""

    def __post_init__(self) -> None:
        if not 0 <= self.threshold < float("inf"):
            raise ParameterInvalid("features.threshold", self.threshold, "be 0 or more")

    def begin(self, sensor: Sensor) -> ShapeSession:
        """Begin a session for this sensor."""
        from taxelflow.contacts.moments import ShapeSession

        return ShapeSession(self, sensor)
