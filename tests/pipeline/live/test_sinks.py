"""Sinks on their own: Foxglove's messages, files on full disks, sinks that fail or are stuck."""

from __future__ import annotations

import json
import os
import socket
import stat
import threading
import time
from contextlib import suppress
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from streaming import PALM, connected, free_port, lines, published, running, slid
from taxelflow import load_sensor
from taxelflow.acquire.devices.base import Faults
from taxelflow.errors import AddressInvalid, PortTaken
from taxelflow.messages import cut
from taxelflow.numerics.geometry import rotation
from taxelflow.pipeline.live import workers
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.command import opened_sinks
from taxelflow.pipeline.live.latency import Latencies
from taxelflow.pipeline.live.loop import update_of
from taxelflow.pipeline.live.workers import Raw, SinkWorker
from taxelflow.publish.sinks.base import Ending, Head, ResultSink, Update
from taxelflow.publish.sinks.foxglove_messages import Drawing
from taxelflow.publish.sinks.json_topics import SCHEMAS
from taxelflow.publish.sinks.patient import PatientFile
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address

if TYPE_CHECKING:
    from pathlib import Path


def test_foxglove_gets_a_cloud_a_grid_per_pad_and_slips() -> None:
    from websockets.sync.client import connect

    port, fox = free_port(), free_port()
    with (
        running(f"tcp-listen://127.0.0.1:{port}", f"foxglove://127.0.0.1:{fox}"),
        connected(port) as device,
        connect(
            f"ws://127.0.0.1:{fox}",
            subprotocols=["foxglove.sdk.v1"],  # type: ignore[list-item]
            max_queue=None,  # else what is not read keeps it from closing for 10 s
            sock=connected(fox),  # it opens after the source
        ) as client,
    ):
        channels: dict[str, Any] = {}
        while len(channels) < 7:
            message = client.recv(timeout=5)
            if isinstance(message, str) and json.loads(message)["op"] == "advertise":
                channels |= {channel["topic"]: channel for channel in json.loads(message)["channels"]}
        wanted = [{"id": k, "channelId": channel["id"]} for k, channel in enumerate(channels.values())]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        threading.Event().wait(0.2)
        for line in lines(slid()):
            device.sendall(line)
            threading.Event().wait(0.002)
        device.shutdown(1)
        seen = set()
        while len(seen) < 6:
            content = client.recv(timeout=5)
            if isinstance(content, bytes):
                seen.add(content[1:5])  # the subscription
    assert set(channels) == {"/taxels", "/pads/pad0", "/arrows", *SCHEMAS}
    assert channels["/taxels"]["schemaName"] == "foxglove.PointCloud"
    assert channels["/object"]["schemaName"] == "taxelflow.Object"
    assert "vx_m_s" in json.loads(channels["/object"]["schema"])["properties"]


def test_pads_are_drawn_where_they_lie_in_the_hand() -> None:
    hand = load_sensor("barretthand-162")
    drawing = Drawing(hand)
    cloud, *grids = drawing.scan(1.0, np.arange(162.0))
    assert cloud.topic == "/taxels"
    assert [grid.topic for grid in grids] == [f"/pads/{name}" for name in hand.layout.pads[:7]]
    points = drawing._points
    assert np.isfinite(points).all()
    palm = hand.layout.of_pad(6)
    x, y, theta = hand.layout.T_hand[6]
    own = np.stack([hand.layout.x_m[palm], hand.layout.y_m[palm]])
    turned = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]) @ own + [[x], [y]]
    assert np.allclose(points[palm, :2], turned.T, atol=1e-6)


def test_a_number_beyond_any_sensor_is_drawn_as_no_load() -> None:
    drawing = Drawing(PALM)
    list(drawing.scan(1.0, np.resize([1e40, -1e40, np.inf, np.nan, 5.0], 28)))
    assert drawing._points[:5, 3].tolist() == [0.0, 0.0, 0.0, 0.0, 5.0]


class _Plain:
    """In place of foxglove's messages: fields as they were given."""

    def __getattr__(self, _name: str) -> Any:
        return SimpleNamespace


@pytest.mark.parametrize("name", ["barretthand-162", "barretthand-bh280-96", "hexagon-61", "icub-fingertip-12"])
def test_each_taxel_lies_in_the_cell_of_the_grid_that_has_its_reading(name: str) -> None:
    layout = load_sensor(name).layout
    drawing = Drawing(load_sensor(name))
    drawing._messages = _Plain()
    readings = np.arange(1.0, layout.taxels + 1)
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        grid = drawing._grid(pad, readings, None)
        turn = 2 * np.arctan2(grid.pose.orientation.z, grid.pose.orientation.w)
        corner = np.array([grid.pose.position.x, grid.pose.position.y])
        there = (drawing._points[own, :2] - corner) @ rotation(turn)
        col, row = np.floor(there / [grid.cell_size.x, grid.cell_size.y] + [1e-4, -1e-4]).astype(int).T
        cells = np.frombuffer(grid.data, np.float32).reshape(-1, grid.column_count)
        np.testing.assert_array_equal(cells[row, col], readings[own])


