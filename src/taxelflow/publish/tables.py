"""Results as CSV files: rows stand in `*.csv.part` while a run lasts, and are renamed at its end."""

from __future__ import annotations

import csv
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from taxelflow.errors import TaxelflowError, written_at
from taxelflow.publish.columns import (
    CONTACTS,
    EVENTS,
    OBJECT,
    SLIPS,
    as_text,
    contact_rows,
    event_rows,
    motion_rows,
    slip_rows,
)
from taxelflow.publish.patterns import NAME as PATTERNS
from taxelflow.publish.patterns import write_patterns
from taxelflow.publish.pictures import pictures_of
from taxelflow.publish.spatial import COLUMNS, spatial_values
from taxelflow.publish.spatial import NAME as SPATIAL
from taxelflow.publish.summary import to_json
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from io import TextIOBase

    from taxelflow.messages import Bools, Contacts, Event, Floats, LearnedPattern, Motions, Slips, SpatialMotions
    from taxelflow.publish.summary import Summary

_ALWAYS = {"slips": SLIPS, "object": OBJECT, "events": EVENTS, "contacts": CONTACTS}
_COLUMNS = _ALWAYS | {SPATIAL: COLUMNS}
FILES = (*(f"{name}.csv" for name in _COLUMNS), PATTERNS, "summary.json")
"""Names of all files of a run."""


class Tables:
    """Writes a run's messages to a directory, block by block; a context that renames the files if all went well.

    If it ends by an exception, the rows written so far stay in the `.part` files. A result that was there before is
    removed with its pictures. opened: how these are opened. flushes_first: write the headers at once, so that a full
    disk is found before the work; not for files that wait for room.
    """

    def __init__(
        self,
        directory: Path,
        pads: tuple[str, ...],
        opened: Callable[[Path], TextIOBase] | None = None,
        *,
        flushes_first: bool = True,
    ) -> None:
        self.directory, self._pads = directory, pads
        self._opened, self._flushes_first = opened or _opened, flushes_first
        self._files: dict[str, Any] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self.directory.mkdir(parents=True, exist_ok=True)
        try:
            with written_at(self.directory):
                self._open()
        except (OSError, TaxelflowError):
            with suppress(OSError):  # closing a file on a full disk fails again
                self._stack.close()
            raise
        for older in (*pictures_of(self.directory), *(self.directory / name for name in FILES)):
            older.unlink(missing_ok=True)  # what stands here after a failure is of this run
        return self

    def _open(self) -> None:
        for name in _ALWAYS:
            self._begin(name)
        if self._flushes_first:
            self._flush()

    def _begin(self, name: str) -> None:
        self._files[name] = file = self._stack.enter_context(self._opened(self.directory / f"{name}.csv.part"))
        csv.writer(file, lineterminator="\n").writerow(_COLUMNS[name])

    def __exit__(self, kind: type[BaseException] | None, *_details: object) -> None:
        with written_at(self.directory):
            self._stack.close()
            for name in self._files if kind is None else ():
                part = self.directory / f"{name}.csv.part"
                part.replace(part.with_suffix(""))

    def write(
        self,
        slips: Slips,
        slipping: Bools,
        motions: Motions,
        events: list[Event],
        contacts: Contacts,
        evidence: Floats,
    ) -> None:
        """Append one block; it is on disk when this returns."""
        with written_at(self.directory):
            self._append("slips", slip_rows(slips, slipping, evidence, self._pads))
            self._append("object", motion_rows(motions))
            self._append("events", event_rows(events))
            self._append("contacts", contact_rows(contacts, self._pads))
            self._flush()

    def write_spatial(self, motions: SpatialMotions) -> None:
        """Append one block to `object3d.csv`, which there is only where the pads' places in space are known."""
        with written_at(self.directory):
            if SPATIAL not in self._files:
                self._begin(SPATIAL)
            self._append(SPATIAL, spatial_values(motions, self._pads))
            self._flush()

    def write_summary(self, summary: Summary) -> None:
        """Write `summary.json`, whole or not at all."""
        with whole_file(self.directory / "summary.json") as part:
            part.write_bytes(to_json(summary))

    def write_patterns(self, patterns: Sequence[LearnedPattern]) -> None:
        """Write `patterns.npz`, if there are any, whole or not at all."""
        if patterns:
            write_patterns(patterns, self.directory / PATTERNS)

    def _append(self, name: str, rows: Iterable[Iterable[Any]]) -> None:
        csv.writer(self._files[name], lineterminator="\n").writerows(as_text(_COLUMNS[name], rows))

    def _flush(self) -> None:
        for file in self._files.values():
            file.flush()


def _opened(path: Path) -> TextIOBase:
    return path.open("w", newline="", encoding="utf-8")
