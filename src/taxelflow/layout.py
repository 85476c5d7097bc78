"""Sensors, pads and taxels: what a TOML file declares, and the arrays that the stages compute with.

Pad frame: row 0 is the top row, column 0 the left; x to the right along columns, y up (towards row 0),
z out of the skin; origin at the pad's centre. Taxels run pad by pad, row-major, missing ones left out.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from taxelflow.errors import NameUnknown, SensorFileInvalid
from taxelflow.messages import Bools, Floats

PASCAL_PER = {"Pa": 1.0, "kPa": 1e3, "psi": 6894.757293168, "N/cm2": 1e4}

Name = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[^,\"\r\n]+$")]
Count = Annotated[int, Meta(ge=1, le=1024)]
Positive = Annotated[float, Meta(gt=0, lt=1e12)]
Index = Annotated[int, Meta(ge=0)]


class Pad(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rectangular grid of taxels, some of which may be missing."""

    name: Name
    """How the pad is called in results."""
    rows: Count
    cols: Count
    pitch_m: tuple[Positive, Positive]
    """Distance between taxel centres along x (columns) and y (rows), m."""
    missing: tuple[tuple[Index, Index], ...] = ()
    """Grid places [row, col] where there is no taxel."""
    note: str = ""
    """What a user should know, such as an assumption."""


class Sensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A tactile sensor: its pads in the order of the scans, and the unit of its readings."""

    name: Name
    unit: Literal["Pa", "kPa", "psi", "N/cm2", "count"]
    pads: Annotated[tuple[Pad, ...], Meta(min_length=1, max_length=1024)]
    scale_pa: Positive | None = None
    """Pa per count, for unit `count`, if known."""
    full_scale: Positive | None = None
    """Largest reading, in `unit`, if known: there a taxel saturates."""
    note: str = ""

    @property
    def to_si(self) -> float:
        """Factor from a reading to Pa; 1 for counts without a scale."""
        return PASCAL_PER.get(self.unit) or self.scale_pa or 1.0

    @property
    def si_unit(self) -> str:
        """Unit of conditioned pressure: `Pa`, or `count` where no scale is known."""
        return "count" if self.unit == "count" and self.scale_pa is None else "Pa"

    @property
    def layout(self) -> Layout:
        """Taxel arrays of this sensor, computed once."""
        return _layout(self)


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Taxels of all pads as flat arrays, in the order of a scan.

    x_m, y_m: (taxels,) place in the pad's frame. pitch_m: (pads, 2). row, col: (taxels,) place in the pad's grid.
    starts: (pads + 1,), pad p owns taxels starts[p] to starts[p + 1]. shapes: (rows, cols) per pad.
    border: (taxels, 2), no neighbour to the left or right (x), above or below (y).
    """

    pads: tuple[str, ...]
    shapes: tuple[tuple[int, int], ...]
    starts: NDArray[np.int64]
    pitch_m: Floats
    row: NDArray[np.int64]
    col: NDArray[np.int64]
    x_m: Floats
    y_m: Floats
    border: Bools

    @property
    def taxels(self) -> int:
        """Number of taxels in a scan."""
        return int(self.starts[-1])

    def of_pad(self, pad: int) -> slice:
        """Taxels of pad number `pad`."""
        return slice(int(self.starts[pad]), int(self.starts[pad + 1]))

    def neighbours(self, pad: int) -> NDArray[np.int64]:
        """(pairs, 2) taxels of a pad, numbered within it, that lie side by side in a row or a column."""
        own = self.of_pad(pad)
        number = self.grid(pad, np.arange(self.taxels, dtype=np.float64) - own.start, fill=-1.0)
        across = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
        down = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
        pairs = np.concatenate([across, down]).astype(np.int64)
        return pairs[(pairs >= 0).all(axis=1)]

    def grid(self, pad: int, scan: Floats, fill: float = np.nan) -> Floats:
        """One pad of a scan (taxels,) as (rows, cols), row 0 on top; `fill` where no taxel is."""
        image: Floats = np.full(self.shapes[pad], fill)
        own = self.of_pad(pad)
        image[self.row[own], self.col[own]] = scan[own]
        return image


@cache
def _layout(sensor: Sensor) -> Layout:
    present = [_present(pad) for pad in sensor.pads]
    row, col = (np.concatenate([np.nonzero(there)[axis] for there in present]) for axis in (0, 1))
    counts = [int(there.sum()) for there in present]
    pitch_m = np.array([pad.pitch_m for pad in sensor.pads])
    shape = np.array([(pad.rows, pad.cols) for pad in sensor.pads])
    owner = np.repeat(np.arange(len(counts)), counts)
    return Layout(
        pads=tuple(pad.name for pad in sensor.pads),
        shapes=tuple((pad.rows, pad.cols) for pad in sensor.pads),
        starts=np.concatenate([[0], np.cumsum(counts)]),
        pitch_m=pitch_m,
        row=row,
        col=col,
        x_m=(col - (shape[owner, 1] - 1) / 2) * pitch_m[owner, 0],
        y_m=((shape[owner, 0] - 1) / 2 - row) * pitch_m[owner, 1],
        border=np.concatenate([_border(there) for there in present]),
    )


