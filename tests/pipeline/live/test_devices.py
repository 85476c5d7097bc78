"""Devices with protocols of their own: what an emulated one sends arrives, faults are reported, parsers take all."""

from __future__ import annotations

import json
import logging
import math
import os
import re
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streaming import PALM, free_port, opened
from taxelflow import load_sensor
from taxelflow.acquire.devices.barrett import ASKED, CAN_FRAME, PUCKS, BarrettParser, frames_of
from taxelflow.acquire.devices.base import Faults, WholeMessages
from taxelflow.acquire.devices.dsa import DsaParser
from taxelflow.acquire.devices.frames import FrameParser
from taxelflow.acquire.devices.inspire import ModbusHand
from taxelflow.acquire.devices.line import LineParser, _plain, line_of
from taxelflow.acquire.devices.rosbridge import RosbridgeParser
from taxelflow.acquire.devices.xela import XelaParser
from taxelflow.acquire.ros.kinds import kind_of
from taxelflow.errors import AddressInvalid, TaxelCountWrong
from taxelflow.pipeline.live.emulators import streams
from taxelflow.pipeline.live.emulators.base import Fault, Playback
from taxelflow.pipeline.live.emulators.streams import Pty
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address
from taxelflow.sensors.frame import Frame

if TYPE_CHECKING:
    from taxelflow.messages import Floats

DEVICES = {
    "xela": ("xela://127.0.0.1:{port}", "xela-4x4@4.7mm"),
    "dsa": ("dsa:", "schunk-sdh2"),
    "barrett-can": ("barrett-can:{port}?interface=virtual&rate=400", "barretthand-bh280-96"),
    "inspire-modbus": ("inspire-modbus://127.0.0.1:{port}?rate=400", "inspire-rh56dftp@3mm"),
}
FULL = {"xela": 65535, "dsa": 4095, "barrett-can": 15, "inspire-modbus": 4095}
SCANS = 30


def sent_and_received(
    kind: str, faults: tuple[Fault, ...] = (), host: str = "127.0.0.1", options: str = ""
) -> tuple[Playback, Floats, list[Any], Any]:
    """The playback, what was to be sent, arrivals and the source of an emulated device."""
    form, name = DEVICES[kind]
    sensor = load_sensor(name)
    columns = sensor.channel_map.columns
    values = np.random.default_rng(0).integers(0, FULL[kind], (SCANS, columns)).astype(float)
    url = form.format(port=free_port()).replace("127.0.0.1", host)
    arrived: list[Any] = []
    done = threading.Event()

    def read(source: Any) -> None:
        for arrival in source:
            if arrival is not None:
                arrived.append(arrival)
            if done.is_set() and (arrival is None or kind == "inspire-modbus"):
                return

    with (
        registry.find("emulator", kind)(parse_address(url), sensor) as device,
        opened((url if kind in ("barrett-can", "inspire-modbus") else device.url) + options, sensor) as source,
    ):
        reader = threading.Thread(target=read, args=[source])
        reader.start()
        playback = Playback(device, faults, 1.0 if kind == "inspire-modbus" else 2.0)
        playback.run(zip((0.02 * np.arange(SCANS) + 1.0).tolist(), values, strict=True))
        done.set()
        reader.join(5)
    return playback, values, arrived, source


@pytest.mark.parametrize("kind", ["xela", "dsa", "barrett-can"])
def test_what_a_device_sends_arrives_exactly(kind: str) -> None:
    playback, values, arrived, source = sent_and_received(kind)
    assert playback.whole == SCANS
    assert np.array_equal([arrival.values for arrival in arrived], values)
    assert not source.faults.counts


def test_what_a_pseudo_terminal_was_sent_is_read_before_it_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    line, read = Pty(), list[bytes]()
    reader = os.open(line.path, os.O_RDONLY | os.O_NOCTTY)
    monkeypatch.setattr(streams.time, "sleep", lambda _s: read.append(os.read(reader, 100)))
    assert line.send(b"the last scan")
    line.close()
    os.close(reader)
    assert read == [b"the last scan"]


@pytest.mark.parametrize("kind", ["xela", "inspire-modbus"])
def test_a_device_may_have_an_ipv6_address(kind: str) -> None:
    _, _, arrived, source = sent_and_received(kind, host="[::1]")
    assert arrived
    assert not source.faults.counts


