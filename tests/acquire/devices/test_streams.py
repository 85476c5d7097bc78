"""Sources of bytes: how they open, what they refuse, and who may send."""

from __future__ import annotations

import socket
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace

from costly import mostly_long
from streaming import PALM, SCANS, awaited, connected, free_port, lines, opened, published, running, slid
from taxelflow.acquire.devices import tcp
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.line import LineParser
from taxelflow.errors import AddressInvalid, PortTaken, SourceUnreachable
from taxelflow.messages import RawScans
from taxelflow.pipeline.live.loop import Limits
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address
from taxelflow.sensors.frame import Frame

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

FRAMED = replace(PALM, frame=Frame("AA55"), name="framed")


@pytest.mark.parametrize(("kind", "scheme"), [(socket.SOCK_STREAM, "tcp-listen"), (socket.SOCK_DGRAM, "udp-listen")])
def test_a_port_that_is_taken_is_named(kind: Any, scheme: str) -> None:
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            other.listen()
        port = other.getsockname()[1]
        says = f"port {port} is taken by another program; choose another port, or end that program"
        with pytest.raises(PortTaken, match=says):
            opened(f"{scheme}://127.0.0.1:{port}").__enter__()


@pytest.mark.parametrize("scheme", ["tcp", "tcp-listen", "udp-listen"])
def test_an_emulated_device_is_read_by_ipv6(scheme: str, tmp_path: Path) -> None:
    url = f"{scheme}://[::1]:{free_port()}"
    device = registry.find("emulator", scheme)(parse_address(url), PALM)
    if scheme == "tcp":
        device.__enter__()
    with running(url, f"jsonl:{tmp_path}/a.jsonl", limits=Limits(SCANS if scheme != "udp-listen" else 20)):
        if scheme != "tcp":
            device.__enter__()
        device.wait()
        for t_s, values in zip(slid().t_s.tolist(), slid().values, strict=True):
            awaited(lambda t_s=t_s, values=values: device.send(device.encode(t_s, values)))  # type: ignore[misc]
        device.__exit__()
    assert published(tmp_path / "a.jsonl")


def test_an_address_of_another_computer_is_refused_without_a_hint_to_wait() -> None:
    with pytest.raises(SourceUnreachable, match=r"192\.0\.2\.1:5000: .*; check the address$"):
        opened("tcp-listen://192.0.2.1:5000").__enter__()


@pytest.mark.parametrize("url", ["stdin:", "replay:{}/a.npz?speed=step"])
def test_standard_input_that_is_closed_is_refused(
    url: str, tmp_path: Path, stroke: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taxelflow import convert

    convert(stroke, tmp_path / "a.npz")
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(SourceUnreachable, match="standard input is closed"):
        opened(url.format(tmp_path)).__enter__()


@pytest.mark.parametrize(("unit", "per_s"), mostly_long([("s", 1.0), ("ms", 1e3), ("us", 1e6)], ("ms", 1e3)))
def test_lines_have_their_times_in_the_unit_that_is_given(unit: str, per_s: float, tmp_path: Path) -> None:
    scans, port = slid(), free_port()
    sent = RawScans(scans.t_s * per_s, scans.values)
    with (
        running(f"tcp-listen://127.0.0.1:{port}?time-unit={unit}", f"jsonl:{tmp_path}/a.jsonl") as reports,
        connected(port) as device,
    ):
        device.sendall(b"".join(lines(sent)))
    assert [row["t_s"] for row in published(tmp_path / "a.jsonl")] == pytest.approx(scans.t_s)
    assert not reports[0].source.faults.counts


@pytest.mark.parametrize(
    ("url", "sensor", "words"),
    [
        ("tcp://127.0.0.1:5?time-unit=min", PALM, "time-unit=s or ms or us or ns"),
        ("tcp://127.0.0.1:5?time-unit=ms", FRAMED, "for lines with a time only"),
        ("tcp://127.0.0.1:5?time-unit=ms&time=arrival", PALM, "for lines with a time only"),
        ("xela://127.0.0.1:5?time-unit=ms", PALM, "unknown option 'time-unit'"),
        ("udp-listen://127.0.0.1:5?keep=1", PALM, "unknown option 'keep'; give options: format, time, time-unit, tim"),
    ],
)
def test_a_unit_where_no_line_has_a_time_is_refused(url: str, sensor: Sensor, words: str) -> None:
    with pytest.raises(AddressInvalid, match=words):
        opened(url, sensor)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("dsa:/dev/x?rate=70000", "rate=70000; give rate=NUMBER, 1 to 65535"),
        ("dsa:/dev/x?crc=-1", "crc=-1; give crc=HEX"),
        ("dsa:/dev/x?crc=18408", "crc=18408; give crc=HEX"),
        ("ros2:/x?type=std_msgs/Float32MultiArray&domain=233", r"domain=233; give \?domain=NUMBER, 0 to 232"),
        ("ros2:/x?type=std_msgs/Float32MultiArray", "ROS_DOMAIN_ID is mine; give"),
    ],
)
def test_numbers_that_a_device_cannot_have_are_refused(url: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "mine")
    with pytest.raises(AddressInvalid, match=words):
        opened(url, PALM)


