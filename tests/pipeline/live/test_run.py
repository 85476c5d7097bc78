"""The loop in one process: what comes in by each transport comes out of each sink, in order and whole."""

from __future__ import annotations

import dataclasses
import json
import os
import pty
import socket
import termios
import threading
import tty
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from msgspec.structs import replace

import taxelflow
from streaming import PALM, SCANS, connected, free_port, lines, opened, published, running, slid
from synthetic import grid_sensor
from taxelflow.errors import (
    ParameterInvalid,
    RecordingCorrupt,
    RunEnded,
    SourceUnreachable,
    TaxelCountWrong,
    TaxelflowError,
)
from taxelflow.messages import Output, RawScans, joined
from taxelflow.pipeline.live import workers
from taxelflow.pipeline.live.adoptions import asked_adoptions
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.command import opened_sinks
from taxelflow.pipeline.live.loop import Limits, run_live
from taxelflow.pipeline.live.replay import Replay
from taxelflow.pipeline.live.status import clock_words, drawn, totals
from taxelflow.publish.columns import EVENTS
from taxelflow.publish.sinks.patient import PatientFile

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.acquire.devices.base import Arrival
    from taxelflow.runtime.adoption import Adoption
    from taxelflow.sensors.sensor import Sensor


def streamed(scans: RawScans, adoptions: list[Adoption] | None = None) -> Output:
    live = Live(PALM, adoptions=adoptions)
    steps = [live.step(t, v) for t, v in zip(scans.t_s.tolist(), scans.values, strict=True)]
    return joined([*steps, live.finish()])


def test_scans_over_tcp_come_out_of_every_sink_and_the_mcap_reads_back_bit_equal(tmp_path: Path) -> None:
    scans, port = slid(), free_port()
    sinks = [f"tables:{tmp_path}/t", f"mcap:{tmp_path}/a.mcap", f"jsonl:{tmp_path}/a.jsonl"]
    with running(f"tcp-listen://127.0.0.1:{port}", *sinks) as reports, connected(port) as device:
        device.sendall(b"# a comment\n" + b"".join(lines(scans)) + b"1,2,3\nno,numbers\n")
    assert reports[0].intake.scans_in == SCANS
    assert dict(reports[0].source.faults.counts) == {"bad line": 2}
    rows = published(tmp_path / "a.jsonl")
    assert [row["t_s"] for row in rows] == scans.t_s.tolist()
    recording = taxelflow.read(tmp_path / "a.mcap")
    assert np.array_equal(recording.load().values, scans.values)
    assert recording.scans == SCANS  # the file is complete
    replayed = f"replay:{tmp_path}/a.mcap?speed=max&adoptions=recorded"
    expected = streamed(scans, asked_adoptions(replayed))
    pad_rows = [row["pads"]["pad0"] for row in rows[-10:]]
    assert [row["x_m"] for row in pad_rows] == expected.slips.pose[-10:, 0, 0].tolist()
    assert [row["std_x_m"] for row in pad_rows] == np.sqrt(expected.slips.covariance[-10:, 0, 0, 0]).tolist()
    assert (tmp_path / "t" / "slips.csv").read_text().count("\n") == SCANS + 1
    assert json.loads((tmp_path / "t" / "summary.json").read_text())["scans"] == SCANS
    assert sum(len(row["events"]) for row in rows) == len(expected.events)


def test_a_json_line_has_the_keys_of_the_contract(tmp_path: Path) -> None:
    scans = slid()
    simulated = taxelflow.Recording("made", "live", PALM, lambda: iter([scans]), scans=SCANS)
    taxelflow.convert(simulated, tmp_path / "a.npz")
    with running(f"replay:{tmp_path}/a.npz?speed=max", f"jsonl:{tmp_path}/a.jsonl"):
        pass
    row = published(tmp_path / "a.jsonl")[-1]
    assert list(row) == ["t_s", "age_ms", "pads", "object", "events"]
    pad = row["pads"]["pad0"]
    assert list(pad) == [
        "contact",
        *("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s", "std_x_m", "std_y_m"),
        "slipping",
        "quality",
    ]
    assert pad["contact"] is True
    assert pad["theta_rad"] is None
    assert row["age_ms"] > 0
    assert {"t_s", "vx_m_s", "rotor_1_s", "pads", "std_theta_rad"} <= set(row["object"])
    events = [event for found in published(tmp_path / "a.jsonl") for event in found["events"]]
    assert tuple(events[0]) == EVENTS


