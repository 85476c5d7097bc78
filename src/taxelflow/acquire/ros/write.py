"""Recordings as MCAP: messages `taxelflow_msgs/msg/Scan` in CDR on the topic `/scans`, exact to the bit.

Sensor, masked taxels and truth precede them in a metadata record `taxelflow`, so that a truncated file can be read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.metadata import texts_of
from taxelflow.acquire.ros.kinds import SCAN
from taxelflow.acquire.ros.mcap import METADATA

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import RawScans

TOPIC = "/scans"


def write_mcap(recording: Recording, path: Path, blocks: Iterable[RawScans]) -> None:
    """Write blocks of a recording. The log time of a message is its scan's time, 0 if that is before 1970."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    name = SCAN.types[0]
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(SCAN.definition, name))
    scan = store.types[name]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="taxelflow")
        writer.add_metadata(METADATA, texts_of(recording))
        schema = writer.register_schema(name, "ros2msg", SCAN.definition.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for block in blocks:
            rows = np.ascontiguousarray(block.values)  # rosbags writes no strided array
            for t_s, values in zip(block.t_s.tolist(), rows, strict=True):
                content = store.serialize_cdr(scan(t_s=t_s, values=values), name)
                at_ns = max(0, round(t_s * 1e9))
                writer.add_message(channel, at_ns, bytes(content), at_ns)
        writer.finish()  # type: ignore[no-untyped-call]
