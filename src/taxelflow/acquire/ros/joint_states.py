"""Joint angles from the `sensor_msgs/JointState` messages of a bag or MCAP file."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.joints import joints_of
from taxelflow.acquire.ros.decode import Decoder
from taxelflow.acquire.ros.kinds import JOINT_STATE
from taxelflow.acquire.ros.mcap import seen
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, TaxelflowError
from taxelflow.numerics.clock import seconds

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.acquire.ros.topics import Source, Topic
    from taxelflow.messages import Joints


def joints_in(path: Path, source: Source, *, use_stamps: bool) -> Joints | None:
    """Joint angles of all topics of that type, None if there are none. use_stamps: times are those in the messages, of
    receipt where a message has none.

    Messages may hold some of the joints each: every joint is interpolated to the times of all. Raises RecordingCorrupt
    for a message that does not match its type.
    """
    by_joint: dict[str, tuple[list[float], list[float]]] = {}
    topics = [one for one in source.topics if one.message_type in JOINT_STATE.types and one.encoding in ("ros1", "cdr")]
    for topic in topics:
        with suppress(RecordingTruncated):  # reading the scans reports what is lost
            for name, t_s, angle in _angles(path, source, topic, use_stamps=use_stamps):
                times, own = by_joint.setdefault(name, ([], []))
                times.append(t_s)
                own.append(angle)
    if not by_joint:
        return None
    all_s = np.unique(np.concatenate([times for times, _ in by_joint.values()]))
    angles = np.full((len(all_s), len(by_joint)), np.nan)
    for column, (times, own) in enumerate(by_joint.values()):
        own_s, first = np.unique(times, return_index=True)
        angles[np.searchsorted(all_s, own_s), column] = np.array(own)[first]
    return joints_of(tuple(by_joint), all_s, angles)


def _angles(path: Path, source: Source, topic: Topic, *, use_stamps: bool) -> Iterator[tuple[str, float, float]]:
    """Joint, time and angle of each entry of a topic's messages. A stamp of 0 is one that is not set.

    Raises RecordingTruncated where the file is damaged, RecordingCorrupt.
    """
    read = 0
    try:
        decoder = Decoder(topic, JOINT_STATE)
        for received_ns, content in source.messages(topic):
            stamp_s, names, angles = decoder.named(content)
            t_s = stamp_s if use_stamps and stamp_s else seconds(received_ns)
            yield from ((name, t_s, angle) for name, angle in zip(names, angles, strict=False))
            read += 1
    except TaxelflowError:
        raise
    except Exception as error:  # a message or a definition that does not match the type
        raise RecordingCorrupt(path, f"message {read} of {topic.name}: {seen(error)}", "record it again") from error
