"""A hand on a CAN bus of this process, which sends readings only when it is asked for them."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from streaming import awaited, opened
from taxelflow.acquire.devices.barrett import CAN_FRAME, PUCKS, CanBus, ask, frames_of
from taxelflow.errors import AddressInvalid
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator

can = pytest.importorskip("can")
HAND = load_sensor("barretthand-bh280-96")


@contextmanager
def hand(channel: str, pucks: tuple[int, ...] = PUCKS) -> Iterator[list[int]]:
    """Pucks that answer each request with their number of answers, in N/cm2; the answers of each."""
    bus, end, answers = can.Bus(interface="virtual", channel=channel), threading.Event(), [0, 0, 0, 0]

    def answer() -> None:
        while not end.is_set():
            message = bus.recv(0.01)
            if message is None or message.arbitration_id not in pucks:
                continue
            assert bytes(message.data) == ask(message.arbitration_id)[1]
            number = message.arbitration_id - PUCKS[0]
            answers[number] += 1
            readings = frames_of(PUCKS[number], np.full(24, answers[number] % 15))
            for identifier, content in CAN_FRAME.iter_unpack(readings):
                bus.send(can.Message(arbitration_id=identifier, data=content, is_extended_id=False))
            other = can.Message(arbitration_id=0x403, data=bytes(8), is_extended_id=False)  # positions of a finger
            bus.send(other)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield answers
    finally:
        end.set()
        thread.join()
        bus.shutdown()


def scans(source: Any, count: int) -> list[list[float]]:
    found: list[list[float]] = []
    with source:
        for arrival in source:
            if arrival is not None:
                found.append(arrival.values[::24].tolist())
            if len(found) == count:
                break
    return found


def test_each_scan_is_asked_for() -> None:
    with hand("each") as answers:
        found = scans(opened("barrett-can:each?interface=virtual&rate=200", HAND), 10)
    np.testing.assert_array_equal(found, np.repeat(np.arange(1.0, 11.0), 4).reshape(10, 4))
    assert max(answers) <= 11


def test_a_hand_without_one_of_its_pucks_is_asked_again() -> None:
    source = opened("barrett-can:three?interface=virtual&rate=200", HAND)
    with hand("three", PUCKS[:3]):
        found = scans(source, 3)
    np.testing.assert_array_equal(found, [[n, n, n, np.nan] for n in (1.0, 2.0, 3.0)])
    assert source.faults.counts["puck silent"] == 3


def test_an_adapter_that_is_pulled_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    with hand("pulled"), opened("barrett-can:pulled?interface=virtual&rate=200", HAND) as source:
        bus, arrivals = source._transport._bus, iter(source)

        def pulled(*_details: object) -> None:
            raise can.CanOperationError("no such device")

        shutdown = bus.shutdown
        monkeypatch.setattr(bus, "recv", pulled)
        monkeypatch.setattr(bus, "shutdown", lambda: (shutdown(), pulled()))
        awaited(lambda: next(arrivals) is not None)
    assert source.faults.counts == {"connection lost": 1, "connected again": 1}


def test_a_rate_of_zero_is_refused() -> None:
    with pytest.raises(AddressInvalid, match=r"rate=0; give rate=NUMBER, at least 0.1"):
        opened("barrett-can:can0?rate=0", HAND)


def test_what_is_no_frame_does_not_end_the_emulated_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Garbage had identifiers that no frame can have, which ended all who listen."""
    hands, other = CanBus("virtual", "garbage"), can.Bus(interface="virtual", channel="garbage")
    hands.open()
    hands.send(0xABCD, bytes(8))
    assert other.recv(1.0).arbitration_id == 0x3CD

    def damaged(_wait_s: float) -> None:
        raise can.CanOperationError("could not unpack received message")

    with monkeypatch.context() as patched:
        patched.setattr(hands._bus, "recv", damaged)
        assert hands.asked(0.0) == 0
    hands.shut()
    other.shutdown()
