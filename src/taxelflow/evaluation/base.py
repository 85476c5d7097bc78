"""A score: a frozen dataclass of options that runs to a report; the report is shown, or written as JSON or CSV.

A score is a module of its own, named in the registry (stage `score`) or announced by another package as an entry point
of the group `taxelflow.score`. The first line of its docstring is its line in `taxelflow score --help`.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Protocol, TypeVar

import msgspec

from taxelflow.errors import written_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

Item = TypeVar("Item")
Cell = str | int | float | None
"""One value of a table; None where there is none."""


class Watch(Protocol):
    """Passes items on, one by one, and may show progress; what: their name in the plural."""

    def __call__(self, items: Iterable[Item], what: str) -> Iterable[Item]:
        """The same items in the same order."""
        ...


class Report(Protocol):
    """What a score has found: a msgspec Struct or a dataclass, whose fields are the keys of its JSON."""

    def tables(self) -> Sequence[Table]:
        """The rows as tables for CSV files, the main one first."""
        ...

    def show(self) -> None:
        """Print the tables in a terminal."""
        ...


class Score(Protocol):
    """Options of a score, with their defaults: the command line and its help are made of them."""

    def run(self, watched: Watch = ...) -> Report:
        """Simulate or read, estimate, compare. Raises TaxelflowError for options that cannot be used."""
        ...


@dataclass(frozen=True, slots=True)
class Table:
    """A table for a CSV file. name: of the table among those of its report. columns: headings, with units."""

    name: str
    columns: tuple[str, ...]
    rows: list[tuple[Cell, ...]]


def unwatched(items: Iterable[Item], what: str) -> Iterable[Item]:
    """Pass items on without showing anything."""
    return items


def table_of(name: str, rows: Sequence[msgspec.Struct], kind: type[msgspec.Struct]) -> Table:
    """A table of rows of one kind, a column per field."""
    return Table(name, kind.__struct_fields__, [msgspec.structs.astuple(row) for row in rows])


def write_tables(tables: Sequence[Table], path: Path) -> list[Path]:
    """Write the first table to `path`, each other one beside it as STEM-NAME.csv; return the files.

    Numbers have six significant digits; a cell without a value is empty. A file is replaced whole or not at all.
    """
    paths = [path, *(path.with_name(f"{path.stem}-{table.name}.csv") for table in tables[1:])]
    for target, table in zip(paths, tables, strict=True):
        part = target.with_name(target.name + ".part")
        with written_at(target):
            with part.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(table.columns)
                writer.writerows(map(_text, row) for row in table.rows)
            part.replace(target)
    return paths


def _text(cell: Cell) -> str:
    if isinstance(cell, float):
        return f"{cell:.6g}" if isfinite(cell) else ""
    return "" if cell is None else str(cell)