def test_a_file_goes_on_when_a_full_disk_has_room_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    file = PatientFile(tmp_path / "a", lambda kind, _seen: told.append(kind))
    room, write = [3], os.write

    def limited(descriptor: int, content: Any) -> int:
        if not room[0]:
            room[0] = 100
            raise OSError(28, "No space left on device")
        taken = min(room[0], len(content))
        room[0] -= taken
        return write(descriptor, content[:taken])

    monkeypatch.setattr(os, "write", limited)
    assert file.write(b"a whole line\n") == 13
    file.close()
    assert (tmp_path / "a").read_bytes() == b"a whole line\n"
    assert told == ["cannot write", "written again"]


@pytest.mark.parametrize("scheme", ["mcap", "tables"])
def test_a_disk_that_is_full_from_the_start_does_not_hold_up_the_run(
    scheme: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int, _content: Any) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("taxelflow.publish.sinks.patient.os.write", full)
    monkeypatch.setattr(PatientFile.__init__, "__defaults__", (0.2,))
    sink = registry.find("sink", scheme)(parse_address(f"{scheme}:{tmp_path / 'a.mcap'}"))
    head = Head(PALM, PALM.layout.pads, {"sensor": "x" * 100_000}, lambda _kind, _seen: None)
    opening = threading.Thread(target=sink.open, args=[head], daemon=True)
    opening.start()
    opening.join(10.0)
    assert not opening.is_alive()
    sink.hurry()
    with suppress(OSError):
        sink.close(Ending(None, (), failed=True))


@pytest.mark.parametrize(
    ("room", "scheme"), mostly_long(product([0, 30_000], ["mcap", "tables", "jsonl"]), (0, "tables"), (30_000, "mcap"))
)
def test_scans_for_which_a_file_has_no_room_are_dropped_and_not_published(
    scheme: str, room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left, write = [room], os.write

    def limited(descriptor: int, content: Any) -> int:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):  # a pipe between processes
            return write(descriptor, content)
        if not left[0]:
            raise OSError(28, "No space left on device")
        taken = min(left[0], len(content))
        left[0] -= taken
        return write(descriptor, content[:taken])

    monkeypatch.setattr("taxelflow.publish.sinks.patient.os.write", limited)
    monkeypatch.setattr("taxelflow.publish.sinks.patient._RETRY_S", 0.01)
    monkeypatch.setattr(PatientFile, "give_up", lambda file: setattr(file, "_deadline", 0.0))
    monkeypatch.setattr(workers, "_QUEUE", replace(workers._QUEUE, grace_s=0.1))
    with running("rig:stroke?speed=max", f"{scheme}:{tmp_path}/a.mcap") as reports:
        pass
    (worker,) = reports[0].workers
    assert worker.published + worker.dropped == 140
    if not room:
        assert worker.published == 0
    elif scheme == "jsonl":
        assert worker.published > 0
    if scheme != "mcap" or not room:  # its last chunk is known to be lost when it is closed, perhaps too late
        assert worker.published < 140
    if scheme == "tables":  # what is not whole does not stand under its final name
        assert {path.suffix for path in (tmp_path / "a.mcap").iterdir()} == {".part"}


