"""Messages in CDR that are damaged: whole scans come out, or a fault is counted."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagged import message, store_of
from streaming import PALM
from taxelflow import load_sensor
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.dds import INSPIRE, INSPIRE_TYPE, CdrParser
from taxelflow.acquire.devices.inspire import PADS
from taxelflow.acquire.ros import decode
from taxelflow.acquire.ros.kinds import Kind, kind_of

TOUCH = "tactile_msgs/msg/TactileState"


def touched() -> tuple[CdrParser, bytes]:
    kind = kind_of(TOUCH)
    assert isinstance(kind, Kind)
    store = store_of(TOUCH)
    content = store.serialize_cdr(message(store, TOUCH, 5.0, [np.ones(28)]), TOUCH)
    return CdrParser(PALM, TOUCH, kind, Faults(), timed=True), bytes(content)


def inspired() -> tuple[CdrParser, bytes]:
    store = decode.store_of(INSPIRE_TYPE, "", "", INSPIRE.definition)
    content = store.serialize_cdr(store.types[INSPIRE_TYPE](*(np.ones(one, np.int16) for one in PADS)), INSPIRE_TYPE)
    sensor = load_sensor("inspire-rh56dftp@3mm")
    return CdrParser(sensor, INSPIRE_TYPE, INSPIRE, Faults(), timed=True), bytes(content)


@pytest.mark.parametrize("made", [touched(), inspired()], ids=["tactile_msgs", "inspire"])
@given(places=st.lists(st.tuples(st.integers(0, 100), st.integers(0, 255)), max_size=4), upto=st.integers(0, 3000))
def test_a_damaged_message_is_a_scan_or_counted(
    made: tuple[CdrParser, bytes], places: list[tuple[int, int]], upto: int
) -> None:
    parser, content = made
    [(_, whole)] = parser.feed(content)
    damaged = bytearray(content)
    for place, byte in places:
        damaged[place] = byte
    logging.disable()
    found = parser.feed(bytes(damaged)) + parser.feed(bytes(damaged[:upto]))
    logging.disable(logging.NOTSET)
    assert all(values.shape == whole.shape for _, values in found)
    assert len(found) + parser._faults.counts["bad message"] >= 2