def test_datagrams_without_time_have_the_time_of_arrival(tmp_path: Path) -> None:
    port = free_port()
    limits = Limits(max_scans=30)
    with (
        running(f"udp-listen://127.0.0.1:{port}?time=arrival", f"jsonl:{tmp_path}/a.jsonl", limits=limits),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
    ):
        while not (tmp_path / "a.jsonl").exists():
            pass
        device.connect(("127.0.0.1", port))
        for line in lines(slid(60), timed=False):
            try:
                device.send(line)
            except ConnectionRefusedError:  # it does not listen yet, or has all it wants
                threading.Event().wait(0.01)
    times = [row["t_s"] for row in published(tmp_path / "a.jsonl")]
    assert len(times) == 30
    assert (np.diff(times) > 0).all()


def test_a_serial_line_is_read_from_a_pseudo_terminal(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    closed = termios.tcgetattr(slave)
    scans = slid()
    with running(f"serial:{os.ttyname(slave)}", f"jsonl:{tmp_path}/a.jsonl", limits=Limits(60, 20.0)):
        for _ in range(6000):
            if termios.tcgetattr(slave) != closed:  # pyserial sets the line when it opens
                break
            threading.Event().wait(0.01)
        threading.Event().wait(0.3)  # then it empties the buffer
        os.write(master, b"the rest of a line\n")
        for line in lines(scans):
            os.write(master, line)
    os.close(master)
    assert [row["t_s"] for row in published(tmp_path / "a.jsonl")] == scans.t_s[:60].tolist()


@pytest.mark.long
def test_a_client_of_the_json_server_gets_each_scan(tmp_path: Path) -> None:
    port, out = free_port(), free_port()
    with (
        running(f"tcp-listen://127.0.0.1:{port}", f"jsonl-listen://127.0.0.1:{out}"),
        connected(out) as client,
        connected(port) as device,
    ):
        threading.Event().wait(0.2)
        device.sendall(b"".join(lines(slid())))
        device.shutdown(socket.SHUT_WR)
        received = b"".join(iter(lambda: client.recv(1 << 16), b""))
    assert [json.loads(line)["t_s"] for line in received.splitlines()] == slid().t_s.tolist()


def test_a_time_that_cannot_be_costs_that_scan_only(tmp_path: Path) -> None:
    scans, port = slid(), free_port()
    wrong = [b"1e300,", b"-1e300,", b"1.7e12,"]
    sinks = [f"mcap:{tmp_path}/a.mcap", f"jsonl:{tmp_path}/a.jsonl"]
    with running(f"tcp-listen://127.0.0.1:{port}", *sinks) as reports, connected(port) as device:
        for place, line in enumerate(lines(scans)):
            device.sendall(line)
            if place % 20 == 10 and wrong:
                device.sendall(wrong.pop() + line.split(b",", 1)[1])
    assert dict(reports[0].source.faults.counts) == {"time out of range": 3}
    assert [row["t_s"] for row in published(tmp_path / "a.jsonl")] == scans.t_s.tolist()
    assert np.array_equal(taxelflow.read(tmp_path / "a.mcap").load().t_s, scans.t_s)


def test_a_number_beyond_any_sensors_is_reported_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    scans, port = slid(), free_port()
    scans.values[30:33, 5] = 1e300
    scans.values[40, 5] = np.inf
    with running(f"tcp-listen://127.0.0.1:{port}", f"jsonl:{tmp_path}/a.jsonl") as reports, connected(port) as device:
        device.sendall(b"".join(lines(scans)))
    assert dict(reports[0].source.faults.counts) == {"absurd number": 3}
    said = [record.message for record in caplog.records if "absurd" in record.message]
    assert said == ["absurd number: 1e+300: numbers beyond 1e+30 are taken as missing readings"]


@pytest.mark.long
def test_the_results_in_an_mcap_file_are_those_of_the_lines(tmp_path: Path) -> None:
    port = free_port()
    sinks = [f"mcap:{tmp_path}/a.mcap?draw=0", f"jsonl:{tmp_path}/a.jsonl"]
    with running(f"tcp-listen://127.0.0.1:{port}", *sinks), connected(port) as device:
        device.sendall(b"".join(lines(slid())))
    found: dict[str, list[Any]] = {"/slips": [], "/object": []}
    with (tmp_path / "a.mcap").open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=list(found)):
            found[channel.topic].append(json.loads(message.data))
    rows = published(tmp_path / "a.jsonl")
    assert [row["pads"] for row in found["/slips"]] == [row["pads"] for row in rows]
    assert found["/object"] == [row["object"] for row in rows]


