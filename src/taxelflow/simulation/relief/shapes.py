"""Height maps of twelve reliefs, as functions of normalised body coordinates.

s, t: (...), body coordinates over half the object's size. Heights (...) are in units of the relief's height, 0 at the
top and negative below it. Edges are rounded, as on real objects, so that heights are continuous.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.messages import Floats

DEEPEST = 6.0
"""Depth at which a height map ends, in heights of the relief: deeper than any skin is pressed."""
_FILLET = 0.08
"""Radius of rounded edges."""
_STROKE = 0.09
"""Half the width of the strokes of a letter."""
_LETTERS = (
    ((-0.75, -0.45), (-0.75, 0.45)), ((-0.75, 0.45), (-0.25, 0.45)), ((-0.75, 0.02), (-0.35, 0.02)),  # F
    ((0.0, 0.45), (0.0, -0.45)), ((0.0, -0.45), (0.42, -0.45)),  # L
    ((0.62, 0.45), (0.92, -0.45)),  # a stroke of a third
)  # fmt: skip
_FEET = ((0.72, -0.1, 0.26, 0.0), (-0.48, 0.62, 0.2, 0.05), (-0.3, -0.68, 0.32, 0.1))
"""Places, radii and heights below the top of the tripod's feet."""
_WAVES = 14
"""Cosines in a random texture."""
_SLOTS = ((0.28, 0.16), (0.5, 0.1), (0.72, 0.18))
"""Places along the blade of the key and depths of its cuts."""


def _edge(outside: Floats) -> Floats:
    """Height beside an edge. outside: (...), distance out of the outline, negative inside."""
    over = np.maximum(outside + _FILLET, 0.0)
    height: Floats = -(over**2) / (2 * _FILLET**2)
    return height


def _hexagon(s: Floats, t: Floats, flats: float) -> Floats:
    """Distance out of a hexagon with that distance from its centre to its sides."""
    sides = [np.abs(np.cos(a) * s + np.sin(a) * t) for a in (0.0, np.pi / 3, 2 * np.pi / 3)]
    outside: Floats = np.max(sides, axis=0) - flats
    return outside


def _box(s: Floats, t: Floats, half: tuple[float, float]) -> Floats:
    """Distance out of a rectangle about the origin."""
    ds, dt = np.abs(s) - half[0], np.abs(t) - half[1]
    outside: Floats = np.hypot(np.maximum(ds, 0), np.maximum(dt, 0)) + np.minimum(np.maximum(ds, dt), 0)
    return outside


def _stroke(s: Floats, t: Floats, ends: tuple[tuple[float, float], tuple[float, float]]) -> Floats:
    """Distance from a straight line between two points."""
    (s0, t0), (s1, t1) = ends
    length2 = (s1 - s0) ** 2 + (t1 - t0) ** 2
    along = np.clip(((s - s0) * (s1 - s0) + (t - t0) * (t1 - t0)) / length2, 0.0, 1.0)
    distance: Floats = np.hypot(s - s0 - along * (s1 - s0), t - t0 - along * (t1 - t0))
    return distance


def _fluted(s: Floats, t: Floats, flutes: int) -> Floats:
    """A barrel with its axis along s, and flutes along the axis that end before its ends."""
    barrel = -1.2 * (t / 0.55) ** 2 - 0.5 * s**2 + _edge(np.abs(s) - 0.95)
    inside = np.clip((0.8 - np.abs(s + 0.05)) / 0.2, 0.0, 1.0)
    flute: Floats = barrel - 0.35 * inside * (1 - np.cos(2 * np.pi * flutes * t / 1.1))
    return flute


def handle(s: Floats, t: Floats) -> Floats:
    """A barrel with four flutes."""
    return _fluted(s, t, 4)


def fine_handle(s: Floats, t: Floats) -> Floats:
    """A barrel with twelve flutes."""
    return _fluted(s, t, 12)


def nut(s: Floats, t: Floats) -> Floats:
    """A flat hexagon with a round hole."""
    return _edge(np.maximum(_hexagon(s, t, 0.86), 0.45 - np.hypot(s, t)))


