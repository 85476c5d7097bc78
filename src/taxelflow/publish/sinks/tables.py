"""The files of `taxelflow estimate`, as they grow: `tables:DIR`."""

from __future__ import annotations

import io
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.errors import SinkUnusable
from taxelflow.publish.sinks.base import ResultSink
from taxelflow.publish.sinks.patient import PatientFile
from taxelflow.publish.tables import FILES, Tables

if TYPE_CHECKING:
    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.runtime.addresses import Address


class TablesSink(ResultSink):
    """slips.csv, object.csv, object3d.csv (for pads in space), events.csv, contacts.csv, summary.json: in `.part` files
    until the run ends.
    """

    lossless = True
    gathers_s = 0.05
    summed = True

    def __init__(self, directory: Path) -> None:
        self._directory, self.dropped = directory, 0
        self.files = tuple(directory / name for name in FILES)
        self._opened: list[PatientFile] = []

    def open(self, head: Head) -> None:
        """See `Sink`."""

        def opened(path: Path) -> io.TextIOWrapper:
            file = PatientFile(path, head.report)
            self._opened.append(file)
            return io.TextIOWrapper(io.BufferedWriter(file), newline="", encoding="utf-8")

        self._tables = Tables(self._directory, head.pads, opened, flushes_first=False)
        try:
            self._tables.__enter__()
        except OSError as error:
            raise SinkUnusable(f"tables:{self._directory}", error.strerror or str(error)) from error

    def write(self, update: Update) -> None:
        """See `Sink`. A scan is lost if its rows are in one of the tables: the last ones of what was written now."""
        before = [(file.tell(), file.lost) for file in self._opened]
        output = update.output
        self._tables.write(
            output.slips, output.slipping, output.motions, output.events, output.contacts, output.evidence
        )
        if output.spatial is not None:
            self._tables.write_spatial(output.spatial)
        before += [(0, 0)] * (len(self._opened) - len(before))  # a table that began with this update
        shares = [
            (file.lost - lost) / (file.tell() - at)
            for file, (at, lost) in zip(self._opened, before, strict=True)
            if file.lost > lost
        ]
        self.dropped += ceil(len(update) * max(shares, default=0.0))

    def hurry(self) -> None:
        """See `Sink`."""
        for file in self._opened:
            file.give_up()

    def close(self, ending: Ending) -> None:
        """See `Sink`."""
        if ending.failed or any(file.lost for file in self._opened):  # rows stay in the .part files
            self._tables.__exit__(RuntimeError)
            return
        self._tables.__exit__(None)
        self._tables.write_patterns(ending.patterns)
        if ending.summary is not None:
            self._tables.write_summary(ending.summary)


def write(address: Address) -> TablesSink:
    """`tables:DIR`. Raises AddressInvalid."""
    address.check_options(())
    return TablesSink(address.file_path("tables:DIR"))