@pytest.mark.parametrize(
    ("kind", "fault", "named"),
    [
        ("xela", "half-frame", "bad message"),
        ("xela", "taxel-count", "bad message"),
        ("xela", "cable", "connection lost"),
        ("dsa", "half-frame", "wrong checksum"),
        ("dsa", "checksum", "wrong checksum"),
        ("dsa", "garbage", "garbage between frames"),
        ("dsa", "taxel-count", "bad frame"),
        ("barrett-can", "half-frame", "puck silent"),
    ],
)
def test_a_fault_of_a_device_is_reported(kind: str, fault: str, named: str, caplog: pytest.LogCaptureFixture) -> None:
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    playback, _, arrived, source = sent_and_received(kind, (Fault(fault, 0.2, 0.1),))
    assert source.faults.counts[named] >= 1
    assert sum(record.message.startswith(named) for record in caplog.records) == 1
    assert playback.whole - 3 <= len(arrived) <= playback.whole + 1


def test_all_registers_of_the_inspire_hand_are_read() -> None:
    _, values, arrived, _ = sent_and_received("inspire-modbus")
    seen = {tuple(row) for row in values.astype(int).tolist()}
    whole = [arrival for arrival in arrived if tuple(arrival.values.astype(int).tolist()) in seen]
    assert len(whole) >= 3  # a scan may change while its answers are read
    assert len(arrived[0].values) == 1062


def test_a_hand_of_fewer_readings_is_named_in_a_short_line(caplog: pytest.LogCaptureFixture) -> None:
    small, url = load_sensor("xela-4x4@4mm"), f"inspire-modbus://127.0.0.1:{free_port()}"
    with (
        registry.find("emulator", "inspire-modbus")(parse_address(url), small),
        opened(url, load_sensor("inspire-rh56dftp@3mm")) as source,
    ):
        for _ in zip(range(3), source, strict=False):
            pass
    assert "connection lost: the hand has 48 of 1062 readings; connecting again" in {
        record.message for record in caplog.records
    }


def test_the_inspire_hand_is_asked_for_one_pad_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    hand, asked = ModbusHand("127.0.0.1", free_port(), 1062, 50.0), []

    def read(address: int, *, count: int) -> SimpleNamespace:
        asked.append((address, count))
        return SimpleNamespace(registers=[0xFFFF] * count, isError=lambda: False)

    monkeypatch.setattr(hand._client, "read_holding_registers", read)
    assert hand.receive() == b"\xff\xff" * 1062
    assert asked[:4] == [(3000, 9), (3018, 96), (3210, 80), (3370, 9)]
    assert asked[12:] == [(4480, 9), (4498, 96), (4690, 9), (4708, 96), (4900, 112)]


def test_a_sensor_of_more_readings_than_the_inspire_hand_has_is_refused() -> None:
    with pytest.raises(TaxelCountWrong, match="the hand has 1062 taxels per scan but sensor 'grid:40x40@3mm' has 1600"):
        opened("inspire-modbus://127.0.0.1", load_sensor("grid:40x40@3mm"))


def test_a_sensor_of_fewer_readings_has_whole_pads_of_the_inspire_hand() -> None:
    opened("inspire-modbus://127.0.0.1", load_sensor("grid:3x3@3mm"))  # the first tip
    with pytest.raises(TaxelCountWrong, match="the hand has 1062 taxels per scan but sensor 'grid:6x6@3mm' has 36"):
        opened("inspire-modbus://127.0.0.1", load_sensor("grid:6x6@3mm"))


def test_a_sensor_that_is_not_the_barretthand_is_refused_before_anything_is_written() -> None:
    with pytest.raises(TaxelCountWrong, match="the hand has 96 taxels per scan but sensor 'grid:6x6@3mm' has 36"):
        opened("barrett-can:can0?interface=virtual", load_sensor("grid:6x6@3mm"))


@pytest.mark.parametrize(
    ("url", "needed"),
    [
        ("barrett-can:can0?interface=virtual", "36 readings, and the hand 96; give --from .* barretthand-bh280-96"),
        ("inspire-dds:", "1 pads, and the hand 17; give --from .* inspire-rh56dftp"),
    ],
)
def test_a_hand_is_emulated_from_its_own_recordings_only(url: str, needed: str) -> None:
    if url == "inspire-dds:":
        pytest.importorskip("cyclonedds")
    address = parse_address(url)
    with pytest.raises(AddressInvalid, match=f"a scan has {needed}"):
        registry.find("emulator", address.scheme)(address, load_sensor("grid:6x6@3mm"))


@pytest.mark.parametrize("kind", ["xela", "dsa"])
def test_the_time_of_arrival_replaces_the_clock_of_a_device(kind: str) -> None:
    _, values, arrived, _ = sent_and_received(kind, options="?time=arrival")
    assert [arrival.t_s for arrival in arrived] == [None] * SCANS
    assert np.array_equal([arrival.values for arrival in arrived], values)


