"""Results as Parquet files: the columns of slips.csv, object.csv, object3d.csv and events.csv, null where unknown."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from taxelflow.errors import ExtraMissing, written_at
from taxelflow.publish.columns import EVENTS, OBJECT, SLIPS, event_rows, kind_of, motion_rows, slip_columns
from taxelflow.publish.spatial import COLUMNS, spatial_values
from taxelflow.publish.spatial import NAME as SPATIAL

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from taxelflow.messages import Bools, Event, Floats, Motions, Slips, SpatialMotions

NAMES = {"slips": SLIPS, "object": OBJECT, "events": EVENTS}
"""Columns of each table, by the stem of its file."""


class ParquetTables:
    """Writes a run's messages to a directory that exists, block by block; a context that closes the files.

    The same messages in the same blocks give the same bytes. suffix: of the files' names. Raises ExtraMissing, OSError.
    """

    def __init__(self, directory: Path, pads: tuple[str, ...], suffix: str = ".parquet") -> None:
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError as error:
            raise ExtraMissing("tables", "pyarrow") from error
        self._arrow, self._parquet = pyarrow, parquet
        self.directory, self._pads, self._suffix = directory, pads, suffix
        self._files: dict[str, Any] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with written_at(self.directory):
            for name, columns in NAMES.items():
                self._begin(name, columns)
        return self

    def _begin(self, name: str, columns: Sequence[str]) -> None:
        schema = self._arrow.schema([(column, self._type(column)) for column in columns])
        file = self._parquet.ParquetWriter(self.directory / f"{name}{self._suffix}", schema)
        self._files[name] = self._stack.enter_context(file)

    def __exit__(self, *_details: object) -> None:
        with written_at(self.directory):
            self._stack.close()

    def write(self, slips: Slips, slipping: Bools, motions: Motions, events: list[Event], evidence: Floats) -> None:
        """Append one block."""
        with written_at(self.directory):
            self._append("slips", slip_columns(slips, slipping, evidence, self._pads))
            self._append("object", _by_name(OBJECT, motion_rows(motions)))
            self._append("events", _by_name(EVENTS, event_rows(events)))

    def write_spatial(self, motions: SpatialMotions) -> None:
        """Append one block to `object3d.parquet`, which there is only where the pads' places in space are known."""
        with written_at(self.directory):
            if SPATIAL not in self._files:
                self._begin(SPATIAL, COLUMNS)
            self._append(SPATIAL, _by_name(COLUMNS, spatial_values(motions, self._pads)))

    def _append(self, name: str, columns: dict[str, Any]) -> None:
        schema = self._files[name].schema
        made = [
            self._arrow.array(columns[field.name], field.type, from_pandas=self._arrow.types.is_floating(field.type))
            for field in schema
        ]
        table = self._arrow.Table.from_arrays(made, schema=schema)
        if table.num_rows:
            self._files[name].write_table(table)

    def _type(self, column: str) -> Any:
        arrow = self._arrow
        kinds = {"text": arrow.string(), "flag": arrow.bool_(), "count": arrow.int64()}
        return kinds.get(kind_of(column), arrow.float64())


def _by_name(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Values by column."""
    held = list(rows)
    return {name: [row[k] for row in held] for k, name in enumerate(columns)}
