"""The protocol of an emulated device, and sending scans through it with faults."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taxelflow.errors import NameUnknown, ParameterInvalid

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from typing import Self

    from taxelflow.messages import Floats

FAULTS = {
    "cable": 1.0,
    "stall": 1.0,
    "gone": 60.0,
    "clock-jump": -1000.0,
    "half-frame": 0.0,
    "checksum": 0.0,
    "garbage": 0.0,
    "duplicate": 0.0,
    "reorder": 0.0,
    "taxel-count": 0.0,
}
"""Faults by name, with their default extent: s away, s of silence, s of silence, s by which the clock jumps."""
POLL_S = 0.02
"""Time between two looks whether a reader has come."""
_GARBAGE_BYTES = 37
"""Length of what is sent instead of a scan."""
USUAL = {
    "line": "tcp://127.0.0.1:5000",
    "tcp": "tcp://127.0.0.1:5000",
    "xela": "xela://127.0.0.1:5000",
    "inspire-modbus": "inspire-modbus://127.0.0.1:6000",
    "barrett-can": "barrett-can:vcan0",
    "udp-listen": "udp-listen://127.0.0.1:5000",
    "tcp-listen": "tcp-listen://127.0.0.1:5000",
}
"""Where a device is emulated that is named by its scheme alone."""


class Emulator(Protocol):
    """An emulated device, a context manager that is open to a reader."""

    url: str
    """What `taxelflow run` reads it by."""

    def __enter__(self) -> Self:
        """Open it."""

    def __exit__(self, *details: object) -> None:
        """Close it in order."""

    def wait(self) -> None:
        """Until somebody reads, for devices that know it."""

    def encode(self, t_s: float, values: Floats) -> bytes:
        """A scan (columns,) as the device sends it."""

    def send(self, message: bytes) -> bool:
        """Send bytes that `encode` gave, or spoiled ones; False if nobody is connected, so that they are lost."""

    def cut(self) -> None:
        """Lose the connection, as if the cable were pulled."""


@dataclass(frozen=True)
class Fault:
    """A fault at a time of the scans, in s from the first one. extent: see `FAULTS`."""

    name: str
    at_s: float
    extent: float


def parse_fault(text: str) -> Fault:
    """`NAME@SECONDS` or `NAME@SECONDS:EXTENT`. Raises NameUnknown, ParameterInvalid."""
    name, _, rest = text.partition("@")
    if name not in FAULTS:
        raise NameUnknown("fault", name, FAULTS)
    at, _, extent = rest.partition(":")
    duty = "be NAME@SECONDS or NAME@SECONDS:EXTENT, as in stall@2.5:1"
    try:
        fault = Fault(name, float(at), float(extent) if extent else FAULTS[name])
    except ValueError as error:
        raise ParameterInvalid("fault", text, duty) from error
    lowest = -math.inf if name == "clock-jump" else 0.0
    if not (0.0 <= fault.at_s < math.inf and lowest <= fault.extent and math.isfinite(fault.extent)):
        raise ParameterInvalid("fault", text, f"{duty}, with finite times from 0 on")
    return fault


class Playback:
    """Sends scans through an emulator, each when its time has come.

    whole: scans that were sent in order and undamaged. done: faults so far, by name.
    """

    def __init__(self, emulator: Emulator, faults: Sequence[Fault], speed: float) -> None:
        self._emulator, self._speed = emulator, speed
        self._faults = sorted(faults, key=lambda fault: fault.at_s)
        self._random = np.random.default_rng(0)
        self._clock_s = 0.0
        self._held: bytes | None = None
        self._away_until = 0.0
        self.whole = 0
        self.done: Counter[str] = Counter()

    def run(self, scans: Iterable[tuple[float, Floats]]) -> None:
        """Send (time, values) one after the other."""
        self._emulator.wait()
        began, first_s = time.monotonic(), None
        for t_s, values in scans:
            first_s = t_s if first_s is None else first_s
            if self._speed:
                time.sleep(max(0.0, began + (t_s - first_s) / self._speed - time.monotonic()))
            fault = None
            if self._faults and t_s - first_s >= self._faults[0].at_s:
                fault = self._faults.pop(0)
                self.done[fault.name] += 1
                self._begin(fault)
            for message, is_whole in self._messages(t_s + self._clock_s, values, fault):
                if time.monotonic() >= self._away_until and self._emulator.send(message):
                    self.whole += is_whole

    def _begin(self, fault: Fault) -> None:
        """What a fault does to the device itself."""
        if fault.name == "stall":
            time.sleep(fault.extent)
        elif fault.name == "clock-jump":
            self._clock_s += fault.extent
        elif fault.name in ("cable", "gone"):
            if fault.name == "cable":
                self._emulator.cut()
            self._away_until = time.monotonic() + fault.extent

    def _messages(self, t_s: float, values: Floats, fault: Fault | None) -> Iterator[tuple[bytes, bool]]:
        """A scan's message, spoiled by a fault; whether it is whole."""
        message = self._emulator.encode(t_s, values)
        name = fault.name if fault else ""
        if self._held is not None:
            yield message, True
            yield self._held, False  # late
            self._held = None
        elif name == "reorder":
            self._held = message
        elif name == "half-frame":
            yield message[: len(message) // 2], False
        elif name == "checksum":
            yield message[:-3] + bytes([message[-3] ^ 0x55]) + message[-2:], False
        elif name == "taxel-count":
            yield self._emulator.encode(t_s, values[:-1]), False
        else:
            if name == "garbage":
                yield self._random.bytes(_GARBAGE_BYTES) + b"\n", False
            yield message, True
            if name == "duplicate":
                yield message, False