def test_a_file_of_ours_without_scans_is_refused_as_empty(tmp_path: Path) -> None:
    with running(f"tcp-listen://127.0.0.1:{(port := free_port())}", f"mcap:{tmp_path}/a.mcap"), connected(port):
        pass
    with pytest.raises(TaxelflowError, match="not damaged, but topic /scans holds no messages"):
        taxelflow.read(tmp_path / "a.mcap")


def test_a_lost_connection_is_made_again_and_the_gap_is_reported(tmp_path: Path, caplog: Any) -> None:
    scans = slid()
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with running(f"tcp://127.0.0.1:{port}", f"jsonl:{tmp_path}/a.jsonl") as reports:
            device, _ = server.accept()
            device.sendall(b"".join(lines(scans)[:40]) + b"0.41,1,2")
            threading.Event().wait(0.3)
            device.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            device.close()  # a reset
            device, _ = server.accept()
            device.sendall(b"".join(lines(scans)[50:]))
            device.close()
    assert [row["t_s"] for row in published(tmp_path / "a.jsonl")] == [*scans.t_s[:40], *scans.t_s[50:]]
    assert reports[0].intake.timeline.gaps == 1
    assert [record.message for record in caplog.records if "connection lost" in record.message]


@pytest.mark.long
def test_a_second_client_is_waited_for_if_asked(tmp_path: Path) -> None:
    port, scans = free_port(), slid()
    limits = Limits(max_scans=SCANS)
    with running(f"tcp-listen://127.0.0.1:{port}?keep=1", f"jsonl:{tmp_path}/a.jsonl", limits=limits):
        for part in (slice(0, 30), slice(30, SCANS)):
            with connected(port) as device:
                device.sendall(b"".join(lines(scans)[part]))
    assert len(published(tmp_path / "a.jsonl")) == SCANS


def test_a_full_disk_is_reported_once_and_holds_up_no_other_sink(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        workers, "_QUEUE", dataclasses.replace(workers._QUEUE, grace_s=0.7)
    )  # longer than the file goes on trying
    monkeypatch.setattr(PatientFile.__init__, "__defaults__", (0.1,))
    with running("rig:stroke?speed=max", "jsonl:/dev/full", f"jsonl:{tmp_path}/a.jsonl") as reports:
        pass
    assert len(published(tmp_path / "a.jsonl")) == 140
    assert reports[0].source.faults.counts["cannot write"] == 1
    assert [(worker.published, worker.dropped) for worker in reports[0].workers] == [(0, 140), (140, 0)]


