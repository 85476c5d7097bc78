"""JSON lines in a file, on standard output, or to whoever connects: `jsonl:FILE`, `jsonl:-`, `jsonl-listen://`."""

from __future__ import annotations

import errno
import logging
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.errors import PortTaken, SinkUnusable
from taxelflow.publish.sinks.base import ResultSink
from taxelflow.publish.sinks.lines import json_lines
from taxelflow.publish.sinks.patient import PatientFile
from taxelflow.runtime.endpoints import authority, listening, place_of

if TYPE_CHECKING:
    import socket

    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.runtime.addresses import Address

_MOST_WAITING = 1 << 20
"""Bytes held for a client that does not read; lines that would be more are dropped."""


@dataclass(frozen=True, slots=True)
class _Clients:
    """Clients of a sink."""

    most: int = 64
    """Clients at a time: each is a file of the process, of which a system allows some hundreds."""
    linger_s: float = 1.0
    """Time for the last lines to reach clients at the end."""


_CLIENTS = _Clients()
_STDOUT = 1
"""Descriptor of standard output."""

_log = logging.getLogger("taxelflow")


class JsonFile(ResultSink):
    """A line per scan, on disk when it is written."""

    lossless = True
    texts = True

    def __init__(self, path: str) -> None:
        self._path, self.dropped = path, 0
        self.files = () if path == "-" else (Path(path),)

    def open(self, head: Head) -> None:
        """See `Sink`."""
        self._pads = head.pads
        self._file = PatientFile(_STDOUT if self._path == "-" else self._path, head.report)

    def write(self, update: Update) -> None:
        """See `Sink`."""
        lines, before = json_lines(update, self._pads), self._file.lost
        self._file.write(b"".join(lines))
        lost = self._file.lost - before  # the last bytes of them
        while lost > 0:
            lost -= len(lines.pop())
            self.dropped += 1

    def hurry(self) -> None:
        """See `Sink`."""
        self._file.give_up()

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        self._file.close()


class _Client:
    """A connected reader, and the lines that wait for it."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        self._socket = connected
        self._waiting: deque[memoryview] = deque()
        self.waiting_bytes = 0

    def offer(self, line: bytes) -> bool:
        """Take a line; False if too much waits already."""
        if self.waiting_bytes + len(line) > _MOST_WAITING:
            return False
        self._waiting.append(memoryview(line))
        self.waiting_bytes += len(line)
        return True

    def send(self) -> bool:
        """Send what the client takes now; False if it has gone."""
        try:
            while self._waiting:
                sent = self._socket.send(self._waiting[0])
                self.waiting_bytes -= sent
                self._waiting[0] = self._waiting[0][sent:]
                if not self._waiting[0]:
                    self._waiting.popleft()
        except BlockingIOError:
            pass
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


class JsonServer(ResultSink):
    """A line per scan to each client, from when it connects; a client that does not read misses lines."""

    lossless = False

    def __init__(self, endpoint: tuple[str, int]) -> None:
        self._endpoint = endpoint
        self._clients: list[_Client] = []
        self.dropped = 0

    @property
    def texts(self) -> bool:
        """Whether anybody reads."""
        return bool(self._clients)

    def open(self, head: Head) -> None:
        """See `Sink`."""
        self._pads, self._report = head.pads, head.report
        try:
            self._server = listening(self._endpoint)
        except OSError as error:
            url = f"jsonl-listen://{authority(*self._endpoint)}"
            if error.errno == errno.EADDRINUSE:
                raise PortTaken(url, self._endpoint[1]) from error
            raise SinkUnusable(url, str(error)) from error
        self._server.setblocking(False)
        _log.warning("JSON lines at %s", place_of(self._server))

    def write(self, update: Update) -> None:
        """See `Sink`."""
        self._accept()
        if not self._clients:
            return
        missed = sum(not client.offer(line) for line in json_lines(update, self._pads) for client in self._clients)
        if missed and not self.dropped:
            self._report("a client does not read", "lines are dropped for it")
        self.dropped += missed
        self._send()

    def tick(self) -> None:
        """See `Sink`."""
        self._accept()
        self._send()

    def hurry(self) -> None:
        """See `Sink`."""

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        until = time.monotonic() + _CLIENTS.linger_s
        while any(client.waiting_bytes for client in self._clients) and time.monotonic() < until:
            self._send()
            time.sleep(0.01)
        for client in self._clients:
            client.close()
        self._server.close()

    def _accept(self) -> None:
        with suppress(OSError):  # nobody waits, or who did has gone
            while True:
                connected = self._server.accept()[0]
                if len(self._clients) < _CLIENTS.most:
                    self._clients.append(_Client(connected))
                else:
                    connected.close()
                    self._report("a client is refused", f"{_CLIENTS.most} are connected")

    def _send(self) -> None:
        for client in list(self._clients):
            if not client.send():
                client.close()
                self._clients.remove(client)


def write(address: Address) -> JsonFile:
    """`jsonl:FILE`, `jsonl:-`. Raises AddressInvalid."""
    address.check_options(())
    return JsonFile(str(address.file_path("jsonl:FILE, or jsonl:- for standard output")))


def listen(address: Address) -> JsonServer:
    """`jsonl-listen://HOST:PORT`. Raises AddressInvalid."""
    address.check_options(())
    return JsonServer(address.endpoint)
