"""The clocks of devices: they wrap, are set back, and go on while a connection is lost."""

from __future__ import annotations

import struct

import pytest

from streaming import PALM
from taxelflow.acquire.devices.base import Arrival, Faults, Parser
from taxelflow.acquire.devices.dsa import POLYNOMIAL, DsaParser, Message, cells_of
from taxelflow.acquire.devices.dsa import frame as dsa_frame
from taxelflow.acquire.devices.frames import FrameParser, crc_table
from taxelflow.acquire.devices.line import LineParser
from taxelflow.acquire.devices.timeline import Timeline
from taxelflow.acquire.devices.udp import whole
from taxelflow.sensors.frame import Frame

SPAN_S = 2.0**32 * 1e-6
FRAME = Frame("AA55", type="uint16", time="uint32_us", checksum="none")


def frame(t_s: float) -> bytes:
    return b"\xaa\x55" + struct.pack("<IH", round(t_s * 1e6) % 2**32, 7)


def times(parser: Parser, *t_s: float) -> list[float]:
    return [found for t in t_s for found, _ in parser.feed(frame(t)) if found is not None]


@pytest.fixture
def parser() -> FrameParser:
    return FrameParser(FRAME, 1, Faults(), timed=True)


def test_times_in_us_are_the_numbers_that_times_in_s_are_read_as(parser: FrameParser) -> None:
    sent = [k / 100 for k in range(800)]
    assert times(parser, *sent) == sent
    lines = LineParser(1, Faults(), timed=True, per_second=1e3)
    assert [t_s for k in range(800) for t_s, _ in lines.feed(f"{10 * k},7\n".encode())] == sent


def test_a_clock_that_wraps_goes_on(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.02, SPAN_S - 0.01, SPAN_S + 0.01, 1.5 * SPAN_S, 1.95 * SPAN_S, 2.01 * SPAN_S]
    assert times(parser, *sent) == pytest.approx(sent)


def test_a_clock_that_wraps_between_datagrams_goes_on(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.01, SPAN_S + 0.01, SPAN_S + 0.02]
    assert times(whole(parser), *sent) == pytest.approx(sent)


def test_a_clock_that_wraps_while_the_connection_is_lost_goes_on(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.01, SPAN_S + 5.0]
    before = times(parser, sent[0])
    parser.restart()
    assert [*before, *times(parser, sent[1])] == pytest.approx(sent)


def test_a_device_that_starts_again_has_not_wrapped(parser: FrameParser) -> None:
    assert times(parser, 3002.0, 0.01, 0.02) == pytest.approx([3002.0, 0.01, 0.02])


def test_a_datagram_that_a_wrap_has_overtaken_is_of_the_time_before(parser: FrameParser) -> None:
    sent = [SPAN_S - 0.03, SPAN_S - 0.02, SPAN_S + 0.01, SPAN_S - 0.01, SPAN_S + 0.02]
    assert times(whole(parser), *sent) == pytest.approx(sent)


def test_a_run_of_50_days_of_the_dsa_goes_on_without_a_gap() -> None:
    faults = Faults()
    parser, timeline = DsaParser(PALM.layout, faults, int(POLYNOMIAL, 16)), Timeline(faults)
    table, cells = crc_table(int(POLYNOMIAL, 16)), cells_of(PALM.layout)[1]
    for scan in range(20):
        payload = struct.pack("<IB", (2**32 - 300 + 33 * scan) % 2**32, 0) + bytes(2 * cells)
        [(t_s, values)] = parser.feed(dsa_frame(Message.SCAN, payload, table))
        assert timeline.place(Arrival(0.033 * scan, t_s, values)) == pytest.approx(4294966.996 + 0.033 * scan)
    assert not faults.counts
    assert not timeline.gaps


def test_a_reading_that_is_a_signalling_nan_is_missing() -> None:
    parser = FrameParser(Frame("AA55", type="float32", time="none", checksum="none"), 2, Faults(), timed=False)
    [(_, values)] = parser.feed(bytes.fromhex("AA55 0000A07F 0000803F"))
    assert values.tolist() == pytest.approx([float("nan"), 1.0], nan_ok=True)
