"""Streams of Lab Streaming Layer: `lsl:NAME`, a channel for each number of a scan, by `pylsl` (extra `lsl`).

The time of a scan is its stamp, by the clock of the computer that sends; the timeline finds its offset and drift.
Streams are announced and looked for on this machine only; `?scope=link` or `site` reach further, `config` leaves that
to the configuration file of liblsl.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.devices.base import CONNECT_S, POLL_S, Faults, WholeMessages
from taxelflow.acquire.devices.streams import PATIENCE, ByteSource, need_sensor
from taxelflow.errors import AddressInvalid, ExtraMissing

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_OPTIONS = ("time", "wait", "timeout", "keep", "scope")
_SCOPES = ("machine", "link", "site", "config")
_scope: dict[str, str] = {}
"""The scope of this process."""


@dataclass(frozen=True, slots=True)
class _Inlet:
    """What a reader holds."""

    held_s: int = 10
    """s of scans that LSL holds for a reader that is behind."""
    samples: int = 256
    """Scans that are read at once, at most."""


_INLET = _Inlet()


@dataclass(frozen=True, slots=True)
class _End:
    """The end of an outlet with readers."""

    linger_s: float = 0.5
    """Time that it stays after its last sample."""
    look_s: float = 0.02
    """Time between two looks whether there are any readers."""


_END = _End()


@cache
def _library() -> Any:
    try:
        import pylsl as found
    except (ImportError, RuntimeError, OSError) as error:
        raise ExtraMissing("lsl", "pylsl") from error
    return found


def pylsl(address: Address) -> Any:
    """The package, which reaches as far as an address allows: it is set up once in a process.

    Raises ExtraMissing, also where its library cannot be loaded, and AddressInvalid where another address reached
    further or less far.
    """
    library, scope = _library(), address.choice("scope", _SCOPES)
    if not _scope and scope != "config":
        library.set_config_content(f"[multicast]\nResolveScope = {scope}\n[log]\nlevel = -3\n")
    if _scope.setdefault("scope", scope) != scope:
        raise AddressInvalid(address.url, f"scope={scope}", f"all LSL addresses the same: {_scope['scope']} is in use")
    return library


def linger(*outlets: Any) -> None:
    """Give outlets time before they are closed: threads of theirs send, no call waits for these, and what they have
    not sent by then is lost.
    """
    until = time.monotonic() + _END.linger_s
    while time.monotonic() < until and any(outlet.have_consumers() for outlet in outlets):
        time.sleep(_END.look_s)


class Inlet:
    """A reader of the stream of a name; a piece is float64: how many channels, then rows of a stamp and a scan."""

    patient = False
    timeout_s = PATIENCE.timeout_s

    def __init__(self, address: Address) -> None:
        self._lsl, self._name = pylsl(address), address.need_path("lsl:NAME")
        self._inlet: Any = None
        self._last = ""

    def listen(self) -> None:
        """Nothing waits for a peer; streams are looked for from now on."""
        self._resolver = self._lsl.ContinuousResolver("name", self._name, forget_after=CONNECT_S)

    def open(self) -> bool:
        """See `Transport`."""
        streams = self._resolver.results()
        if not streams:
            raise ConnectionError(f"no stream {self._name!r}")
        stream = min(streams, key=lambda one: one.uid() == self._last)  # a lost one is listed for a while
        if stream.channel_format() == self._lsl.cf_string:
            raise ConnectionError(f"stream {self._name!r} sends text")
        self._last = stream.uid()
        try:
            self._inlet = self._lsl.StreamInlet(stream, max_buflen=_INLET.held_s, recover=False)
            self._inlet.open_stream(timeout=CONNECT_S)
        except RuntimeError as error:
            raise ConnectionError(str(error)) from error
        return True

    def receive(self) -> bytes:
        """See `Transport`."""
        try:
            first, stamp = self._inlet.pull_sample(timeout=POLL_S)
            if first is None:
                return b""
            scans, stamps = self._inlet.pull_chunk(timeout=0.0, max_samples=_INLET.samples)
        except RuntimeError as error:  # the stream has been lost
            raise ConnectionError(str(error)) from error
        rows = np.column_stack([[stamp, *stamps], [first, *scans]])
        return np.concatenate([[len(first)], rows.ravel()]).astype(np.float64).tobytes()

    def close(self) -> None:
        """See `Transport`."""
        if self._inlet is not None:
            self._inlet.close_stream()
            self._inlet = None

    def shut(self) -> None:
        """See `Transport`."""
        self.close()


class LslParser:
    """Scans of the pieces of an `Inlet`."""

    def __init__(self, columns: int, faults: Faults, *, timed: bool) -> None:
        self._columns, self._faults, self._timed = columns, faults, timed

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `WholeMessages`."""
        numbers = np.frombuffer(received)
        if numbers[0] != self._columns:
            self._faults.count("bad message", f"{numbers[0]:.0f} channels, {self._columns} expected")
            return []
        rows = numbers[1:].reshape(-1, self._columns + 1)
        return [(float(row[0]) if self._timed else None, row[1:]) for row in rows]


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`lsl:NAME`. Raises AddressInvalid, SensorNeeded, ExtraMissing."""
    address.check_options(_OPTIONS)
    sensor, faults = need_sensor(address, sensor), Faults()
    timed = address.choice("time", ("device", "arrival")) == "device"
    inlet, parser = Inlet(address), LslParser(sensor.channel_map.columns, faults, timed=timed)
    return ByteSource(address, sensor, inlet, WholeMessages(parser.feed), faults)
