"""Tables of taxels in CSV files: positions, normals, areas, order.

Columns, in any order: `x_m`, `y_m`; for a curved pad also `z_m` and `nx`, `ny`, `nz`; optionally `area_m2` and `index`,
the taxel's place among those of the pad in the source's scan. Lengths may be in mm (`x_mm`, `area_mm2`).
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from taxelflow.errors import SensorFileInvalid
from taxelflow.sensors.pads import LARGEST
from taxelflow.sensors.toml_text import read_limited

if TYPE_CHECKING:
    from collections.abc import Iterable
    from importlib.resources.abc import Traversable

    from taxelflow.sensors.pads import Pad

_UNITS = {
    "x_m": 1.0,
    "y_m": 1.0,
    "z_m": 1.0,
    "x_mm": 1e-3,
    "y_mm": 1e-3,
    "z_mm": 1e-3,
    "nx": 1.0,
    "ny": 1.0,
    "nz": 1.0,
    "area_m2": 1.0,
    "area_mm2": 1e-6,
    "index": 1.0,
}
_REMEDY = "the header must be x_m,y_m or x_m,y_m,z_m,nx,ny,nz (or in mm: x_mm), optionally with area_m2 and index"


def with_table(pad: Pad, folder: Traversable | None, source: str, where: str) -> Pad:
    """The pad with the rows of the CSV file that it names, if it names one. Raises SensorFileInvalid."""
    if not isinstance(pad.taxels, str):
        return pad
    where = f"{where}, field taxels"
    if folder is None:
        raise SensorFileInvalid(
            source, where, f"file {pad.taxels!r}, but the sensor is not read from a file", "give the rows themselves"
        )
    try:
        file = folder.joinpath(pad.taxels)
        content = read_limited(file) if isinstance(file, Path) else file.read_bytes()
        text = content.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        seen = f"the table {pad.taxels!r} cannot be read ({getattr(error, 'strerror', None) or error})"
        raise SensorFileInvalid(
            source, where, seen, "give the path of a CSV file relative to the sensor file"
        ) from error
    try:
        columns = _columns(text.splitlines())
    except (ValueError, csv.Error) as error:
        raise SensorFileInvalid(source, where, f"table {pad.taxels!r}: {error}", _REMEDY) from error
    spatial = [columns[name] for name in ("x", "y", "z", "nx", "ny", "nz") if name in columns]
    fields: dict[str, Any] = {"taxels": tuple(zip(*spatial, strict=True))}
    if "area" in columns:
        fields["area_m2"] = tuple(columns["area"])
    if "index" in columns:
        fields["index"] = tuple(int(number) for number in columns["index"])
    if both := [name for name in ("area_m2", "index") if name in fields and getattr(pad, name)]:
        seen = f"{both[0]} is in the table {pad.taxels!r} and in the sensor file"
        raise SensorFileInvalid(source, where, seen, "give it once")
    return replace(pad, **fields)


def _columns(lines: Iterable[str]) -> dict[str, list[float]]:
    """Columns by plain name (x, ..., area, index), in SI. Raises ValueError."""
    rows = [row for row in csv.reader(lines) if row]
    header = [name.strip() for name in rows[0]] if rows else []
    if unknown := [name for name in header if name not in _UNITS]:
        raise ValueError(f"unknown column {unknown[0]!r}")
    names = [name.split("_")[0] for name in header]
    if len(set(names)) < len(names) or not {"x", "y"} <= set(names):
        raise ValueError(f"the columns are {','.join(header) or 'missing'}")
    if not rows[1:]:
        raise ValueError("no rows")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            raise ValueError(f"row {number} has {len(row)} fields, the header {len(header)}")
        for name, unit, field in zip(names, header, row, strict=True):
            columns[name].append(_UNITS[unit] * _number(field, number, unit))
    return columns


def _number(field: str, row: int, name: str) -> float:
    try:
        value = float(field)
    except ValueError:
        raise ValueError(f"row {row}, column {name}: {field!r} is not a number") from None
    if not abs(value) < LARGEST or (name == "index" and (value < 0 or value != int(value))):
        raise ValueError(f"row {row}, column {name}: {field} is out of range")
    if name.startswith("area") and value <= 0:
        raise ValueError(f"row {row}, column {name}: {field} is not an area above 0")
    return value
