"""Sources of bytes: a transport that brings bytes, and a parser that finds the scans in them."""

from __future__ import annotations

import errno
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from taxelflow.acquire.base import Recording
from taxelflow.acquire.columns import PER_SECOND
from taxelflow.acquire.devices.base import Arrival, Backoff
from taxelflow.errors import AddressInvalid, PortTaken, SensorNeeded, SourceUnreachable
from taxelflow.sensors.catalogue import builtin_sensors

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Self

    from taxelflow.acquire.devices.base import Faults, Parser
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Patience:
    """How long a source waits before it gives up, s: defaults of its options, of which 0 is never."""

    wait_s: float = 5.0
    """Of ?wait=, for a device to appear at the start."""
    timeout_s: float = 10.0
    """Of ?timeout=, for one that has gone silent."""


PATIENCE = _Patience()
_SPREAD_S = 0.05
"""Longest time that scans without a time of their own are spread over: USB adapters pass bytes on in pieces."""
STREAM_OPTIONS = ("time", "wait", "timeout", "keep")
LINE_OPTIONS = (*STREAM_OPTIONS, "format", "time-unit")
"""Of connections that may send lines."""


class Ended(Exception):
    """The peer has closed the stream in order."""


class Transport(Protocol):
    """A connection that may be lost and opened again."""

    patient: bool
    timeout_s: float

    def listen(self) -> None:
        """Open what waits for a peer, once. Raises OSError."""

    def open(self) -> bool:
        """Connect, within `POLL_S` or so; False if no peer has come yet. Raises OSError if that fails."""

    def receive(self) -> bytes:
        """Bytes that have come, none after `POLL_S`. Raises Ended, and OSError if the connection is lost."""

    def close(self) -> None:
        """Close the connection, if there is one, so that it can be opened again. Raises nothing."""

    def shut(self) -> None:
        """Close all."""


class ByteSource:
    """Scans from a stream of bytes, with reconnection."""

    def __init__(self, address: Address, sensor: Sensor, transport: Transport, parser: Parser, faults: Faults) -> None:
        self.recording, self.faults = Recording.live(sensor, address.url), faults
        self.patient = transport.patient
        self._address, self._transport, self._parser = address, transport, parser
        self._wait_s = address.number("wait", PATIENCE.wait_s)
        self._timeout_s = address.number("timeout", transport.timeout_s) or float("inf")
        self._keep = address.flag("keep")
        self._open = self._lost = False

    def __enter__(self) -> Self:
        with ExitStack() as opening:
            opening.callback(self._transport.shut)
            try:
                self._transport.listen()
            except OSError as error:
                if error.errno == errno.EADDRINUSE:
                    raise PortTaken(self._address.url, self._address.port) from error
                raise SourceUnreachable(self._address.url, words(error), 0.0, "check the address") from error
            self._open = self._first_open()
            opening.pop_all()
        return self

    def _first_open(self) -> bool:
        """Connect, within the time that is allowed; False if a peer is to come. Raises SourceUnreachable."""
        backoff, began = Backoff(), time.monotonic()
        while True:
            try:
                return self._opened()
            except OSError as error:
                if time.monotonic() - began >= self._wait_s:
                    raise SourceUnreachable(self._address.url, words(error), self._wait_s) from error
                self.faults.count("cannot connect", f"{words(error)}; trying again")
                for _ in backoff.pause():
                    pass

    def _opened(self) -> bool:
        """Connect; nothing stays open of what fails half-way, or the next attempt would find it in use."""
        try:
            return self._transport.open()
        except OSError:
            self._transport.close()
            raise

    def __exit__(self, *_details: object) -> None:
        self._transport.shut()

    def __iter__(self) -> Iterator[Arrival | None]:
        backoff = Backoff()
        while True:
            try:
                self._open = self._open or self._opened()
                if not self._open:
                    yield None
                    continue
            except OSError as error:
                self.faults.count("cannot connect", f"{words(error)}; trying again")
                yield from backoff.pause()
                continue
            try:
                yield from self._connected(backoff)
            except Ended:
                self._open = False
                for t_s, values in self._parser.end():
                    yield Arrival(time.monotonic(), t_s, values)
                self._transport.close()
                if not self._keep:
                    return
            except OSError as error:
                if not self._lost:  # else the silence goes on: nothing has come since the loss was reported
                    self.faults.report("connection lost", f"{words(error)}; connecting again")
                self._open, self._lost = False, True
                self._transport.close()
                self._parser.restart()
                yield from backoff.pause()

    def _connected(self, backoff: Backoff) -> Iterator[Arrival | None]:
        heard = time.monotonic()
        while True:
            before = time.monotonic()
            received = self._transport.receive()
            now = time.monotonic()
            if received:
                heard = now
                backoff.restart()
                if self._lost:
                    self._lost = False
                    self.faults.report("connected again", self._address.url)
                yield from _spread(self._parser.feed(received), max(before, now - _SPREAD_S), now)
                continue
            if now - heard > self._timeout_s:
                raise TimeoutError(f"nothing came for {self._timeout_s:g} s")
            yield None


def _spread(scans: list[tuple[float | None, Floats]], since_s: float, now_s: float) -> Iterator[Arrival]:
    """Arrivals of scans that came in one piece; those without a time are spread over the wait for it."""
    for number, (t_s, values) in enumerate(scans, 1):
        share = number / len(scans) if t_s is None else 1.0
        yield Arrival(since_s + share * (now_s - since_s), t_s, values)


def need_sensor(address: Address, sensor: Sensor | None) -> Sensor:
    """The sensor. Raises SensorNeeded if none was given."""
    if sensor is None:
        raise SensorNeeded(address.url, builtin_sensors())
    return sensor


def is_timed(address: Address) -> bool:
    """Whether the device's clock gives the times, not the arrival: the option time. Raises AddressInvalid."""
    return address.choice("time", ("device", "arrival")) == "device"


def refuse_device_time(address: Address) -> None:
    """Raises AddressInvalid for a time that a device without a clock does not send."""
    address.choice("time", ("arrival",))


def parser_of(
    address: Address, sensor: Sensor, faults: Faults, *, joins_late: bool = False, ends_cut: bool = False
) -> Parser:
    """Lines, or binary frames if the sensor file describes them. joins_late, ends_cut: as of `LineParser`.

    Raises AddressInvalid.
    """
    from taxelflow.acquire.devices.frames import FrameParser
    from taxelflow.acquire.devices.line import LineParser

    columns = sensor.channel_map.columns
    timed = is_timed(address)
    form = address.choice("format", ("binary", "line") if sensor.frame is not None else ("line",))
    unit = address.choice("time-unit", tuple(PER_SECOND))
    if "time-unit" in address.options and not (timed and form == "line"):
        raise AddressInvalid(address.url, f"time-unit={unit}", "it for lines with a time only")
    if sensor.frame is not None and form == "binary":
        return FrameParser(sensor.frame, columns, faults, timed=timed)
    return LineParser(
        columns, faults, timed=timed, joins_late=joins_late, ends_cut=ends_cut, per_second=PER_SECOND[unit]
    )


def words(error: OSError) -> str:
    """What an error of the system says, without its number."""
    return error.strerror or str(error) or type(error).__name__
