"""Lines or binary frames in UDP datagrams, each of one or more whole scans: `udp-listen://HOST:PORT`."""

from __future__ import annotations

import logging
import select
import socket
from typing import TYPE_CHECKING

from taxelflow.acquire.devices.base import POLL_S, Faults, WholeMessages
from taxelflow.acquire.devices.streams import PATIENCE, ByteSource, need_sensor, parser_of
from taxelflow.runtime.endpoints import place_of

if TYPE_CHECKING:
    from taxelflow.acquire.devices.base import Parser
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_LONGEST_DATAGRAM = 1 << 16
"""Bytes of a datagram at most, by the protocol."""
_BUFFER = 1 << 22
"""Bytes that the system is asked to hold while nobody reads."""

_log = logging.getLogger("taxelflow")


class _Datagrams:
    """A bound socket. Datagrams that come while its buffer is full are lost."""

    patient = False
    timeout_s = PATIENCE.timeout_s

    def __init__(self, endpoint: tuple[str, int]) -> None:
        self._endpoint = endpoint
        self._socket: socket.socket | None = None

    def listen(self) -> None:
        """See `Transport`."""
        family, kind, protocol, _, place = socket.getaddrinfo(*self._endpoint, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._socket.bind(place)
        _log.warning("listening on %s (UDP)", place_of(self._socket))

    def open(self) -> bool:
        """Nobody connects."""
        return True

    def receive(self) -> bytes:
        """One datagram."""
        if self._socket is None:
            raise ConnectionError("not listening")
        ready, _, _ = select.select([self._socket], [], [], POLL_S)
        return self._socket.recv(_LONGEST_DATAGRAM) if ready else b""

    def close(self) -> None:
        """The socket stays bound: a device that went silent may come back."""

    def shut(self) -> None:
        """See `Transport`."""
        if self._socket is not None:
            self._socket.close()


def whole(parser: Parser) -> WholeMessages:
    """A parser for whose stream every piece ends a scan."""

    def feed(received: bytes) -> list[tuple[float | None, Floats]]:
        scans = parser.feed(received) + parser.end()
        parser.restart()
        return scans

    return WholeMessages(feed)


def listen(address: Address, sensor: Sensor | None) -> ByteSource:
    """`udp-listen://HOST:PORT`. Raises AddressInvalid, SensorNeeded."""
    address.check_options(("time", "format", "timeout", "time-unit"))
    sensor, faults = need_sensor(address, sensor), Faults()
    parser = whole(parser_of(address, sensor, faults))
    return ByteSource(address, sensor, _Datagrams(address.endpoint), parser, faults)
