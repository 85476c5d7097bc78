"""The conditioner's parameters: raw scans in, tared pressure with noise and contact out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.condition.session import Session
    from taxelflow.messages import Bools, RawScans
    from taxelflow.sensor import Sensor

Tare = Literal["auto", "none", "start"]


@dataclass(frozen=True)
class Conditioner:
    """How scans are made comparable before any motion is estimated."""

    tare: Tare = "auto"
    """What is subtracted per taxel. auto: the mean of idle scans, where a pad has any (never a steady contact);
    none: nothing; start: the first 12 scans, which you declare idle."""
    contact_on: float = 6.0
    """A pad is in contact when its largest taxel and its sum both exceed so many standard deviations of noise."""
    contact_off: float = 4.0
    """... and stays in contact until one of the two falls below so many."""

    def __post_init__(self) -> None:
        if self.tare not in get_args(Tare):
            raise ParameterInvalid("tare", self.tare, f"it is one of {', '.join(get_args(Tare))}")
        if not 0 < self.contact_off <= self.contact_on:
            raise ParameterInvalid(
                "contact_off", self.contact_off, f"it lies above 0, up to contact_on = {self.contact_on}"
            )

    def start(self, sensor: Sensor, masked: Bools, lookahead: Iterable[RawScans] | None) -> Session:
        """Begin a session. masked: (taxels,) known to be off.

        With `lookahead`, a first pass over the same recording, tare and noise are learned from all of it (batch).
        Without, they are learned from what has gone by (stream): the first 12 scans are held back until known.
        """
        from taxelflow.condition.session import Session

        return Session(self, sensor, masked, lookahead)
