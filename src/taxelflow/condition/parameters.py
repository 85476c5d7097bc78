"""The conditioner's parameters: raw scans in, tared pressure with noise and contact out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.condition.session import Session
    from taxelflow.messages import Bools, RawScans
    from taxelflow.sensors.sensor import Sensor

Tare = Literal["auto", "none", "start"]
Repeats = Literal["drop", "keep"]
Drifting = Literal["keep", "follow"]


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
    repeats: Repeats = "drop"
    """Scans that a logger wrote again under a new stamp, bit for bit. drop: leave them out, where the noise of loaded
    taxels shows that they cannot be new (an idle sensor that clips to 0 repeats itself rightly); keep: all are new."""
    mask: str = "none"
    """Taxels to leave out besides those that the recording declares off or that never read. none: no others; auto:
    those found stuck, noisy, or out of family (`taxelflow info` lists them with the evidence); or a list, such as
    17,203, of numbers as in the scan. In a stream auto judges anew as evidence comes in."""
    drift: Drifting = "keep"
    """Offsets that creep. keep: what was tared once stays; follow: idle pads follow their drift, pads in contact
    never."""
    lowpass_hz: float = 0.0
    """Cut-off of a causal low-pass over time (Butterworth, second order); 0: off. Its lag is added to lag_s."""
    median_scans: int = 1
    """Median of the last so many scans, an odd number; 1: off. Its lag is added to lag_s."""

    def __post_init__(self) -> None:
        for name, known in (("tare", Tare), ("repeats", Repeats), ("drift", Drifting)):
            if getattr(self, name) not in get_args(known):
                raise ParameterInvalid(name, getattr(self, name), f"be one of {', '.join(get_args(known))}")
        if self.mask not in ("auto", "none") and not all(part.strip().isdecimal() for part in self.mask.split(",")):
            raise ParameterInvalid("mask", self.mask, "be auto, none, or numbers of taxels such as 17,203")
        if not 0 <= self.lowpass_hz < float("inf"):
            raise ParameterInvalid("lowpass_hz", self.lowpass_hz, "be a frequency in Hz, or 0 for no filter")
        if not (1 <= self.median_scans < 100 and self.median_scans % 2):
            raise ParameterInvalid("median_scans", self.median_scans, "be an odd number of scans from 1 to 99")
        if not 0 < self.contact_off <= self.contact_on:
            raise ParameterInvalid(
                "contact_off", self.contact_off, f"be above 0 and at most contact_on, {self.contact_on}"
            )

    @property
    def off(self) -> list[int]:
        """Taxels that `mask` lists."""
        return [] if self.mask in ("auto", "none") else [int(part) for part in self.mask.split(",")]

    def start(self, sensor: Sensor, masked: Bools, lookahead: Iterable[RawScans] | None) -> Session:
        """Begin a session. masked: (taxels,) known to be off.

        With `lookahead`, a first pass over the same recording, tare and noise are learned from all of it (batch).
        Without, they are learned from what has gone by (stream): the first 12 scans are held back until known.
        Raises ParameterInvalid where mask or lowpass_hz do not fit the sensor; a stream's rate is known after 12 scans.
        """
        from taxelflow.condition.session import Session

        return Session(self, sensor, masked, lookahead)
