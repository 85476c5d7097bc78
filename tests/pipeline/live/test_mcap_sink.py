"""MCAP files of runs and records, as other programs read them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from streaming import connected, free_port, lines, published, running, slid

if TYPE_CHECKING:
    from pathlib import Path


def test_rosbags_opens_a_run_without_pictures(tmp_path: Path) -> None:
    file, scans = tmp_path / "a.mcap", slid()
    sinks = [f"mcap:{file}?draw=0", f"jsonl:{tmp_path}/a.jsonl"]
    with running(f"tcp-listen://127.0.0.1:{(port := free_port())}", *sinks), connected(port) as device:
        device.sendall(b"".join(lines(scans)))
    found: dict[str, list[bytes]] = {}
    with AnyReader([file]) as reader:
        for connection, _, content in reader.messages():
            found.setdefault(connection.topic, []).append(content)
        sent = [reader.deserialize(content, "taxelflow_msgs/msg/Scan") for content in found["/scans"]]
    assert np.array_equal([one.values for one in sent], scans.values)  # type: ignore[attr-defined]
    rows = published(tmp_path / "a.jsonl")
    assert [json.loads(content)["pads"] for content in found["/slips"]] == [row["pads"] for row in rows]
    assert [json.loads(content) for content in found["/object"]] == [row["object"] for row in rows]
    assert [json.loads(content) for content in found["/events"]] == [event for row in rows for event in row["events"]]


def test_rosbags_opens_what_was_recorded(tmp_path: Path) -> None:
    file, scans, late = tmp_path / "a.mcap", slid(), lines(slid(3))
    source, sink = f"tcp-listen://127.0.0.1:{(port := free_port())}", f"mcap:{file}?draw=0"
    with running(source, sink, record=True), connected(port) as device:
        device.sendall(b"".join([*lines(scans), *late]))
    with AnyReader([file]) as reader:
        topics = [connection.topic for connection, _, _ in reader.messages()]
    assert (topics.count("/scans"), topics.count("/late")) == (len(scans), 3)


def test_pictures_are_thirty_a_second_at_most(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    file, scans = tmp_path / "a.mcap", slid()
    with running(f"tcp-listen://127.0.0.1:{(port := free_port())}", f"mcap:{file}"), connected(port) as device:
        device.sendall(b"".join(lines(scans)))
    times: dict[str, list[int]] = {}
    with file.open("rb") as content:
        for _, channel, message in make_reader(content).iter_messages(["/arrows", "/taxels"]):
            times.setdefault(channel.topic, []).append(message.log_time)
    assert set(times) == {"/arrows", "/taxels"}
    assert all(np.diff(own).min(initial=4e7) >= 1e9 / 30 for own in times.values())