@pytest.mark.parametrize(
    ("url", "name", "refused"),
    [
        ("xela://127.0.0.1?time=never", "xela-4x4@4.7mm", "time=never; give time=device or arrival"),
        ("xela://127.0.0.1?format=line", "xela-4x4@4.7mm", "unknown option 'format'"),
        ("dsa:/dev/ttyUSB0?time=never", "schunk-sdh2", "time=never; give time=device or arrival"),
        ("barrett-can:can0?time=device", "barretthand-bh280-96", "time=device; give time=arrival"),
        ("inspire-modbus://127.0.0.1?time=device", "inspire-rh56dftp@3mm", "time=device; give time=arrival"),
    ],
)
def test_an_option_that_a_device_does_not_have_is_refused(url: str, name: str, refused: str) -> None:
    with pytest.raises(AddressInvalid, match=refused):
        opened(url, load_sensor(name))


def test_the_modbus_library_says_nothing_of_its_own(caplog: pytest.LogCaptureFixture) -> None:
    hand = ModbusHand("127.0.0.1", free_port(), 1062, 50.0)
    with pytest.raises(ConnectionError, match="no Modbus server answers"):
        hand.open()
    assert not caplog.records
    logging.getLogger("pymodbus.logging").warning("of another client in this process")
    assert len(caplog.records) == 1


def test_a_puck_that_is_silent_leaves_its_readings_missing() -> None:
    faults = Faults()
    parser = BarrettParser(faults)
    two = b"".join(frames_of(puck, np.ones(24)) for puck in (11, 12))
    ((t_s, values),) = parser.feed(ASKED + two + ASKED)
    assert t_s is None
    assert np.isnan(values).sum() == 48
    assert faults.counts["puck silent"] == 1


@pytest.mark.parametrize(
    ("spoiled", "whole"),
    [
        (lambda frames: frames[:2] + frames[1:], True),  # one frame twice
        (lambda frames: frames[:10] + frames[5:], True),  # all of a puck twice
        (lambda frames: frames + frames[-5:], True),
        (lambda frames: frames[1:], False),
        (lambda frames: frames[5:], False),
    ],
)
def test_what_pucks_answer_to_two_requests_is_never_one_scan(spoiled: Any, whole: bool) -> None:
    def answers(number: float) -> bytes:
        return b"".join(frames_of(puck, np.full(24, number)) for puck in PUCKS)

    first = answers(1.0)
    frames = [first[at : at + CAN_FRAME.size] for at in range(0, len(first), CAN_FRAME.size)]
    parser = BarrettParser(Faults())
    pieces = [ASKED, *spoiled(frames), ASKED, answers(2.0), ASKED, answers(3.0)]
    scans = [values for piece in pieces for _, values in parser.feed(piece)]
    assert [set(values[np.isfinite(values)]) for values in scans] == [{1.0}, {2.0}, {3.0}]
    assert np.isfinite(scans[0]).all() == whole


PARSERS = {
    "line": lambda faults: LineParser(28, faults, timed=True),
    "frames": lambda faults: FrameParser(Frame("AA55", checksum="crc16-ccitt"), 28, faults, timed=True),
    "bare frames": lambda faults: FrameParser(Frame("AA"), 2, faults, timed=True),
    "dsa": lambda faults: DsaParser(PALM.layout, faults, 0x8408),
    "barrett": BarrettParser,
    "xela": lambda faults: WholeMessages(XelaParser(48, faults).feed),
}
PIECES = st.lists(
    st.one_of(
        st.binary(max_size=80),
        st.sampled_from([b"\xaa\xaa\xaa", b"\xaaU", b"1,2,3\n", b"nan,", b'{"1":{"data":"0","time":1}}', b"\n"]),
    ),
    max_size=30,
)


@pytest.mark.parametrize("name", PARSERS)
@given(pieces=PIECES)
def test_a_parser_takes_any_bytes_and_gives_whole_scans_only(name: str, pieces: list[bytes]) -> None:
    columns = {"line": 28, "frames": 28, "bare frames": 2, "dsa": 28, "barrett": 96, "xela": 48}[name]
    logging.disable()
    parser: Any = PARSERS[name](Faults())
    scans = [scan for piece in pieces for scan in parser.feed(piece)] + parser.end()
    logging.disable(logging.NOTSET)
    assert all(values.shape == (columns,) for _, values in scans)


