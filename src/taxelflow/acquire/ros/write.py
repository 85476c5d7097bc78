"""Recordings as MCAP: messages `taxelflow_msgs/msg/Scan` in CDR on the topic `/scans`, exact to the bit.

Sensor, masked taxels and truth precede them, so that a truncated file can be read: all in a metadata record
`taxelflow`, and the sensor in an attachment `sensor.json` for other programs.
"""

from __future__ import annotations

from typing import IO, TYPE_CHECKING

import numpy as np

from taxelflow.acquire.metadata import texts_of
from taxelflow.acquire.ros.kinds import SCAN
from taxelflow.acquire.ros.mcap import METADATA
from taxelflow.numerics.clock import nanoseconds

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import RawScans

TOPIC = "/scans"


class McapScans:
    """An MCAP file that begins with its sensor, and grows by scans.

    writer: of the `mcap` package, for messages of other topics. The log time of a scan is its time, 0 if that is before
    1970.
    """

    def __init__(self, file: IO[bytes], texts: Mapping[str, str]) -> None:
        """texts: as by `texts_of`."""
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._name = SCAN.types[0]
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(get_types_from_msg(SCAN.definition, self._name))
        self._scan = self._store.types[self._name]
        self.writer = Writer(file)
        self.writer.start(profile="ros2", library="taxelflow")
        self.writer.add_attachment(0, 0, "sensor.json", "application/json", texts["sensor"].encode())
        self.writer.add_metadata(METADATA, dict(texts))
        schema = self.writer.register_schema(self._name, "ros2msg", SCAN.definition.encode())
        self._channel = self.writer.register_channel(TOPIC, "cdr", schema)

    def write(self, block: RawScans) -> None:
        """Append scans in the source's columns."""
        rows = np.ascontiguousarray(block.values)  # rosbags writes no strided array
        for t_s, values in zip(block.t_s.tolist(), rows, strict=True):
            content = self._store.serialize_cdr(self._scan(t_s=t_s, values=values), self._name)
            at_ns = nanoseconds(t_s)
            self.writer.add_message(self._channel, at_ns, bytes(content), at_ns)

    def finish(self) -> None:
        """Write the summary; no scan may follow."""
        self.writer.finish()  # type: ignore[no-untyped-call]


def write_mcap(recording: Recording, path: Path, blocks: Iterable[RawScans]) -> None:
    """Write blocks of a recording."""
    with path.open("wb") as file:
        scans = McapScans(file, texts_of(recording))
        for block in blocks:
            scans.write(block)
        scans.finish()
