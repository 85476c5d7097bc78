"""The clock of binary frames: it wraps, is set back, and goes on while a connection is lost."""

from __future__ import annotations

import struct

import pytest

from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.frames import FrameParser
from taxelflow.acquire.devices.udp import _Whole
from taxelflow.sensors.frame import Frame

SPAN_S = 2.0**32 * 1e-6
FRAME = Frame("AA55", type="uint16", time="uint32_us", checksum="none")


def frame(t_s: float) -> bytes:
    return b"\xaa\x55" + struct.pack("<IH", round(t_s * 1e6) % 2**32, 7)


def times(parser: FrameParser | _Whole, *t_s: float) -> list[float]:
    return [found for t in t_s for found, _ in parser.feed(frame(t)) if found is not None]


@pytest.fixture
def parser() -> FrameParser:
    return FrameParser(FRAME, 1, Faults(), timed=True)


def test_a_clock_that_wraps_goes_on(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.02, SPAN_S - 0.01, SPAN_S + 0.01, 1.5 * SPAN_S, 1.95 * SPAN_S, 2.01 * SPAN_S]
    assert times(parser, *sent) == pytest.approx(sent)


def test_a_clock_that_wraps_between_datagrams_goes_on(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.01, SPAN_S + 0.01, SPAN_S + 0.02]
    assert times(_Whole(parser), *sent) == pytest.approx(sent)


def test_a_clock_that_wraps_while_the_connection_is_lost_goes_on(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.01, SPAN_S + 5.0]
    before = times(parser, sent[0])
    parser.restart()
    assert [*before, *times(parser, sent[1])] == pytest.approx(sent)


def test_a_device_that_starts_again_has_not_wrapped(parser: FrameParser) -> None:
    assert times(parser, 3002.0, 0.01, 0.02) == pytest.approx([3002.0, 0.01, 0.02])


def test_a_datagram_that_a_wrap_has_overtaken_is_of_the_time_before(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.03, SPAN_S - 0.02, SPAN_S + 0.01, SPAN_S - 0.01, SPAN_S + 0.02]
    assert times(_Whole(parser), *sent) == pytest.approx(sent)
