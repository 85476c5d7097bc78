"""A WebSocket as a transport: each message is a piece."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from taxelflow.acquire.devices.base import CONNECT_S, POLL_S
from taxelflow.acquire.devices.streams import PATIENCE, Ended
from taxelflow.errors import ExtraMissing

if TYPE_CHECKING:
    from collections.abc import Sequence

_LONGEST = 1 << 20
"""Bytes of a message at most."""


class WebSocket:
    """A client. greeting: messages that are sent when it has connected."""

    patient = False
    timeout_s = PATIENCE.timeout_s

    def __init__(self, url: str, greeting: Sequence[str] = ()) -> None:
        try:
            from websockets import exceptions
            from websockets.sync.client import connect
        except ImportError as error:
            raise ExtraMissing("devices", "websockets") from error
        self._connect: Any = connect
        self._exceptions: Any = exceptions
        self._url, self._greeting = url, greeting
        self._connection: Any = None

    def listen(self) -> None:
        """Nothing waits for a peer."""

    def open(self) -> bool:
        """See `Transport`."""
        try:
            self._connection = self._connect(
                self._url, max_size=_LONGEST, open_timeout=CONNECT_S, close_timeout=CONNECT_S
            )
            for message in self._greeting:
                self._connection.send(message)
        except (self._exceptions.WebSocketException, EOFError) as error:
            raise OSError(str(error)) from error
        return True

    def receive(self) -> bytes:
        """See `Transport`."""
        try:
            message = self._connection.recv(timeout=POLL_S)
        except TimeoutError:
            return b""
        except self._exceptions.ConnectionClosedOK as closed:
            raise Ended from closed
        except self._exceptions.ConnectionClosed as error:
            raise ConnectionError(str(error)) from error
        return message.encode() if isinstance(message, str) else bytes(message)

    def close(self) -> None:
        """See `Transport`."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def shut(self) -> None:
        """See `Transport`."""
        self.close()
