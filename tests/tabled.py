"""Sensor files, and sensors whose pads are tables, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor, parse_sensor

if TYPE_CHECKING:
    from taxelflow.messages import Floats


GOOD = """
name = "hand"
unit = "kPa"
[[pads]]
name = "palm"
rows = 2
cols = 3
pitch_m = [0.01, 0.012]
missing = [[0, 0]]
[[pads]]
name = "tip"
rows = 1
cols = 1
pitch_m = [0.004, 0.004]
"""

POINTS = "taxels = [[0, 0], [0.003, 0], [0, 0.004]]"
INLINE = f'name = "hand"\nunit = "kPa"\n[[pads]]\nname = "tip"\n{POINTS}\n'
CURVED = "taxels = [[0, 0, 0, 0, 0, 1], [0.003, 0, 0, 0, 0, 1], [0, 0.004, 0, 0, 0, 1]]"


def parse(text: str) -> Sensor:
    return parse_sensor(text.encode(), "hand.toml")


def hexagonal(rings: int, pitch_m: float = 0.005) -> Floats:
    """(taxels, 2): a hexagon of rings around one taxel."""
    steps = range(-rings, rings + 1)
    places = [(a + b / 2, b * np.sqrt(3) / 2) for b in steps for a in steps if abs(a + b) <= rings]
    return pitch_m * np.array(places)


def square(rows: int, cols: int, pitch_m: float = 0.01) -> Floats:
    """(taxels, 2): where a grid of that size has its taxels, row-major."""
    row, col = np.divmod(np.arange(rows * cols), cols)
    return pitch_m * np.stack([col - (cols - 1) / 2, (rows - 1) / 2 - row], axis=1)


def arched(rows: int, cols: int, radius_m: float, pitch_m: float = 0.004) -> tuple[Floats, Floats]:
    """A grid bent around a cylinder along y: (taxels, 2) as it is unrolled, (taxels, 6) places and normals."""
    flat = square(rows, cols, pitch_m)
    angle = flat[:, 0] / radius_m
    normal = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    place = radius_m * normal
    place[:, 1] = flat[:, 1]
    return flat, np.concatenate([place, normal], axis=1)


def table_sensor(*tables: Floats, **fields: Any) -> Sensor:
    pads = tuple(
        Pad(name=f"pad{number}", taxels=tuple(map(tuple, table.tolist()))) for number, table in enumerate(tables)
    )
    return Sensor(**{"name": "table", "unit": "Pa", "pads": pads, **fields})