def test_parquet_files_of_a_run_that_failed_stay_parts(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    sink, live = registry.find("sink", "parquet")(parse_address(f"parquet:{tmp_path}")), Live(PALM)
    sink.open(Head(PALM, live.pads, {}, Faults().report))
    sink.write(update_of(live.push(cut(slid(), 0, 20))))
    sink.close(Ending(None, (), failed=True))
    assert not list(tmp_path.glob("*.parquet"))
    assert parquet.read_table(tmp_path / "slips.parquet.part").num_rows == 20


def test_a_parquet_file_that_has_no_end_has_no_scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")

    def full(*_arguments: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(parquet.ParquetWriter, "write_table", full)
    (tmp_path / "slips.parquet").write_text("of an older run")
    with running("rig:stroke?speed=max", f"parquet:{tmp_path}") as reports:
        pass
    (worker,) = reports[0].workers
    assert (worker.published, worker.dropped) == (0, 140)
    (seen,) = [kind for kind in reports[0].source.faults.counts if kind.startswith("a sink")]
    assert seen in ("a sink has failed", "a sink cannot be closed")  # rows wait, but not for long
    assert {path.suffix for path in tmp_path.iterdir()} == {".part"}


class _Stuck(ResultSink):
    """Takes one update and never comes back, or fails."""

    lossless = True
    raw = True
    dropped = 0

    def __init__(self, *, fails: bool) -> None:
        self.fails, self.free = fails, threading.Event()

    def write_raw(self, _scans: Any, *, late: bool) -> None:
        if self.fails:
            raise RuntimeError("broken")
        self.free.wait()

    def hurry(self) -> None:
        self.free.set()

    def close(self, _ending: Ending) -> None:
        """Nothing is open."""


@pytest.mark.parametrize("fails", [True, False])
def test_a_sink_that_fails_or_is_stuck_holds_up_nobody(fails: bool) -> None:
    faults = Faults()
    worker = SinkWorker("a", _Stuck(fails=fails), faults)
    worker.start()
    began = time.monotonic()
    for _ in range(100):
        worker.offer(Raw(slid(1)))
    worker.give_room()
    assert time.monotonic() - began < 1.0
    worker.finish(Ending(None, ()))
    assert worker.ended
    assert worker.dropped + worker.published == 100
    assert faults.counts["a sink has failed"] == fails


@pytest.mark.parametrize("scheme", ["mcap", "jsonl"])
def test_each_scan_is_published_or_dropped_once_where_a_sink_fails(
    scheme: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = registry.find("sink", scheme)

    def failing(*_arguments: Any) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr(f"{sink.__module__}.{'McapSink' if scheme == 'mcap' else 'JsonFile'}.write", failing)
    with running(
        "rig:stroke?speed=max", f"{scheme}:{tmp_path}/a.mcap", f"jsonl-listen://127.0.0.1:{free_port()}"
    ) as reports:
        pass
    worker = reports[0].workers[0]
    assert reports[0].source.faults.counts["a sink has failed"] == 1
    assert worker.published + worker.dropped == 140


class _Taken(_Stuck):
    """Notes how many scans it is given at once."""

    gathers_s = 0.0

    def __init__(self) -> None:
        super().__init__(fails=False)
        self.given: list[tuple[int, bool]] = []
        self.came = threading.Event()

    def write_raw(self, scans: Any, *, late: bool) -> None:
        self.given.append((len(scans), late))
        self.came.set()
        self.free.wait()


def test_what_waits_for_a_sink_is_written_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_QUEUE", replace(workers._QUEUE, grace_s=0.1))
    sink = _Taken()
    worker = SinkWorker("a", sink, Faults())
    worker.start()
    worker.offer(Raw(slid(1)))
    worker.wake()
    assert sink.came.wait(20)
    for k in range(9):
        worker.offer(Raw(slid(1), late=k % 3 == 0))
    worker.finish(Ending(None, ()))
    assert sink.given == [(1, False), (6, False), (3, True)]
    assert worker.published == 10


def test_a_scan_that_a_stuck_sink_has_in_hand_is_dropped_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_QUEUE", replace(workers._QUEUE, grace_s=0.01))
    sink, faults = _Taken(), Faults()
    monkeypatch.setattr(sink, "hurry", lambda: None)
    worker = SinkWorker("a", sink, faults)
    worker.start()
    worker.offer(Raw(slid(5)))
    worker.wake()
    assert sink.came.wait(20)
    for _ in range(3):
        worker.offer(Raw(slid(1)))
    worker.finish(Ending(None, ()))
    assert worker.is_alive()
    assert faults.counts["a sink is stuck"] == 1
    assert (worker.published, worker.dropped) == (0, 8)
    sink.free.set()  # it comes back too late
    worker.join(20)
    assert (worker.published, worker.dropped) == (0, 8)


class _Gathering(_Stuck):
    """A file that is stuck when it writes what it has gathered."""

    gathers_s = 0.0
    unwritten = 0

    def __init__(self) -> None:
        super().__init__(fails=False)
        self.came = threading.Event()

    def write_raw(self, scans: Any, *, late: bool) -> None:
        self.unwritten += len(scans)

    def tick(self) -> None:
        if self.unwritten:
            self.came.set()
            self.free.wait()
            self.unwritten = 0


def test_what_a_stuck_file_has_gathered_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_QUEUE", replace(workers._QUEUE, grace_s=0.01))
    sink = _Gathering()
    monkeypatch.setattr(sink, "hurry", lambda: None)
    worker = SinkWorker("a", sink, Faults())
    worker.start()
    worker.offer(Raw(slid(5)))
    worker.wake()
    assert sink.came.wait(20)
    worker.offer(Raw(slid(1)))
    worker.finish(Ending(None, ()))
    assert (worker.published, worker.dropped) == (0, 6)
    sink.free.set()
    worker.join(20)


class _Lengths(ResultSink):
    """Notes how many scans each update has."""

    lossless = True
    dropped = 0

    def __init__(self, *, texts: bool) -> None:
        self.texts, self.given = texts, list[int]()

    def write(self, update: Update) -> None:
        self.given.append(len(update))

    def hurry(self) -> None:
        pass

    def close(self, _ending: Ending) -> None:
        pass


@pytest.mark.parametrize("texts", [False, True])
def test_results_are_joined_but_for_who_writes_their_texts(texts: bool) -> None:
    sink, live, scans = _Lengths(texts=texts), Live(PALM), slid()
    worker = SinkWorker("a", sink, Faults())
    for scan in range(30):
        if len(output := live.push(cut(scans, scan, scan + 1))):
            worker.offer(update_of(output))
    offered = [len(update) for update in worker._waiting if isinstance(update, Update)]
    worker.start()
    worker.finish(Ending(None, ()))
    assert sink.given == (offered if texts else [sum(offered)])
    assert len(offered) > 10


def test_a_named_pipe_without_a_reader_is_reported_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_QUEUE", replace(workers._QUEUE, grace_s=0.4))
    os.mkfifo(tmp_path / "pipe")
    with running("rig:stroke?speed=max", f"jsonl:{tmp_path}/pipe", f"jsonl:{tmp_path}/a.jsonl") as reports:
        pass
    assert len(published(tmp_path / "a.jsonl")) == 140
    assert reports[0].source.faults.counts["a sink is stuck"] == 1


@pytest.mark.parametrize("scheme", ["jsonl-listen", "foxglove"])
def test_a_port_that_does_not_exist_is_refused(scheme: str) -> None:
    with pytest.raises(AddressInvalid, match=f"cannot use '{scheme}://127.0.0.1:99999': Port out of range 0-65535"):
        opened_sinks((f"{scheme}://127.0.0.1:99999",))


@pytest.mark.parametrize("scheme", ["jsonl-listen", "foxglove"])
def test_a_port_that_is_taken_is_named(scheme: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        url = f"{scheme}://127.0.0.1:{other.getsockname()[1]}"
        sink = registry.find("sink", scheme)(parse_address(url))
        with pytest.raises(PortTaken, match=f"cannot open {url}: port [0-9]+ is taken by another program"):
            sink.open(Head(PALM, PALM.layout.pads, {}, Faults().report))


def test_latencies_are_within_a_bin() -> None:
    seen = Latencies()
    for ms in range(1, 101):
        seen.add(1e-3 * ms)
    assert seen.quantile_s(0.5) == pytest.approx(0.05, rel=0.06)
    assert seen.quantile_s(0.99) == pytest.approx(0.099, rel=0.06)
    assert seen.longest_s == 0.1
    assert sum(count for _, _, count in seen.decades()) == 100
    assert seen.words().startswith("p50")
    seen.add(1234.5)
    assert seen.words().endswith("max 1234500 ms")
    assert PALM.frame is None


@pytest.mark.parametrize("count", [0, 3, 500])
def test_latencies_of_several_scans_are_those_of_each(count: int) -> None:
    seconds = np.random.default_rng(0).lognormal(-6.0, 4.0, count)
    at_once, each = Latencies(), Latencies()
    at_once.add_all(seconds)
    for one in seconds.tolist():
        each.add(one)
    assert at_once.decades() == each.decades()
    assert at_once.longest_s == each.longest_s


def test_parquet_files_hold_the_rows_of_the_lines(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    port = free_port()
    with (
        running(f"tcp-listen://127.0.0.1:{port}", f"parquet:{tmp_path / 'tables'}", f"jsonl:{tmp_path / 'a.jsonl'}"),
        connected(port) as device,
    ):
        device.sendall(b"".join(lines(slid())))
    seen = published(tmp_path / "a.jsonl")
    slips = parquet.read_table(tmp_path / "tables" / "slips.parquet").to_pylist()
    assert [row["t_s"] for row in slips] == [line["t_s"] for line in seen]
    assert [row["slipping"] for row in slips] == [line["pads"]["pad0"]["slipping"] for line in seen]
    events = parquet.read_table(tmp_path / "tables" / "events.parquet").to_pylist()
    reported = [(event["event"], event["quality"]) for line in seen for event in line["events"]]
    assert [(row["event"], row["quality"]) for row in events] == reported
    assert reported[0] == ("contact", None)
