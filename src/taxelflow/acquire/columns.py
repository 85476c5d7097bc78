"""Columns of time and taxels in a table: the mapping for csv files and text logs of any shape, and for Parquet."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from taxelflow.acquire.table_remedies import SHOWN, for_time
from taxelflow.errors import ParameterInvalid, RecordingCorrupt
from taxelflow.sensors.toml_text import parse_toml, read_limited

JOINT = "joint:"
"""Beginning of the names of columns with joint angles, in rad."""
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of times: how many are a second. Times are divided by it, which gives the number next to the time, the one that
the same time written in s is read as; a product with 1e-3 is often the one beside it."""


@dataclass(frozen=True, slots=True)
class _Rates:
    """Scan rates of tactile sensors, Hz."""

    slowest_hz: float = 0.5
    fastest_hz: float = 20e3
    """A rate outside suggests times in a wrong unit."""
    usual_hz: tuple[float, float] = (5.0, 2000.0)
    """Rates by which the unit of the times is guessed."""


RATES = _Rates()
_LATEST_S = 4e9
"""Unix time in 2096: stamps of the epoch in another unit than s are far above."""


@dataclass(frozen=True)
class Columns:
    """Structure of a csv, text or Parquet file. Default: a header row, a column `t_s` in s, and a column per taxel."""

    file: Path | None = None
    """TOML file with the fields below; options given beside it take precedence."""
    time: str = "t_s"
    """Column with the time: its name, or its number counted from 0."""
    time_unit: Literal["s", "ms", "us", "ns"] = "s"
    """Unit of the times; ISO 8601 dates are recognised without it."""
    times: Path | None = None
    """File with the time of each scan, where they stand apart: text with one time per line, or a .npy."""
    rate_hz: float | None = None
    """Scan rate of a log without times, Hz; `time` is then ignored."""
    taxels: tuple[str, ...] = ("*",)
    """Columns of the taxels in the sensor's order: names with wildcards, re:REGEX, or numbers such as 5 or 14-73,
    counted from 0. A pattern must match the whole name. The column with the time and columns named `joint:NAME` are
    excluded."""
    order: Literal["file", "number"] | None = None
    """Order of the columns that one pattern matches: that of the file, or by the numbers in their names. Required where
    the two differ."""
    delimiter: str | None = None
    """Separator of fields: a character, tab or space (any white space). Default: comma in .csv, tab in .tsv, white
    space in .txt."""
    header: bool = True
    """Read the names of the columns from the first row."""
    skip: int = 0
    """Number of lines to skip before the header or the first scan."""
    rows_per_scan: int = 1
    """Number of lines per scan; their fields are read as one row. Only without a header."""
    pads: tuple[str, ...] = ()
    """Pattern of file names per pad, for a folder with one file per pad: PAD=GLOB, such as palm=palm_*.csv. Default:
    `files` of the sensor file."""

    def __post_init__(self) -> None:
        self._settle_types()
        for name, value, least in (("skip", self.skip, 0), ("rows_per_scan", self.rows_per_scan, 1)):
            if value < least:
                raise ParameterInvalid(f"columns.{name}", value, f"be at least {least}")
        if self.rate_hz is not None and self.times is not None:
            raise ParameterInvalid("columns.rate_hz", self.rate_hz, "be left out where --columns.times gives times")
        if self.rate_hz is not None and not 0 < self.rate_hz < float("inf"):
            raise ParameterInvalid("columns.rate_hz", self.rate_hz, "be a finite number above 0, in Hz")
        if self.header and self.rows_per_scan > 1:
            raise ParameterInvalid(
                "columns.rows_per_scan", self.rows_per_scan, "be 1 for a file with a header: add --columns.no-header"
            )
        if self.delimiter is not None and self.delimiter not in ("tab", "space") and len(self.delimiter) != 1:
            raise ParameterInvalid("columns.delimiter", self.delimiter, "be one character, tab or space")

    def _settle_types(self) -> None:
        """What Python's users write instead: numbers of columns, paths as text. Raises ParameterInvalid."""
        object.__setattr__(self, "time", str(self.time))
        for name in ("file", "times"):
            if isinstance(path := getattr(self, name), str):
                object.__setattr__(self, name, Path(path))
        for name in ("taxels", "pads"):
            if isinstance(given := getattr(self, name), str):  # it would be taken letter by letter
                raise ParameterInvalid(f"columns.{name}", given, f"be a tuple of patterns, such as ({given!r},)")
        for name, known in (("time_unit", list(PER_SECOND)), ("order", [None, "file", "number"])):
            if getattr(self, name) not in known:
                words = ", ".join(str(one) for one in known if one is not None)
                raise ParameterInvalid(f"columns.{name}", getattr(self, name), f"be one of {words}")

    @property
    def per_second(self) -> float:
        """Units of the column's times in a second."""
        return PER_SECOND[self.time_unit]

    def resolved(self) -> Columns:
        """The fields of `file`, overridden by those that are not defaults here. Raises ParameterInvalid."""
        if self.file is None:
            return self
        import msgspec

        known = [item.name for item in fields(Columns) if item.name != "file"]
        given = {name: getattr(self, name) for name in known if getattr(self, name) != getattr(Columns, name)}
        try:
            table = parse_toml(read_limited(self.file))
            if unknown := table.keys() - set(known):
                duty = f"have only the fields {', '.join(known)}"
                raise ParameterInvalid(f"{self.file}", ", ".join(sorted(unknown)), duty)
            if type(table.get("time")) is int:
                table["time"] = str(table["time"])
            from_file = msgspec.convert(table, Columns, dec_hook=self._beside)
        except (OSError, ValueError, msgspec.ValidationError) as error:
            raise ParameterInvalid("columns.file", str(self.file), f"be a readable TOML file: {error}") from error
        return replace(from_file, **given)

    def _beside(self, _kind: type[Path], given: object) -> Path:
        """A path in `file` is relative to its folder."""
        if self.file is None or not isinstance(given, str):
            raise ValueError(f"a path is text, not {given!r}")
        return self.file.parent / given

    def recorded(self) -> dict[str, Any]:
        """The fields that are not defaults, as JSON has them: those of `file` too, and absolute paths."""
        found = self.resolved()
        if found.times is not None:
            found = replace(found, times=found.times.absolute())
        return {name: str(value) if isinstance(value, Path) else value for name, value in found.changed().items()}

    @staticmethod
    def of_record(recorded: dict[str, Any]) -> Columns:
        """What `recorded` gave. Raises ParameterInvalid, and msgspec's ValidationError for what it did not give."""
        import msgspec

        return msgspec.convert(recorded, Columns, dec_hook=lambda _, path: Path(path))

    def changed(self) -> dict[str, object]:
        """The fields that differ from their defaults."""
        return {one.name: getattr(self, one.name) for one in fields(self) if getattr(self, one.name) != one.default}

    def find(self, path: Path, names: list[str], *, timed: bool = False) -> tuple[int | None, list[int]]:
        """Numbers of the columns of the time (None if there is none) and of the taxels. Raises RecordingCorrupt.

        timed: times stand elsewhere in the file.
        """
        elsewhere = timed or self.rate_hz is not None or self.times is not None
        time = None if elsewhere else self._time_column(path, names)
        chosen: list[int] = []
        for pattern in self.taxels:
            found = [n for n in _matching(pattern, names) if n != time and not names[n].startswith(JOINT)]
            if not found:
                raise RecordingCorrupt(
                    path, f"no column matches {pattern!r} among {_listed(names)}", "set --columns.taxels"
                )
            chosen += self._ordered(path, names, found)
        if len(set(chosen)) < len(chosen):
            twice = names[Counter(chosen).most_common(1)[0][0]]
            raise RecordingCorrupt(path, f"column {twice!r} is matched twice", "set --columns.taxels to other patterns")
        return time, chosen

    def _time_column(self, path: Path, names: list[str]) -> int:
        if self.time in names:
            return names.index(self.time)
        if self.time.isdecimal() and int(self.time) < len(names):
            return int(self.time)
        seen = f"no column {self.time!r}: the header starts with {','.join(names[:3])[:SHOWN]!r}"
        raise RecordingCorrupt(path, seen, for_time(names, header=self.header))

    def _ordered(self, path: Path, names: list[str], found: list[int]) -> list[int]:
        if len({re.sub(r"\d+", "#", names[number]) for number in found}) > 1 and self.order is None:
            return found
        keys = {number: tuple(map(int, re.findall(r"\d+", names[number]))) for number in found}
        by_number = sorted(found, key=lambda number: keys[number])
        if self.order is None and by_number != found:
            first = next(number for number, sorted_one in zip(found, by_number, strict=True) if number != sorted_one)
            seen = f"columns are not sorted: {names[first]!r} comes before a smaller number"
            raise RecordingCorrupt(path, seen, "choose the sensor's order: --columns.order number, or file")
        return by_number if self.order == "number" else found


