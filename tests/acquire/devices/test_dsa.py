"""Frames of the DSA controller, between anything that a serial line may bring."""

from __future__ import annotations

import logging
import struct
from typing import TYPE_CHECKING

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from streaming import PALM
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.dsa import POLYNOMIAL, PREAMBLE, DsaParser, Message, cells_of, frame
from taxelflow.acquire.devices.frames import crc_table

if TYPE_CHECKING:
    from collections.abc import Sequence

CELLS = cells_of(PALM.layout)[1]
TABLE = crc_table(int(POLYNOMIAL, 16))


def scan(number: int) -> bytes:
    return frame(Message.SCAN, struct.pack("<IB", number, 0) + np.full(CELLS, number, "<u2").tobytes(), TABLE)


def received(garbage: Sequence[bytes], piece: int) -> list[int]:
    """Numbers of the scans that a parser finds in pieces of this many bytes; garbage comes before each scan."""
    parser = DsaParser(PALM.layout, Faults(), int(POLYNOMIAL, 16))
    sent = b"".join(odd + scan(number) for number, odd in enumerate(garbage))
    found = [one for at in range(0, len(sent), piece) for one in parser.feed(sent[at : at + piece])]
    return [int(values[0]) for _, values in found]


GARBAGE = st.one_of(
    st.just(b""),
    st.binary(max_size=30),
    st.integers(1, len(scan(7)) - 1).map(lambda size: scan(7)[:size]),
    st.integers(0, 2**16 - 1).map(lambda size: PREAMBLE + struct.pack("<BH", Message.SCAN, size)),
)


@given(garbage=st.lists(GARBAGE, max_size=6), piece=st.integers(1, 200))
def test_every_scan_among_garbage_is_found(garbage: list[bytes], piece: int) -> None:
    logging.disable()
    silent = [b""] * 5  # a damaged length may still wait for as much
    found = received([*garbage, *silent], piece)
    logging.disable(logging.NOTSET)
    assert found[: len(garbage)] == list(range(len(garbage)))


def test_a_damaged_length_delays_no_more_than_some_scans() -> None:
    damaged = PREAMBLE + struct.pack("<BH", Message.SCAN, 8000)
    assert received([b"", damaged, b""], 1000) == [0, 1, 2]