def test_a_client_that_is_silent_gives_way_to_another_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "_SILENT_S", 0.0)
    port, scans = free_port(), slid()
    limits = Limits(max_scans=SCANS, duration_s=20.0)
    with (
        running(f"tcp-listen://127.0.0.1:{port}", f"jsonl:{tmp_path}/a.jsonl", limits=limits) as reports,
        connected(port) as lost,
    ):
        lost.sendall(b"".join(lines(scans)[:30]))
        with connected(port) as device:
            device.sendall(b"".join(lines(scans)[30:]))
        awaited(lambda: reports != [])
    assert [row["t_s"] for row in published(tmp_path / "a.jsonl")] == scans.t_s.tolist()
    assert dict(reports[0].source.faults.counts) == {"connection lost": 1, "connected again": 1}


def test_a_client_that_sends_keeps_another_one_waiting(tmp_path: Path) -> None:
    port, scans = free_port(), slid()
    with (
        running(f"tcp-listen://127.0.0.1:{port}", f"jsonl:{tmp_path}/a.jsonl") as reports,
        connected(port) as first,
        connected(port) as other,
    ):
        other.sendall(b"".join(lines(scans)[:5]))
        first.sendall(b"".join(lines(scans)))
    assert len(published(tmp_path / "a.jsonl")) == SCANS
    assert not reports[0].source.faults.counts


def test_a_silence_is_one_loss_however_often_its_time_is_out(caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    with opened(f"udp-listen://127.0.0.1:{port}?timeout=0.01") as source:
        arrivals = iter(source)
        silence = time.monotonic() + 0.5
        while time.monotonic() < silence:
            assert next(arrivals) is None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
            device.sendto(lines(slid())[0], ("127.0.0.1", port))
        awaited(lambda: next(arrivals) is not None)
    assert dict(source.faults.counts) == {"connection lost": 1, "connected again": 1}
    assert [record.message.split(":")[0] for record in caplog.records[1:]] == ["connection lost", "connected again"]


def test_a_fault_that_comes_again_and_again_is_counted_and_logged_once_a_minute(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults, now = Faults(), [0.0]
    monkeypatch.setattr("taxelflow.acquire.devices.base.time.monotonic", lambda: now[0])
    for now[0] in (0.0, 1.0, 59.0, 60.0):
        faults.report("connection lost", "reset; connecting again")
        faults.report("cannot write", f"file {now[0]:.0f}")
    assert faults.counts["connection lost"] == 4
    assert sum("reset" in record.message for record in caplog.records) == 2
    assert sum("file" in record.message for record in caplog.records) == 4


def test_a_last_line_that_may_be_cut_in_its_last_number_is_no_scan(tmp_path: Path) -> None:
    scans, port = slid(), free_port()
    with (
        running(f"tcp-listen://127.0.0.1:{port}", f"jsonl:{tmp_path}/a.jsonl") as reports,
        connected(port) as device,
    ):
        device.sendall(b"".join(lines(scans))[:-3])  # the sender was killed; the count of numbers is right
    assert [row["t_s"] for row in published(tmp_path / "a.jsonl")] == scans.t_s.tolist()[:-1]
    assert dict(reports[0].source.faults.counts) == {"bad line": 1}


def test_the_last_line_of_standard_input_needs_no_newline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lines").write_bytes(b"".join(lines(slid()))[:-1])
    with (tmp_path / "lines").open() as given:
        monkeypatch.setattr(sys, "stdin", given)
        with running("stdin:", f"jsonl:{tmp_path}/a.jsonl") as reports:
            awaited(lambda: reports != [])
    assert len(published(tmp_path / "a.jsonl")) == SCANS
    assert not reports[0].source.faults.counts


@pytest.mark.parametrize("line", [b"0.5,1,2,\n", b"0.5, 1, 2, \r\n", b"0.5;1;2;\r", b"0.5,1,2\r", b"0.5\t1\t2\t\n"])
def test_lines_as_microcontrollers_print_them_are_read(line: bytes) -> None:
    faults = Faults()
    parser = LineParser(2, faults, timed=True)
    ((t_s, values),) = [scan for at in range(len(line)) for scan in parser.feed(line[at : at + 1])]
    assert (t_s, values.tolist(), dict(faults.counts)) == (0.5, [1.0, 2.0], {})


@pytest.mark.parametrize("columns", [1, 3])
def test_a_comma_after_the_last_reading_does_not_make_the_first_one_a_time(columns: int) -> None:
    faults = Faults()
    line = b"5," * columns + b"\n"
    assert LineParser(columns, faults, timed=True).feed(line) == []
    assert faults.counts["bad line"] == 1
    ((t_s, values),) = LineParser(columns, faults, timed=False).feed(line)
    assert (t_s, values.tolist()) == (None, [5.0] * columns)


@pytest.mark.parametrize("joins_late", [False, True])
def test_a_line_without_an_end_counts_once(joins_late: bool) -> None:
    faults = Faults()
    parser = LineParser(2, faults, timed=True, joins_late=joins_late)
    for _ in range(64):
        assert parser.feed(b"1," * 32768) == []
    assert faults.counts == {"bad line": 1}
    ((t_s, _),) = parser.feed(b"3\n1,2,3\n")
    assert (t_s, faults.counts) == (1.0, {"bad line": 1})
    parser.feed(b"1" * 2_000_000)
    assert faults.counts == {"bad line": 2}


@pytest.mark.parametrize("rest", [b"", b"  \r", b"# the end"])
def test_what_is_no_line_may_end_a_connection(rest: bytes) -> None:
    faults = Faults()
    parser = LineParser(2, faults, timed=True, ends_cut=True)
    assert len(parser.feed(b"1,2,3\n" + rest)) == 1
    assert parser.end() == []
    assert not faults.counts
