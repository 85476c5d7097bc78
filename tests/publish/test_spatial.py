from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from mcap.reader import make_reader

from taxelflow.fusion.parameters import RigidField
from taxelflow.fusion.session import nothing
from taxelflow.messages import Output, SpatialMotions
from taxelflow.pipeline.live.mcap_sink import McapSink
from taxelflow.pipeline.live.ros2_sink import Ros2Types
from taxelflow.publish.parquet import ParquetTables
from taxelflow.publish.sinks.base import Ending, Head, Update
from taxelflow.publish.sinks.lines import json_lines
from taxelflow.publish.spatial import COLUMNS, in_words
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor


def blind(*rows: tuple[float, ...]) -> np.ndarray:
    return np.vstack([*rows, *np.zeros((6 - len(rows), 6))])


def test_nothing_unobservable_needs_no_words() -> None:
    assert in_words(np.zeros((6, 6))) == []


def test_a_translation_and_a_turn_are_named() -> None:
    assert in_words(blind((0, 0, -2, 0, 0, 0))) == ["translation along (0.00, 0.00, 1.00)"]
    turn = (*np.cross([0, 0, 1], [-0.02, -0.03, 0.0]), 0, 0, 1)  # v at the origin of a turn about (20, 30, 0) mm
    assert in_words(blind(turn)) == ["turn about (0.00, 0.00, 1.00) through (20, 30, 0) mm"]


def test_a_basis_is_separated_into_translations_and_turns() -> None:
    mixed = ((0, 0, 1, 0, 0, 1), (0, 0, 1, 0, 0, -1))
    assert in_words(blind(*mixed)) == [
        "translation along (0.00, 0.00, 1.00)",
        "turn about (0.00, 0.00, 1.00) through (0, 0, 0) mm",
    ]


def test_a_screw_advances() -> None:
    assert in_words(blind((0, 0, 0.1, 0, 0, 1))) == [
        "turn about (0.00, 0.00, 1.00) through (0, 0, 0) mm, advancing 100 mm/rad"
    ]


PADS = ("left", "right")


def motions() -> SpatialMotions:
    """Of three scans: nothing seen, no turn about z seen, all seen and a pad blamed."""
    twist, pose = np.arange(18.0).reshape(3, 6), np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (3, 1))
    twist[0], twist[1, 5], pose[0] = np.nan, np.nan, np.nan
    unseen = np.zeros((3, 6, 6))
    unseen[1, 0, 5] = 1.0
    blamed = np.zeros((3, 2), dtype=np.bool_)
    blamed[2, 1] = True
    return SpatialMotions(
        t_s=np.array([0.0, 0.01, 0.02]),
        twist=twist,
        twist_covariance=np.tile(np.eye(6), (3, 1, 1)),
        pose=pose,
        pose_covariance=np.tile(2 * np.eye(6), (3, 1, 1)),
        rank=np.array([0, 5, 6]),
        pose_rank=np.array([0, 6, 6]),
        blind=unseen,
        pose_blind=np.zeros((3, 6, 6)),
        observed=np.nan_to_num(twist),
        blamed=blamed,
        contradicted=np.zeros(3, dtype=np.bool_),
        pads=np.array([0, 2, 2]),
    )


def update() -> Update:
    slips = nothing(2)
    slips = replace(
        slips,
        **{
            field.name: np.zeros((3, *getattr(slips, field.name).shape[1:]), getattr(slips, field.name).dtype)
            for field in fields(slips)
            if getattr(slips, field.name) is not None
        },
    )
    planar = RigidField().start(Sensor(name="two", unit="Pa", pads=(pad("left"), pad("right"))).layout)
    contacts: Any = None
    output = Output(
        replace(slips, t_s=motions().t_s, span_s=np.full((3, 2), np.nan)),
        np.zeros((3, 2), dtype=np.bool_),
        replace(planar.step(slips, np.zeros((3, 2, 2))), t_s=motions().t_s),
        [],
        contacts,
        np.zeros((3, 2)),
        np.zeros((3, 2)),
        motions(),
    )
    return Update(np.zeros(3), output)


def pad(name: str) -> Pad:
    return Pad(name=name, rows=2, cols=2, pitch_m=(0.004, 0.004))


def test_a_live_line_has_the_columns_under_their_own_key() -> None:
    lines = [json.loads(line) for line in json_lines(update(), PADS)]
    assert tuple(lines[1]["object3d"]) == COLUMNS
    assert (lines[0]["object3d"]["vx_m_s"], lines[1]["object3d"]["vx_m_s"]) == (None, 6.0)
    assert lines[1]["object3d"]["wz_rad_s"] is None
    assert lines[1]["object3d"]["unobservable"] == "turn about (0.00, 0.00, 1.00) through (0, 0, 0) mm"
    assert lines[2]["object3d"]["blamed"] == "right"
    assert "vz_m_s" not in lines[1]["object"]
    assert "object3d" not in json.loads(
        json_lines(replace(update(), output=replace(update().output, spatial=None)), PADS)[0]
    )


def test_an_mcap_file_has_a_topic_of_it(tmp_path: Path) -> None:
    sensor = Sensor(name="two", unit="Pa", pads=(pad("left"), pad("right")))
    sink = McapSink(tmp_path / "a.mcap", drawn=False)
    sink.open(Head(sensor, PADS, {"sensor": "{}", "masks": "{}"}, lambda _kind, _what: None))
    sink.write(update())
    sink.close(Ending(None, ()))
    with (tmp_path / "a.mcap").open("rb") as file:
        told = [(channel.topic, json.loads(message.data)) for _, channel, message in make_reader(file).iter_messages()]
    rows = [row for topic, row in told if topic == "/object3d"]
    assert len(rows) == 3
    assert (rows[2]["wz_rad_s"], rows[2]["rank"], rows[0]["x_m"]) == (17.0, 6, None)


def test_parquet_has_types_and_nulls(tmp_path: Path) -> None:
    with ParquetTables(tmp_path, PADS) as tables:
        tables.write_spatial(motions())
    found = pd.read_parquet(tmp_path / "object3d.parquet")
    assert tuple(found.columns) == COLUMNS
    assert found["rank"].tolist() == [0, 5, 6]
    assert found["blamed"].tolist() == ["", "", "right"]
    assert found["wz_rad_s"].isna().tolist() == [True, True, False]


def test_ros_messages_mark_what_is_not_observable() -> None:
    types = Ros2Types()
    twist = types.twist(1.0, motions().twist[1], motions().twist_covariance[1])
    assert (twist.twist.twist.linear.z, twist.twist.twist.angular.z) == (8.0, 0.0)
    assert (twist.twist.covariance[35], twist.twist.covariance[0]) == (1e6, 1.0)
    pose = types.pose(1.0, motions().pose[1], motions().pose_covariance[1])
    assert (pose.pose.pose.position.z, pose.pose.pose.orientation.w, pose.header.frame_id) == (0.3, 1.0, "hand")
    assert bytes(pose.serialize())