@pytest.mark.long
def test_a_client_that_does_not_read_misses_lines_and_holds_up_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("taxelflow.publish.sinks.jsonl._MOST_WAITING", 0)  # no room at all, beyond the system's
    port, out = free_port(), free_port()
    sinks = [f"jsonl-listen://127.0.0.1:{out}", f"jsonl:{tmp_path}/a.jsonl"]
    with running(f"tcp-listen://127.0.0.1:{port}", *sinks) as reports, connected(out):
        threading.Event().wait(0.2)
        with connected(port) as device:
            device.sendall(b"".join(lines(slid())))
    assert len(published(tmp_path / "a.jsonl")) == SCANS
    assert reports[0].workers[0].dropped == SCANS
    assert reports[0].source.faults.counts["a client does not read"] == 1


def test_record_keeps_scans_and_what_came_too_late(tmp_path: Path) -> None:
    port, scans = free_port(), slid()
    sent = lines(scans)
    sent[30], sent[31] = sent[31], sent[30]
    with running(f"tcp-listen://127.0.0.1:{port}", f"mcap:{tmp_path}/a.mcap", record=True), connected(port) as device:
        device.sendall(b"".join(sent))
    assert taxelflow.read(tmp_path / "a.mcap").load().t_s.tolist() == np.delete(scans.t_s, 30).tolist()
    from mcap.reader import make_reader

    with (tmp_path / "a.mcap").open("rb") as file:
        found = list(make_reader(file).iter_messages(topics=["/late"]))
    assert json.loads(found[0][2].data)["t_s"] == scans.t_s[30]


def test_live_gives_results_at_once_and_survives_its_clock() -> None:
    scans = slid()
    whole = streamed(scans)
    live = Live(PALM)
    out = [live.step(t, v) for t, v in zip(scans.t_s.tolist(), scans.values, strict=True)]
    assert [len(one) for one in out] == [0] * 11 + [12] + [1] * (SCANS - 12)
    assert np.array_equal(out[-1].slips.pose, whole.slips.pose[-1:], equal_nan=True)
    assert len(live.step(scans.t_s[-1], scans.values[-1])) == 0  # repeated
    assert len(live.step(scans.t_s[-5], scans.values[-1])) == 0  # late
    assert len(live.step(-500.0, scans.values[-1] + 1)) == 1  # the device has started again
    assert live.faults == {"scan repeated": 1, "scan late": 1, "clock jumped": 1}


def test_an_image_in_a_loop_is_what_the_sensor_sent() -> None:
    scans, inverted = slid(30), replace(PALM, offset=9e5, polarity=-1)
    flat, image = Live(inverted), Live(inverted)
    for t_s, values in zip(scans.t_s.tolist(), 9e5 - scans.values, strict=True):
        one, other = flat.step(t_s, values), image.step(t_s, values.reshape(4, 7))
    assert one.slips.contact.any()
    np.testing.assert_array_equal(other.slips.load, one.slips.load)


def test_a_masked_reading_is_missing_in_a_loop() -> None:
    scans, masked, missing = slid(30), Live(PALM), Live(PALM)
    for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True):
        out = masked.step(t_s, np.ma.masked_array(values, mask=np.arange(28) == 14))
        same = missing.step(t_s, np.where(np.arange(28) == 14, np.nan, values))
    np.testing.assert_array_equal(out.slips.pose, same.slips.pose)
    np.testing.assert_array_equal(out.slips.load, same.slips.load)


@pytest.mark.parametrize("sensor", [None, 3])
def test_live_needs_a_sensor(sensor: Any) -> None:
    with pytest.raises(ParameterInvalid, match="sensor must be a name, a TOML file, a Sensor or a Recording"):
        Live(sensor)


def test_live_refuses_what_are_no_adoptions() -> None:
    with pytest.raises(ParameterInvalid, match="adoptions must be those that `adopted` of a former loop gave"):
        Live(PALM, adoptions="x")  # type: ignore[arg-type]


