"""Poses of a bag or MCAP file: `geometry_msgs/PoseStamped`, as motion capture and robots publish them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.ros.decode import Decoder
from taxelflow.acquire.ros.kinds import Kind
from taxelflow.acquire.ros.mcap import McapSource, seen
from taxelflow.acquire.ros.rosbag import RosbagSource
from taxelflow.errors import TaxelflowError, TopicUnclear, TruthInvalid

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.ros.topics import Source, Topic
    from taxelflow.messages import Floats

_POSE = Kind(types=("geometry_msgs/msg/PoseStamped",), values=("pose.position.x,y",), stamp="header.stamp")


def read_poses(path: Path, name: str | None) -> Floats:
    """(poses, 3): stamp in s, x and y in m, of one topic. Raises TopicUnclear, TruthInvalid, RecordingTruncated."""
    try:
        source: Source = McapSource(path) if path.suffix.lower() == ".mcap" else RosbagSource(path)
        topic = _chosen(path, source.topics, name)
        decoder = Decoder(topic, _POSE)
        rows = []
        for _, content in source.messages(topic):
            stamp_s, (place,) = decoder.one(content)
            rows.append([stamp_s, *place])
    except (TaxelflowError, OSError):
        raise
    except Exception as error:  # the parsers' errors for a file that is no bag
        raise TruthInvalid(path, seen(error)) from error
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(table).all():
        raise TruthInvalid(path, f"a pose of {topic.name} is not finite")
    return table


def _chosen(path: Path, topics: list[Topic], name: str | None) -> Topic:
    fitting = [topic for topic in topics if topic.message_type in _POSE.types and topic.encoding in ("ros1", "cdr")]
    listed = [f"{topic.name} ({topic.message_type})" for topic in topics]
    if name is not None:
        fitting = [topic for topic in fitting if topic.name.strip("/") == name.strip("/")]
        if not fitting:
            raise TopicUnclear(path, f"no topic {name} of geometry_msgs/msg/PoseStamped", listed, "--truth-topic")
    if len(fitting) != 1:
        seen_here = f"{len(fitting)} topics hold geometry_msgs/msg/PoseStamped"
        raise TopicUnclear(path, seen_here, listed, "--truth-topic")
    return fitting[0]
