"""A serial device that is pulled at any moment, and plugged in again."""

from __future__ import annotations

import os
import pty
import termios
from typing import TYPE_CHECKING, Any

import pytest

from streaming import awaited, lines, opened, slid
from taxelflow.acquire.devices.serial import SerialLine

if TYPE_CHECKING:
    from collections.abc import Iterator

pytest.importorskip("serial", reason="pyserial is not installed (extra `devices`)")


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """Descriptor of the device's end of a pseudo-terminal, and path of the other one."""
    device, other = pty.openpty()
    yield device, os.ttyname(other)
    os.close(device)
    os.close(other)


def test_a_device_that_is_pulled_while_it_opens_is_a_lost_connection(
    line: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def pulled(*_details: object) -> None:
        raise termios.error(5, "Input/output error")  # no OSError, and pyserial passes it on

    monkeypatch.setattr(termios, "tcflush", pulled)
    with pytest.raises(OSError, match=r"^Input/output error$"):
        SerialLine(line[1], 115200).open()


def test_a_device_that_cannot_be_closed_is_opened_again(line: tuple[int, str], monkeypatch: pytest.MonkeyPatch) -> None:
    device, path = line
    with opened(f"serial:{path}") as source:
        arrivals = iter(source)
        port = source._transport._port

        def fails(*_details: object) -> Any:
            raise OSError(5, "Input/output error")

        monkeypatch.setattr(port, "read", fails)
        monkeypatch.setattr(port, "close", lambda: (type(port).close(port), fails()))
        awaited(lambda: next(arrivals) is None and bool(source.faults.counts))
        sent = b"".join(lines(slid())[:3])
        awaited(lambda: os.write(device, sent) > 0 and next(arrivals) is not None)
    assert source.faults.counts == {"connection lost": 1, "connected again": 1}


def test_what_fails_half_way_of_opening_does_not_keep_the_device(
    line: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    send, tries = SerialLine.send, list[bytes]()

    def fails_first(self: SerialLine, command: bytes) -> None:
        tries.append(command)
        if len(tries) == 1:
            raise OSError(5, "Input/output error")
        send(self, command)

    monkeypatch.setattr(SerialLine, "send", fails_first)
    with opened(f"dsa:{line[1]}") as source:
        assert source.faults.counts == {"cannot connect": 1}
    assert len(tries) == 2
