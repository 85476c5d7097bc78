"""Joint angles from the `sensor_msgs/JointState` messages of a bag or MCAP file."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.joints import joints_of
from taxelflow.acquire.ros.decode import Decoder
from taxelflow.acquire.ros.kinds import JOINT_STATE
from taxelflow.errors import RecordingTruncated
from taxelflow.numerics.clock import seconds

if TYPE_CHECKING:
    from taxelflow.acquire.ros.topics import Source, Topic
    from taxelflow.messages import Joints


def joints_in(source: Source, *, use_stamps: bool) -> Joints | None:
    """Joint angles of all topics of that type, None if there are none. use_stamps: times are those in the messages.

    Messages may hold some of the joints each: every joint is interpolated to the times of all.
    """
    by_joint: dict[str, tuple[list[float], list[float]]] = {}
    for topic in source.topics:
        if topic.message_type in JOINT_STATE.types and topic.encoding in ("ros1", "cdr"):
            with suppress(RecordingTruncated):  # reading the scans reports what is lost
                _collect(source, topic, by_joint, use_stamps=use_stamps)
    if not by_joint:
        return None
    all_s = np.unique(np.concatenate([times for times, _ in by_joint.values()]))
    angles = np.full((len(all_s), len(by_joint)), np.nan)
    for column, (times, own) in enumerate(by_joint.values()):
        own_s, first = np.unique(times, return_index=True)
        angles[np.searchsorted(all_s, own_s), column] = np.array(own)[first]
    return joints_of(tuple(by_joint), all_s, angles)


def _collect(
    source: Source, topic: Topic, by_joint: dict[str, tuple[list[float], list[float]]], *, use_stamps: bool
) -> None:
    """Add times and angles of a topic's messages. Raises RecordingTruncated where the file is damaged."""
    decoder = Decoder(topic, JOINT_STATE)
    for received_ns, content in source.messages(topic):
        stamp_s, names, angles = decoder.named(content)
        for name, angle in zip(names, angles, strict=False):
            times, own = by_joint.setdefault(name, ([], []))
            times.append(stamp_s if use_stamps else seconds(received_ns))
            own.append(angle)
