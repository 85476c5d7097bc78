"""`manifest.csv`: a row for each recording that is done or has failed; rows are appended, and sorted at the end."""

from __future__ import annotations

import csv
import io
import os
from typing import TYPE_CHECKING, Literal, NamedTuple, Self, cast

from taxelflow.errors import printable, written_at
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    Status = Literal["done", "failed"]

COLUMNS = ("recording", "status", "seconds", "message")


class Row(NamedTuple):
    """recording: absolute path, as `printable` writes it. seconds: processor time, None if unknown. message: why it
    failed, or what a truncated recording lacks.
    """

    recording: str
    status: Status
    seconds: float | None
    message: str

    def line(self) -> str:
        """The row as csv on exactly one line."""
        text = io.StringIO()
        seconds = "" if self.seconds is None else f"{self.seconds:.3f}"
        fields = (self.recording, self.status, seconds, printable(self.message))
        csv.writer(text, lineterminator="\n").writerow(fields)
        return text.getvalue()


class Manifest:
    """The rows of a directory by recording; a context in which rows are added, each on disk when `add` returns.

    A last line that a killed client has not finished is left out.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rows: dict[str, Row] = {}
        if path.exists():
            whole, _, _torn = path.read_text(encoding="utf-8").rpartition("\n")
            for fields in csv.reader(whole.split("\n")[1:]):
                self._take(fields)

    def __enter__(self) -> Self:
        self._rewrite()
        self._file = self._path.open("a", encoding="utf-8", newline="")
        return self

    def __exit__(self, *_details: object) -> None:
        self._file.close()
        self._rewrite()

    def add(self, row: Row) -> None:
        """Append a row; it replaces an earlier one of the same recording."""
        with written_at(self._path):
            self._file.write(row.line())
            self._file.flush()
            os.fsync(self._file.fileno())
        self.rows[row.recording] = row

    def of(self, recordings: Iterable[Path], status: Status) -> list[Row]:
        """Rows of these recordings with this status."""
        rows = (self.rows.get(printable(str(recording))) for recording in recordings)
        return [row for row in rows if row is not None and row.status == status]

    def _take(self, fields: list[str]) -> None:
        if len(fields) == len(COLUMNS) and fields[1] in {"done", "failed"}:
            recording, status, seconds, message = fields
            self.rows[recording] = Row(recording, cast("Status", status), float(seconds) if seconds else None, message)

    def _rewrite(self) -> None:
        lines = [",".join(COLUMNS) + "\n", *(self.rows[recording].line() for recording in sorted(self.rows))]
        with whole_file(self._path) as part:
            part.write_text("".join(lines), encoding="utf-8", newline="")