@pytest.mark.parametrize("order", ["row-major", "column-major"])
@pytest.mark.parametrize("memory", ["C", "F"])
def test_live_takes_a_scan_as_the_image_of_a_full_grid(order: str, memory: Any) -> None:
    pad = replace(PALM.pads[0], order=order, first="bottom-right")
    sensor, scans = replace(PALM, pads=(pad,)), slid()
    sent = sensor.channel_map.to_source(scans.values)
    flat, grid = Live(sensor, adoptions=[]), Live(sensor, adoptions=[])
    for t_s, columns, readings in zip(scans.t_s.tolist(), sent, scans.values, strict=True):
        image = np.asarray(readings.reshape(pad.rows, pad.cols), order=memory)
        one, other = flat.step(t_s, columns), grid.step(t_s, image)
    assert np.isfinite(one.slips.pose[-1, 0, 0])
    assert np.array_equal(one.slips.pose, other.slips.pose, equal_nan=True)


@pytest.mark.parametrize(
    ("sensor", "shape", "says"),
    [
        (PALM, (7, 4), r"cannot read the scan: it has shape \(7, 4\); give \(28,\), or \(4, 7\)$"),
        (PALM, (1, 4, 7), r"it has shape \(1, 4, 7\); give \(28,\), or \(4, 7\)$"),
        (PALM, (), r"it has shape \(\); give \(28,\), or \(4, 7\)$"),
        (grid_sensor(4, 7, pads=2), (4, 7), r"it has shape \(4, 7\); give \(56,\)$"),
        (grid_sensor(4, 7, missing=((0, 0),)), (4, 7), r"it has shape \(4, 7\); give \(27,\)$"),
        (grid_sensor(2, 3, axes=3, normal="z"), (3, 2), r"give \(18,\), or \(2, 3\), or \(2, 3, 3\)$"),
    ],
    ids=["transposed", "block", "number", "two pads", "gap", "three axes"],
)
def test_live_refuses_an_image_that_is_no_full_grid(sensor: Sensor, shape: tuple[int, ...], says: str) -> None:
    with pytest.raises(RecordingCorrupt, match=says):
        Live(sensor, adoptions=[]).step(0.0, np.zeros(shape))


def test_live_takes_no_scan_after_its_end() -> None:
    scans = slid()
    live = Live(PALM)
    for t, v in zip(scans.t_s[:40].tolist(), scans.values[:40], strict=True):
        live.step(t, v)
    live.finish()
    again = [
        lambda: live.step(float(scans.t_s[40]), scans.values[40]),
        lambda: live.step(float(scans.t_s[3]), scans.values[3]),
        lambda: live.push(RawScans(scans.t_s[41:42], scans.values[41:42])),
        live.finish,
    ]
    for call in again:
        with pytest.raises(RunEnded, match="make a new Live"):
            call()


def test_live_refuses_a_scan_of_another_size() -> None:
    with pytest.raises(TaxelCountWrong, match="the scan has 2 taxels per scan but sensor 'grid' has 28"):
        Live(PALM).step(0.0, [1.0, 2.0])
    with pytest.raises(TaxelCountWrong, match="a block has 2 taxels per scan"):
        Live(PALM).push(RawScans(np.zeros(1), np.zeros((1, 2))))
    for times, shape in ((1, (28,)), (2, (1, 28))):
        with pytest.raises(RecordingCorrupt, match=r"t_s has shape \(.,\), values \(.*; give t_s \(scans,\)"):
            Live(PALM).push(RawScans(np.zeros(times), np.zeros(shape)))


@pytest.mark.parametrize(
    ("times", "seen"),
    [
        ([0.1], "scan 0 is at 0.100000 s after 0.390000 s"),
        ([0.39], "scan 0 is at 0.390000 s after 0.390000 s"),
        ([float("nan")], "scan 0 is at nan s"),
        ([float("inf")], "scan 0 is at inf s"),
        ([0.5, 0.4], "scan 1 is at 0.400000 s after 0.500000 s"),
    ],
)
def test_live_refuses_a_block_whose_times_do_not_increase(times: list[float], seen: str) -> None:
    """A scan in the past gives velocities of wrong sign, and one without a time ends all windows."""
    live, scans = Live(PALM), slid()
    live.push(RawScans(0.01 * np.arange(40), scans.values[:40]))
    with pytest.raises(RecordingCorrupt, match=f"cannot read a block: {seen}.*; give times in s that increase, or use"):
        live.push(RawScans(np.array(times), scans.values[: len(times)]))
    assert len(live.push(RawScans(np.array([0.4]), scans.values[40:41]))) == 1