def _matching(pattern: str, names: list[str]) -> list[int]:
    """Numbers of the columns that match, in the file's order."""
    if pattern in names:
        return [names.index(pattern)]
    if span := re.fullmatch(r"(\d+)(?:-(\d+))?", pattern):
        first, last = int(span[1]), int(span[2] or span[1])
        return list(range(first, last + 1)) if first <= last < len(names) else []
    if pattern.startswith("re:"):
        try:
            compiled = re.compile(pattern.removeprefix("re:"))
        except re.error as error:
            raise ParameterInvalid("columns.taxels", pattern, f"be a regular expression after re:, {error}") from error
        return [number for number, name in enumerate(names) if compiled.fullmatch(name)]
    return [number for number, name in enumerate(names) if fnmatchcase(name, pattern)]


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ", ".join(" ".join(name[:40].split()) for name in names[:8]) + more


def likely_unit(rate_hz: float) -> str | None:
    """Unit of times with which a rate is that of a tactile sensor; None if there is none. rate_hz: with times in s."""
    fit = (name for name, units in PER_SECOND.items() if RATES.usual_hz[0] <= rate_hz * units <= RATES.usual_hz[1])
    return next(fit, None)


def epoch_units(stamp_s: float) -> list[str]:
    """Units in which a stamp would be a time since 1970 of these decades. stamp_s: as if it were in s."""
    return [name for name, units in PER_SECOND.items() if _LATEST_S / 4 < stamp_s / units < _LATEST_S]


def doubted_rate(rate_hz: float, first_s: float) -> list[str]:
    """A note if no tactile sensor scans at this rate, with the likely unit of the times. first_s: the first of them."""
    if RATES.slowest_hz <= rate_hz <= RATES.fastest_hz:
        return []
    units = epoch_units(first_s)
    units += filter(None, [likely_unit(rate_hz)])
    likely = f"the times are likely in {units[0]}" if units and units[0] != "s" else "check that times are in s"
    how = f"--columns.time-unit {units[0]}" if units and units[0] != "s" else "--columns.time-unit"
    return [
        f"a rate of {rate_hz:.3g} Hz is implausible for a tactile sensor: {likely} ({how} for a table; else convert"
        " them to s)"
    ]
