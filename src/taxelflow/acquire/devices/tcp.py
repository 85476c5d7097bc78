"""Lines or binary frames over TCP: `tcp://HOST:PORT` connects, `tcp-listen://HOST:PORT` waits for the device."""

from __future__ import annotations

import logging
import select
import socket
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from taxelflow.acquire.devices.base import CONNECT_S, PIECE_BYTES, POLL_S, Faults
from taxelflow.acquire.devices.streams import LINE_OPTIONS, PATIENCE, ByteSource, Ended, need_sensor, parser_of
from taxelflow.runtime.endpoints import listening, place_of

if TYPE_CHECKING:
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_SILENT_S = 1.0
"""A client that has sent nothing for longer gives way to another one."""

_log = logging.getLogger("taxelflow")


class _Connection:
    """A connected socket; reads wait for `POLL_S`."""

    patient = True
    timeout_s = PATIENCE.timeout_s

    def __init__(self, endpoint: tuple[str, int]) -> None:
        self._endpoint = endpoint
        self._socket: socket.socket | None = None

    def listen(self) -> None:
        """Nothing waits for a peer."""

    def receive(self) -> bytes:
        """See `Transport`."""
        if self._socket is None:
            raise ConnectionError("not connected")
        ready, _, _ = select.select([self._socket], [], [], POLL_S)
        if not ready:
            return b""
        received = self._socket.recv(PIECE_BYTES)
        if not received:
            raise Ended
        return received

    def close(self) -> None:
        """See `Transport`."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.close()
            self._socket = None

    def shut(self) -> None:
        """See `Transport`."""
        self.close()


class _Client(_Connection):
    def open(self) -> bool:
        """See `Transport`."""
        self._socket = socket.create_connection(self._endpoint, timeout=CONNECT_S)
        _keep_alive(self._socket)
        return True


class _Listener(_Connection):
    """Takes one client at a time; another one waits, and replaces a client that was lost or is silent for a second."""

    def __init__(self, endpoint: tuple[str, int]) -> None:
        super().__init__(endpoint)
        self._server: socket.socket | None = None
        self._heard_s = 0.0

    def listen(self) -> None:
        """See `Transport`."""
        self._server = listening(self._endpoint, backlog=1)
        _log.warning("listening on %s", place_of(self._server))

    def open(self) -> bool:
        """See `Transport`."""
        if self._server is None:
            raise ConnectionError("not listening")
        if not self._is_called(POLL_S):
            return False
        self._socket, _peer = self._server.accept()
        self._heard_s = time.monotonic()
        _keep_alive(self._socket)
        return True

    def receive(self) -> bytes:
        """See `Transport`."""
        received = super().receive()
        now = time.monotonic()
        if received:
            self._heard_s = now
        elif now - self._heard_s > _SILENT_S and self._is_called(0.0):
            raise ConnectionError("another client has connected while this one was silent")
        return received

    def _is_called(self, within_s: float) -> bool:
        """Whether a client waits to be taken."""
        return bool(self._server and select.select([self._server], [], [], within_s)[0])

    def shut(self) -> None:
        """See `Transport`."""
        self.close()
        if self._server is not None:
            self._server.close()


def _keep_alive(connected: socket.socket) -> None:
    connected.settimeout(None)
    connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`tcp://HOST:PORT`. Raises AddressInvalid, SensorNeeded."""
    return _source(address, sensor, _Client(address.endpoint))


def listen(address: Address, sensor: Sensor | None) -> ByteSource:
    """`tcp-listen://HOST:PORT`. Raises AddressInvalid, SensorNeeded."""
    return _source(address, sensor, _Listener(address.endpoint))


def _source(address: Address, sensor: Sensor | None, transport: _Client | _Listener) -> ByteSource:
    address.check_options(LINE_OPTIONS)
    sensor, faults = need_sensor(address, sensor), Faults()
    parser = parser_of(address, sensor, faults, ends_cut=True)  # the system closes for a program that was killed, too
    return ByteSource(address, sensor, transport, parser, faults)