TOUCH = kind_of("tactile_msgs/TactileState")
MESSAGES: dict[str, tuple[Any, Any]] = {
    "xela": (lambda faults: XelaParser(48, faults), {"1": {"time": 1.5, "data": ",".join(["00FF"] * 48)}}),
    "rosbridge": (
        lambda faults: RosbridgeParser(PALM, TOUCH, faults, timed=True),
        {
            "op": "publish",
            "msg": {"header": {"stamp": {"sec": 1, "nanosec": 2}}, "sensors": [{"name": "pad0", "values": [1.0] * 28}]},
        },
    ),
}
ODD = [b"null", b"[]", b"{}", b"true", b'"x"', b"-1", b"9" * 400, b'"%b"' % (b"F" * 400), b"[" * 3000, b"1e400", b","]


@pytest.mark.parametrize("name", MESSAGES)
@given(place=st.integers(0, 60), odd=st.sampled_from(ODD) | st.binary(max_size=8), upto=st.integers(1, 300))
def test_a_message_with_anything_in_it_is_a_scan_or_counted(name: str, place: int, odd: bytes, upto: int) -> None:
    make, message = MESSAGES[name]
    faults = Faults()
    parser = make(faults)
    whole = json.dumps(message).encode()
    tokens = list(re.finditer(rb'"[^"]*"|[0-9.]+|[][{},:]|FF', whole))
    token = tokens[place % len(tokens)]
    logging.disable()
    found = parser.feed(whole[: token.start()] + odd + whole[token.end() :]) + parser.feed(whole[:upto])
    logging.disable(logging.NOTSET)
    assert all(values.shape == (parser.feed(whole)[0][1].shape) for _, values in found)


@pytest.mark.parametrize(
    ("name", "was", "odd"),
    [
        ("xela", b"1.5", b"9" * 400),
        ("xela", b"00FF", b"F" * 400),
        ("xela", b"1.5", b"[" * 3000),
        ("rosbridge", b"1.0", b"9" * 400),
        ("rosbridge", b"1.0", b"[" * 3000),
    ],
)
def test_a_number_beyond_any_range_is_a_bad_message(name: str, was: bytes, odd: bytes) -> None:
    make, message = MESSAGES[name]
    faults = Faults()
    assert make(faults).feed(json.dumps(message).encode().replace(was, odd, 1)) == []
    assert faults.counts == {"bad message": 1}


@pytest.mark.parametrize(
    "line", ["0.1,1_0,2", "0.1,0x1,2", "0.1,1", "0.1,1,2,,", "nan,1,2", "0.1,\u0661,2", "0.1,1,2\0"]
)
def test_a_line_that_is_no_scan_is_counted(line: str) -> None:
    faults = Faults()
    parser = LineParser(2, faults, timed=True)
    assert parser.feed(line.encode() + b"\r\n") == []
    assert faults.counts["bad line"] == 1


@pytest.mark.parametrize(
    "line",
    [
        "0.1,1,2",
        "0.1;1;2",
        "0.1\t1\t2",
        " 0.1 1 2 ",
        "0.1, 1, 2\r",
        "\n\r\n# comment\n0.1,1,2",
        "\ufeff0.1,1,2",
        "\ufeff# x\n0.1,1,2",
    ],
)
def test_a_line_may_be_written_in_several_ways(line: str) -> None:
    faults = Faults()
    [(t_s, values)] = LineParser(2, faults, timed=True).feed(line.encode() + b"\n")
    assert (t_s, values.tolist()) == (0.1, [1.0, 2.0])
    assert not faults.counts


NUMBERS = [
    "1",
    "-0",
    "-0.5",
    "1e-05",
    "1e400",
    "+1",
    ".5",
    "5.",
    "00",
    " 3 ",
    "nan",
    "",
    "null",
    "[1]",
    "1_0",
    "4.9e-324",
]


@given(fields=st.lists(st.sampled_from(NUMBERS) | st.floats().map(repr), min_size=3, max_size=3))
def test_plain_lines_read_by_the_quick_way_have_the_same_bits(fields: list[str]) -> None:
    line = ",".join(["0.1", *fields]).encode()
    quick, plain = _plain(line), [float(field) if _is_number(field) else None for field in fields]
    if quick is not None:
        assert np.array(quick[1:]).tobytes() == np.array(plain, dtype=np.float64).tobytes()


def _is_number(field: str) -> bool:
    try:
        return math.isfinite(float(field)) and "_" not in field
    except ValueError:
        return False


def test_lines_as_devices_print_them_are_read_by_the_quick_way() -> None:
    assert _plain(b"12.5,1,-2.25,3e-3,512") == [12.5, 1.0, -2.25, 3e-3, 512.0]
    assert _plain(line_of(0.1, np.array([1.5, 0.1]))) == [0.1, 1.5, 0.1]
