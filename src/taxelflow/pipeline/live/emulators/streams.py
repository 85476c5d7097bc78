"""Devices that send lines or binary frames: over TCP, UDP, a pseudo-terminal or standard output."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import socket
import struct
import sys
import termios
import time
import tty
from contextlib import suppress
from typing import TYPE_CHECKING

from taxelflow.acquire.devices.frames import FrameForm
from taxelflow.acquire.devices.line import line_of
from taxelflow.pipeline.live.emulators.base import POLL_S
from taxelflow.runtime.endpoints import listening, place_of

if TYPE_CHECKING:
    from typing import Self

    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_NO_LINGER = struct.pack("ii", 1, 0)
"""A connection that is closed so ends without a word, as by a cable."""


class _Stream:
    """Encodes scans as lines, or as the frames that the sensor's file describes."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        self.url = address.url
        self._frame = None if sensor.frame is None or address.options.get("format") == "line" else sensor.frame
        self._timed = address.options.get("time") != "arrival"

    def encode(self, t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        if self._frame is None:
            return line_of(t_s if self._timed else None, values)
        return FrameForm(self._frame, len(values)).pack(t_s, values)

    def wait(self) -> None:
        """Nobody can be waited for."""

    def cut(self) -> None:
        """There is no connection."""


class _Tcp(_Stream):
    """One reader at a time."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        super().__init__(address, sensor)
        self._endpoint = address.endpoint
        self._peer: socket.socket | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_details: object) -> None:
        if self._peer is not None:
            self._peer.close()

    def wait(self) -> None:
        """See `Emulator`."""
        while self._connected() is None:
            time.sleep(POLL_S)

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        peer = self._connected()
        if peer is None:
            return False
        try:
            peer.sendall(message)
        except OSError:
            self._peer = None
            return False
        return True

    def cut(self) -> None:
        """See `Emulator`."""
        if self._peer is not None:
            self._peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            self._peer.close()
            self._peer = None

    def _connected(self) -> socket.socket | None:
        if self._peer is None:
            with suppress(OSError):
                self._peer = self._met()
        return self._peer

    def _met(self) -> socket.socket:
        """A reader. Raises OSError if there is none now."""
        return socket.create_connection(self._endpoint, timeout=1.0)


class TcpClient(_Tcp):
    """Connects to a run that listens at the address, again and again."""


class TcpServer(_Tcp):
    """Listens at the address."""

    def __enter__(self) -> Self:
        self._server = listening(self._endpoint)
        self._server.setblocking(False)
        self.url = f"tcp://{place_of(self._server)}"
        return self

    def __exit__(self, *details: object) -> None:
        self._connected()  # a reader that waits sees the end, too
        super().__exit__(*details)
        self._server.close()

    def _met(self) -> socket.socket:
        peer, _ = self._server.accept()
        peer.setblocking(True)
        return peer


class UdpSender(_Stream):
    """Sends a datagram for each scan."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        super().__init__(address, sensor)
        self._endpoint = address.endpoint

    def __enter__(self) -> Self:
        family, kind, protocol, _, place = socket.getaddrinfo(*self._endpoint, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.connect(place)
        return self

    def __exit__(self, *_details: object) -> None:
        self._socket.close()

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        try:
            self._socket.send(message)
        except OSError:  # nobody listens
            return False
        return True


class Pty:
    """A pseudo-terminal: a serial line whose other end has a path."""

    _drained_s = 1.0

    def __init__(self) -> None:
        self._device, self._line = pty.openpty()
        tty.setraw(self._line)
        self.path = os.ttyname(self._line)

    def send(self, message: bytes) -> bool:
        """Send it to whoever reads; False if the line is full, because nobody does."""
        left = memoryview(message)
        while left:
            _, ready, _ = select.select([], [self._device], [], POLL_S)
            if not ready:
                return False
            left = left[os.write(self._device, left) :]
        return True

    def received(self) -> bytes:
        """What the reader has sent."""
        ready, _, _ = select.select([self._device], [], [], 0.0)
        return os.read(self._device, 1 << 12) if ready else b""

    def close(self) -> None:
        """Unplug it, when what was sent has been read, or soon: the system drops what a reader has not taken yet."""
        until = time.monotonic() + self._drained_s
        time.sleep(POLL_S)  # what was sent reaches the line by a thread of the system
        while self._unread() and time.monotonic() < until:
            time.sleep(POLL_S)
        os.close(self._device)
        os.close(self._line)

    def _unread(self) -> int:
        """Bytes that wait for a reader."""
        (count,) = struct.unpack("i", fcntl.ioctl(self._line, termios.FIONREAD, bytes(4)))
        return int(count)


class SerialDevice(_Stream):
    """A serial device on a pseudo-terminal, whatever path the address has."""

    def __enter__(self) -> Self:
        self._pty = Pty()
        self.url = f"serial:{self._pty.path}"
        return self

    def __exit__(self, *_details: object) -> None:
        self._pty.close()

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        return self._pty.send(message)


class StandardOutput(_Stream):
    """Prints what a run reads on its standard input."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_details: object) -> None:
        """It stays open."""

    def send(self, message: bytes) -> bool:
        """See `Emulator`."""
        sys.stdout.buffer.write(message)
        sys.stdout.buffer.flush()
        return True