def bolt(s: Floats, t: Floats) -> Floats:
    """A slightly domed hexagon with a raised mark on one side."""
    mark = 0.35 * np.exp(-((s - 0.35) ** 2 + (t + 0.25) ** 2) / 0.03)
    height: Floats = _edge(_hexagon(s, t, 0.86)) - 0.35 * (s**2 + t**2) + mark - 0.35
    return height


def key(s: Floats, t: Floats) -> Floats:
    """A round bow with a hole, and a blade with three cuts."""
    bow = np.maximum(np.hypot(s + 0.55, t) - 0.42, 0.14 - np.hypot(s + 0.68, t))
    blade = _box(s - 0.4, t, (0.58, 0.15))
    for at, deep in _SLOTS:
        blade = np.maximum(blade, np.minimum(0.07 - np.abs(s - at), t - 0.15 + deep))
    return _edge(np.minimum(bow, blade))


def coin(s: Floats, t: Floats) -> Floats:
    """A coin on its edge, which is a narrow band."""
    height: Floats = _edge(np.abs(t) - 0.18) - 0.9 * s**2
    return height


def ring(s: Floats, t: Floats) -> Floats:
    """A round wire bent to a ring, open on one side."""
    wire = -(((np.hypot(s, t) - 0.78) / 0.16) ** 2)
    open_by = np.cos(np.arctan2(t, s) - 0.6) - np.cos(np.radians(22.0))
    height: Floats = wire - np.maximum(open_by * 60, 0.0)
    return height


def letters(s: Floats, t: Floats) -> Floats:
    """A plate with raised letters."""
    raised = np.min([_stroke(s, t, ends) for ends in _LETTERS], axis=0) - _STROKE
    height: Floats = np.maximum(_edge(raised), -0.7) + _edge(_box(s, t, (0.98, 0.62)))
    return height


def dome(s: Floats, t: Floats) -> Floats:
    """A sphere."""
    height: Floats = -1.2 * (s**2 + t**2)
    return height


def bar(s: Floats, t: Floats) -> Floats:
    """A round bar with round ends, thicker at one end."""
    distance = _stroke(s, t, ((-0.78, 0.0), (0.78, 0.0)))
    height: Floats = -((distance / 0.24) ** 2) + 0.12 * (s - 1)
    return height


def cloth(s: Floats, t: Floats, seed: int) -> Floats:
    """A random relief of cosines on a flat dome."""
    random = np.random.default_rng([seed, 11])
    number = 2 * np.pi / random.uniform(0.3, 0.7, _WAVES)
    direction, phase = random.uniform(-np.pi, np.pi, (2, _WAVES))
    relief = sum(
        np.cos(k * (np.cos(a) * s + np.sin(a) * t) + p) for k, a, p in zip(number, direction, phase, strict=True)
    )
    height: Floats = 0.3 * np.sqrt(2 / _WAVES) * relief - 0.6 + _edge(np.hypot(s, t) - 0.92) - 0.3 * (s**2 + t**2)
    return height


def tripod(s: Floats, t: Floats) -> Floats:
    """Three round feet of different sizes."""
    feet = [-(((s - s0) ** 2 + (t - t0) ** 2) / radius**2) - low for s0, t0, radius, low in _FEET]
    height: Floats = np.max(feet, axis=0)
    return height


SHAPES: dict[str, Callable[[Floats, Floats], Floats]] = {
    "handle": handle, "fine-handle": fine_handle, "nut": nut, "bolt": bolt, "key": key, "coin": coin,
    "ring": ring, "letters": letters, "dome": dome, "bar": bar, "tripod": tripod,
}  # fmt: skip
"""All but cloth, which has a seed."""


def height_of(shape: str, s: Floats, t: Floats, seed: int = 0) -> Floats:
    """Height (...) of a shape at (s, t), between -DEEPEST and its top."""
    height = cloth(s, t, seed) if shape == "cloth" else SHAPES[shape](s, t)
    return np.maximum(height, -DEEPEST)