def test_live_counts_a_scan_without_a_time() -> None:
    live = Live(PALM, adoptions=[])
    for t_s in (0.0, float("nan"), float("inf")):
        assert len(live.step(t_s, np.zeros(28))) == 0
    assert live.faults == {"time out of range": 2}


@pytest.mark.parametrize(("t_s", "values"), [("now", [0.0] * 28), (None, [0.0] * 28), (0.0, "text"), (0.0, [{}] * 28)])
def test_live_refuses_what_is_no_scan(t_s: Any, values: Any) -> None:
    with pytest.raises(RecordingCorrupt, match=r"the scan: not numbers: .*; give t_s in s, and an array of numbers"):
        Live(PALM).step(t_s, values)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("tcp:5000", "no host and port"),
        ("tcp://127.0.0.1:99999", "0-65535"),
        ("nothing", "no scheme"),
        ("tcp://127.0.0.1:5?tim=arrival", "unknown option 'tim'"),
        ("replay:grasp?1.npz?speed=max", r"unknown option '1.npz\?speed'; .*speed, topic; \? in a path is written %3F"),
        ("tcp://127.0.0.1:5?time=arrival&time=device", "option 'time' is given twice; give each option once"),
        ("tcp://127.0.0.1:5?time=soon", "time=device or arrival"),
        ("serial:", "no path"),
        ("rig:nowhere", "known are stroke"),
        ("replay:a.npz?speed=-1", "does not exist"),
        ("serial:/dev/ttyUSB0?baud=inf", "baud=NUMBER"),
        ("rig:stroke?speed=fast", "give speed=NUMBER above 0, speed=max or speed=step"),
        ("rig:stroke?speed=inf", "give speed=NUMBER above 0, speed=max or speed=step"),
        ("rig:stroke?seed=1.5", "without fraction"),
        ("rig:stroke?seed=", "seed=NUMBER"),
    ],
)
def test_a_malformed_source_is_refused(url: str, words: str) -> None:
    with pytest.raises(TaxelflowError, match=words):
        opened(url)


def test_a_run_whose_source_does_not_open_leaves_older_files_as_they_are(tmp_path: Path) -> None:
    url = f"tcp://127.0.0.1:{free_port()}?wait=0"
    (tmp_path / "a.mcap").write_text("an older run")
    sinks = [f"tables:{tmp_path}/t", f"mcap:{tmp_path}/a.mcap"]
    with pytest.raises(SourceUnreachable, match="Connection refused"), running(url, *sinks):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    assert (tmp_path / "a.mcap").read_text() == "an older run"


class Broken(Replay):
    """A source that fails in a way of its own."""

    def __iter__(self) -> Iterator[Arrival | None]:
        yield from super().__iter__()
        raise ZeroDivisionError("a driver's own error")


def test_rows_of_a_run_whose_source_fails_stay_in_part_files_and_its_error_is_raised(tmp_path: Path) -> None:
    scans = slid()
    source = Broken(taxelflow.Recording("made", "live", PALM, lambda: iter([scans]), scans=SCANS), 0.0)
    sinks = opened_sinks((f"tables:{tmp_path}/t",))
    with pytest.raises(ZeroDivisionError, match="a driver's own error"):
        run_live(source, sinks, Live(source.recording), Limits())
    assert {path.suffix for path in (tmp_path / "t").iterdir()} == {".part"}
    assert (tmp_path / "t" / "slips.csv.part").read_text().count("\n") > SCANS / 2


