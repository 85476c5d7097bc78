"""The conditioner's parameters: raw scans in, tared pressure with noise and contact out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import numeric, positive

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.condition.session import ConditionSession
    from taxelflow.messages import Bools, RawScans
    from taxelflow.sensors.sensor import Sensor

Tare = Literal["auto", "none", "start"]
Repeats = Literal["drop", "keep"]
Drifting = Literal["keep", "follow"]


@dataclass(frozen=True)
class Conditioner:
    """How scans are made comparable before any motion is estimated."""

    tare: Tare = "auto"
    """Offset subtracted from each taxel. auto: mean of idle scans, where a pad has any (never of a steady contact);
    none: no offset; start: mean of the first 12 scans, which must be idle."""
    contact_on: float = 6.0
    """Threshold of contact, standard deviations of noise; a pad's largest taxel and its sum must both exceed it."""
    contact_off: float = 4.0
    """Threshold of release, standard deviations of noise; contact ends when one of the two falls below it."""
    repeats: Repeats = "drop"
    """Handling of scans that equal the one before, bit for bit. drop: leave out those that a logger wrote twice, by the
    noise of loaded taxels (an idle sensor that clips to 0 repeats itself and is kept); keep: use all scans."""
    mask: str = "none"
    """Taxels to leave out, in addition to those declared off in the recording, without any reading, or stuck at a load.
    none: no others; auto: faulty taxels (listed by `taxelflow info`); or a list of taxel numbers, such as 17,203. In a
    stream faults are judged after 2, 4, 8, ... windows of 12 scans."""
    drift: Drifting = "keep"
    """Drift of the offset. keep: the offset stays constant; follow: it is updated while a pad is idle, never in
    contact."""
    lowpass_hz: float = 0.0
    """Cut-off frequency of a causal low-pass filter, Hz (Butterworth, second order); 0: off. Its lag is added to
    lag_s."""
    median_scans: int = 1
    """Length of a causal median filter, scans, an odd number; 1: off. Its lag is added to lag_s."""

    def __post_init__(self) -> None:
        numeric(self)
        for name, known in (("tare", Tare), ("repeats", Repeats), ("drift", Drifting)):
            if getattr(self, name) not in get_args(known):
                raise ParameterInvalid(name, getattr(self, name), f"be one of {', '.join(get_args(known))}")
        listed = self.mask.split(",") if isinstance(self.mask, str) else [""]
        if self.mask not in ("auto", "none") and not all(part.strip().isdecimal() for part in listed):
            raise ParameterInvalid("mask", self.mask, "be auto, none, or numbers of taxels such as 17,203")
        if not 0 <= self.lowpass_hz < float("inf"):
            raise ParameterInvalid("lowpass_hz", self.lowpass_hz, "be a frequency in Hz, or 0 for no filter")
        if not (1 <= self.median_scans < 100 and self.median_scans % 2 == 1):
            raise ParameterInvalid("median_scans", self.median_scans, "be an odd number of scans from 1 to 99")
        positive("contact_on", self.contact_on)
        if not 0 < self.contact_off <= self.contact_on:
            raise ParameterInvalid(
                "contact_off", self.contact_off, f"be above 0 and at most contact_on, {self.contact_on}"
            )

    @property
    def off(self) -> list[int]:
        """Taxels that `mask` lists."""
        return [] if self.mask in ("auto", "none") else [int(part) for part in self.mask.split(",")]

    def start(self, sensor: Sensor, masked: Bools, lookahead: Iterable[RawScans] | None) -> ConditionSession:
        """Begin a session. masked: (taxels,) known to be off.

        With `lookahead`, a first pass over the same recording, tare and noise are estimated from all of it (batch).
        Without, they are estimated from past scans (stream): the first 12 scans are held back until then.
        Raises ParameterInvalid if mask or lowpass_hz does not fit the sensor; a stream's rate is known after 12 scans.
        """
        from taxelflow.condition.session import ConditionSession

        return ConditionSession(self, sensor, masked, lookahead)