def _present(pad: Pad) -> Bools:
    there = np.ones((pad.rows, pad.cols), dtype=np.bool_)
    for row, col in pad.missing:
        there[row, col] = False
    return there


def _border(there: Bools) -> Bools:
    padded = np.pad(there, 1)
    left_right = ~(padded[1:-1, :-2] & padded[1:-1, 2:])
    above_below = ~(padded[:-2, 1:-1] & padded[2:, 1:-1])
    return np.stack([left_right[there], above_below[there]], axis=1)


def builtin_sensors() -> list[str]:
    """Names of the sensors that come with taxelflow."""
    folder = resources.files("taxelflow") / "sensors"
    return sorted(Path(file.name).stem for file in folder.iterdir() if file.name.endswith(".toml"))


def load_sensor(name: str) -> Sensor:
    """A built-in sensor by name, or one from a TOML file by path.

    Raises NameUnknown (with the list of names) and SensorFileInvalid (with file, table and field).
    """
    if name in builtin_sensors():
        return parse_sensor((resources.files("taxelflow") / "sensors" / f"{name}.toml").read_bytes(), f"{name}.toml")
    path = Path(name)
    if path.is_file():
        return parse_sensor(path.read_bytes(), str(path))
    raise NameUnknown("sensor", name, [*builtin_sensors(), "or the path of a TOML file"])


def parse_sensor(text: bytes, source: str) -> Sensor:
    """A sensor from TOML text; `source` names it in errors. Raises SensorFileInvalid."""
    try:
        table = tomllib.loads(text.decode())
    except UnicodeDecodeError as error:
        raise SensorFileInvalid(source, "text", str(error), "a TOML file is UTF-8 text") from error
    except tomllib.TOMLDecodeError as error:
        raise SensorFileInvalid(source, "syntax", str(error), "see toml.io for the format") from error
    return sensor_of(table, source)


def sensor_of(table: object, source: str) -> Sensor:
    """A sensor from the mapping that TOML or JSON holds; `source` names it in errors. Raises SensorFileInvalid."""
    try:
        sensor = msgspec.convert(table, Sensor)
    except msgspec.ValidationError as error:
        raise _schema_error(source, str(error)) from error
    _check_sensor(sensor, source)
    return sensor


def _schema_error(source: str, message: str) -> SensorFileInvalid:
    """Turn msgspec's `... - at `$.pads[0].rows`` into the words of TOML."""
    what, _, path = message.partition(" - at `$")
    seen = what.replace("Object", "table").replace("object", "table").replace("`array`", "a list")
    table = re.match(r"\.pads\[(\d+)\]", path)
    field = re.sub(r"^\.pads\[\d+\]", "", path.rstrip("`")).lstrip(".")
    where = f"table [[pads]] number {int(table[1]) + 1}" if table else "top level"
    return SensorFileInvalid(
        source,
        where + (f", field {field}" if field else ""),
        seen[:1].lower() + seen[1:],
        "a sensor has name, unit (Pa, kPa, psi, N/cm2 or count) and [[pads]] with name, rows, cols, pitch_m = [x, y]",
    )


def _check_sensor(sensor: Sensor, source: str) -> None:
    if sensor.scale_pa is not None and sensor.unit != "count":
        raise SensorFileInvalid(
            source,
            "top level, field scale_pa",
            f"given for unit {sensor.unit!r}",
            "leave it out: only counts need a scale",
        )
    for name, times in Counter(pad.name for pad in sensor.pads).items():
        if times > 1:
            raise SensorFileInvalid(
                source, "table [[pads]], field name", f"{name!r} stands {times} times", "name each pad once"
            )
    for number, pad in enumerate(sensor.pads, 1):
        where = f"table [[pads]] number {number} ({pad.name}), field missing"
        for row, col in pad.missing:
            if row >= pad.rows or col >= pad.cols:
                raise SensorFileInvalid(
                    source,
                    where,
                    f"[{row}, {col}] lies outside {pad.rows} rows and {pad.cols} cols",
                    "count rows and cols from 0",
                )
        if len(set(pad.missing)) != len(pad.missing):
            raise SensorFileInvalid(source, where, "a place is listed twice", "list each place once")
        if len(pad.missing) == pad.rows * pad.cols:
            raise SensorFileInvalid(source, where, "no taxel is left", "a pad has at least one taxel")
