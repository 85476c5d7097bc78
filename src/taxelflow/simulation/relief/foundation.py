"""The skin of one pad as a fine grid of points, and what each taxel reads of the pressure on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_array

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout
    from taxelflow.simulation.relief.parameters import Skin


@dataclass(frozen=True, slots=True)
class _Points:
    """Points of the skin."""

    count: int = 32_000
    """Points of a grid, about: ten a pitch along each axis of a 16x16 pad. Readings are then within some 0.3 % of the
    largest one of what a much finer grid gives, 0.04 % RMS."""
    margin: float = 1.0
    """Width of the skin beyond the outermost taxels' centres, pitches."""
    negligible: float = 1e-7
    """Weight of a point below which a taxel does not read it."""


_POINTS = _Points()


@dataclass(frozen=True, slots=True, eq=False)
class Foundation:
    """Points of the skin, and the taxels on it.

    x_m, y_m: (points,), places in the pad's frame. cell_m2: area of a point. weights: (taxels, points), sparse: the
    mean over a taxel's area of the pressure that the cover spreads; a row sums to 1 where no pressure is lost beyond
    the skin's border. bare: the same without cover.
    """

    x_m: Floats
    y_m: Floats
    cell_m2: float
    weights: csr_array
    bare: csr_array


def foundation_of(layout: Layout, pad: int, skin: Skin) -> Foundation:
    """The skin of pad number `pad`: its taxels' bounding rectangle and a pitch around it."""
    own = layout.of_pad(pad)
    pitch_m, square = layout.pitch_m[pad], bool(layout.tables[pad])
    places = np.stack([layout.x_m[own], layout.y_m[own]])
    extent = np.ptp(places, axis=1) / pitch_m + 2 * _POINTS.margin
    a_pitch = max(3, round(np.sqrt(_POINTS.count / float(np.prod(extent)))))
    step = pitch_m / a_pitch
    sides = np.sqrt(layout.area_m2[own]) if square else np.ones(own.stop - own.start)
    axes, spread, flat = [], [], []
    for axis in (0, 1):
        start = places[axis].min() - _POINTS.margin * pitch_m[axis]
        centres = start + step[axis] * (np.arange(round(extent[axis] * a_pitch)) + 0.5)
        half = skin.active_share * (sides if square else pitch_m[axis] * sides) / 2
        weights = _overlap(places[axis], half, centres, step[axis])
        sigma = skin.cover_m[axis] / step[axis]
        axes.append(centres)
        flat.append(weights)
        spread.append(gaussian_filter1d(weights, sigma, mode="constant", axis=1) if sigma else weights)
    x_m, y_m = np.meshgrid(axes[0], axes[1])
    return Foundation(x_m.ravel(), y_m.ravel(), float(np.prod(step)), _product(spread), _product(flat))


def _overlap(centre: Floats, half: Floats, points: Floats, step: float) -> Floats:
    """Share (taxels, points) of the interval centre +- half that lies in the cells of width `step` about the points."""
    low = np.maximum((centre - half)[:, np.newaxis], points - step / 2)
    high = np.minimum((centre + half)[:, np.newaxis], points + step / 2)
    share: Floats = np.maximum(high - low, 0.0) / (2 * half[:, np.newaxis])
    return share


def _product(along: list[Floats]) -> csr_array:
    """Weights (taxels, points) of rectangles from those along x (taxels, nx) and y (taxels, ny)."""
    whole = along[1][:, :, np.newaxis] * along[0][:, np.newaxis, :]
    whole[whole < _POINTS.negligible] = 0.0
    return csr_array(whole.reshape(len(whole), -1))