@pytest.mark.parametrize("rate_hz", [1.0, 0.6])
def test_a_slow_recording_that_is_replayed_at_once_is_not_doubted(rate_hz: float) -> None:
    scans = slid()
    slow = RawScans(scans.t_s / (0.01 * rate_hz), scans.values)
    source = Replay(taxelflow.Recording("made", "live", PALM, lambda: iter([slow]), scans=SCANS), 0.0)
    report = run_live(source, {}, Live(source.recording), Limits())
    assert report.intake.scans_in == SCANS
    assert report.intake.timeline.notes == []
    assert source.faults.counts == {}


def test_a_replay_reports_times_that_are_likely_in_ms(caplog: pytest.LogCaptureFixture) -> None:
    scans = slid()
    in_ms = RawScans(1000.0 * scans.t_s, scans.values)
    source = Replay(taxelflow.Recording("made", "live", PALM, lambda: iter([in_ms]), scans=SCANS), 0.0)
    run_live(source, {}, Live(source.recording), Limits())
    assert source.faults.counts == {"recording doubted": 1}
    assert "the times are likely in ms" in caplog.text


@pytest.mark.parametrize("passed_s", [0.0, 0.5])
def test_no_motion_is_followed_across_a_clock_that_is_set_back(
    passed_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans, now_s = slid(), [1000.0]
    monkeypatch.setattr("taxelflow.pipeline.live.api.time.monotonic", lambda: now_s[0])
    live, steps = Live(PALM, adoptions=[]), []
    for number, (t_s, values) in enumerate(zip(scans.t_s.tolist(), scans.values, strict=True)):
        now_s[0] += passed_s if number == 50 else 0.0  # else as in one piece of bytes
        steps.append(live.step(t_s - 1000.0 * (number >= 50), values))
    slips = joined([*steps, live.finish()]).slips
    assert live.faults == {"clock jumped": 1}
    assert live.run.counts.gaps == 1
    assert slips.t_s[50] - slips.t_s[49] == pytest.approx(max(passed_s, 0.04))
    assert np.isnan(slips.velocity[50, 0, 0])
    assert np.isnan(slips.displacement[50, 0, 0])
    assert np.nanmax(np.abs(slips.velocity[30:, 0, 0])) < 0.2  # the dome slides at 0.05 m/s


@pytest.mark.long
def test_status_and_totals_of_a_run(tmp_path: Path) -> None:
    with running("rig:stroke?speed=max", f"jsonl:{tmp_path}/a.jsonl") as reports:
        pass
    said = totals(reports[0])
    assert said[0] == "scans in: 140"
    assert f"published: jsonl:{tmp_path}/a.jsonl 140" in said
    from rich.console import Console

    with (tmp_path / "screen").open("w") as file:
        Console(file=file, width=160).print(drawn(reports[0], 7.0))
    screen = (tmp_path / "screen").read_text()
    assert "140 scans, 7.0 Hz" in screen
    assert "palm" in screen


def test_the_totals_count_scans_that_repeat_the_one_before(tmp_path: Path) -> None:
    scans, port = slid(), free_port()
    again = RawScans(0.01 * np.arange(1, 3 * SCANS + 1), np.repeat(scans.values, 3, axis=0))
    with running(f"tcp-listen://127.0.0.1:{port}", f"jsonl:{tmp_path}/a.jsonl") as reports, connected(port) as device:
        device.sendall(b"".join(lines(again)))
    rows = len(published(tmp_path / "a.jsonl"))
    assert rows < 3 * SCANS
    assert f"repeated: {3 * SCANS - rows} (bit for bit the scan before)" in totals(reports[0])


@pytest.mark.parametrize(
    ("offset_s", "drift_ppm", "words"),
    [
        (0.25, 3.04, "0.250000 s behind the computer's, 3.0 ppm slow against it"),
        (-0.25, -3.04, "0.250000 s ahead of the computer's, 3.0 ppm fast against it"),
        (1e6, float("nan"), "counts from a time of its own"),
    ],
)
def test_a_clock_is_ahead_or_behind_and_never_negative(offset_s: float, drift_ppm: float, words: str) -> None:
    assert clock_words(offset_s, drift_ppm) == f"sensor's clock: {words}"
