"""Centroid of a contact, by the readings that certainly belong to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import inlined, kernel, routine

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats

CELL_ERROR = 0.2
"""Standard deviation of a reading as a share of it: that of a gain anywhere from two to four thirds."""


class _Loaded(NamedTuple):
    """Which taxels belong to a contact."""

    sigmas: float = 4.0
    """A taxel is loaded if its reading exceeds this many standard deviations of its noise. It belongs to a contact
    ..."""
    share: float = 0.05
    """... if it also exceeds this share of the largest."""
    skirt: float = 0.03
    """Share of the largest reading below which a taxel may be unloaded: cross-talk and offsets reach that far."""
    rim: float = 1.1
    """Pitches around these readings within which others may belong to it, too: those next to them."""


LOADED = _Loaded()


class _Load(NamedTuple):
    """Where a load acts on a contact."""

    eccentric: float = 2.0
    """Standard deviation of a load's eccentricity, as a share of the radius of gyration, over the sensor's unseen
    error: friction, an arm that moves and the mount of an object shift a load by a tenth of it and more."""


LOAD = _Load()

_CELL = 1.0 / 12.0
"""Variance of a place anywhere in a cell of unit width."""


@inlined
def _belongs(reading: float, variance: float, peak: float) -> bool:
    """Whether a reading surely belongs to the contact with this largest reading."""
    return reading > LOADED.share * peak and reading * reading > LOADED.sigmas**2 * variance > 0.0


@routine
def count_loaded(reading: Floats, variance: Floats) -> int:
    """Number of readings (taxels,) that surely belong to the contact, as in `loaded_centroid`."""
    peak, count = 0.0, 0
    for i in range(len(reading)):
        peak = max(peak, reading[i] if variance[i] > 0.0 else 0.0)
    for i in range(len(reading)):
        count += _belongs(reading[i], variance[i], peak)
    return count


@kernel
def loaded_centroid(reading: Floats, variance: Floats, places: Floats, edge: Bools, out: Floats) -> None:
    """Fill out (4,): x and y of the centroid, the share of the load at the border, and the load; all 0 without load.

    reading, variance: (taxels,), variance 0 where masked. places: (2, taxels). edge: (taxels,), at the pad's border.
    """
    peak = 0.0
    for i in range(len(reading)):
        peak = max(peak, reading[i] if variance[i] > 0.0 else 0.0)
    total = x = y = border = 0.0
    for i in range(len(reading)):
        p = reading[i]
        if _belongs(p, variance[i], peak):
            total += p
            x += p * places[0, i]
            y += p * places[1, i]
            border += p if edge[i] else 0.0
    out[:] = 0.0
    if total > 0.0:
        out[0], out[1], out[2], out[3] = x / total, y / total, border / total, total


@inlined
def _around(taxel: int, reading: Floats, variance: Floats, places: Floats) -> float:
    """Mean of the readings next to a taxel, 0 if there are none: about what it would read itself."""
    total, count = 0.0, 0
    for i in range(len(reading)):
        x, y = places[0, i] - places[0, taxel], places[1, i] - places[1, taxel]
        if variance[i] > 0.0 and x * x + y * y <= LOADED.rim**2:
            total, count = total + reading[i], count + 1
    return total / max(count, 1)


@kernel
def pressure_centre(reading: Floats, variance: Floats, places: Floats, edge: Bools, out: Floats) -> None:
    """Fill out (5,) as `loaded_centroid` does, but of all readings around the contact, and the square of its reach.

    A reading next to the contact may hold load, though not surely: without it, the centre is off by up to a tenth of a
    pitch where few taxels are loaded. A masked taxel counts with what those next to it read, or the centre would jump
    by up to a pitch in a scan that lacks a reading. Readings below 0 that outweigh the load have no centre: that of
    `loaded_centroid` stays. Arguments as for `loaded_centroid`, places in pitches.
    """
    loaded_centroid(reading, variance, places, edge, out[:4])
    out[4] = 0.0
    if out[3] <= 0.0:
        return
    peak = furthest = 0.0
    for i in range(len(reading)):
        peak = max(peak, reading[i] if variance[i] > 0.0 else 0.0)
    for i in range(len(reading)):
        if _belongs(reading[i], variance[i], peak):
            x, y = places[0, i] - out[0], places[1, i] - out[1]
            furthest = max(furthest, x * x + y * y)
    reach = np.sqrt(furthest) + LOADED.rim
    total = sx = sy = border = 0.0
    for i in range(len(reading)):
        x, y = places[0, i] - out[0], places[1, i] - out[1]
        if x * x + y * y <= reach * reach:
            p = reading[i] if variance[i] > 0.0 else _around(i, reading, variance, places)
            total, sx, sy = total + p, sx + p * x, sy + p * y
            border += p if edge[i] else 0.0
    if total > 0.0:
        out[0], out[1], out[2], out[3] = out[0] + sx / total, out[1] + sy / total, border / total, total
    out[4] = reach * reach


@inlined
def eccentricity_variance(tilt: float, square: float) -> float:
    """Variance, along any direction, of where a load acts on a contact, by the mean square of its radius of gyration.

    tilt: the sensor's unseen error. A moment knows nothing of the contact's shape: it is as large across a bar.
    """
    return (LOAD.eccentric * tilt) ** 2 * square


@kernel
def centroid_covariance(
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    places: Floats,
    middle: Floats,
    error: float,
    tilt: float,
    out: Floats,
) -> None:
    """Fill out (9,): xx, xy and yy of the centroid's covariance by what it misrepresents, those by noise, and those of
    the second moment of the load about the centroid.

    places: (2, taxels) in pitches. middle: (5,), from `pressure_centre`. error: standard deviation of a reading as a
    share of it. tilt: see `eccentricity_variance`, a part of the first. A masked taxel within the contact may read what
    the others read on average; saturated ones, all together, may be wrong by what they read. All 0 without load.
    """
    out[:] = 0.0
    total = middle[3]
    if total <= 0.0:
        return
    xx = xy = yy = count = 0.0
    for i in range(len(reading)):
        p, x, y = reading[i], places[0, i] - middle[0], places[1, i] - middle[1]
        if variance[i] > 0.0 and x * x + y * y <= middle[4]:
            load = max(p, 0.0)  # noise about 0 has no extent
            xx, xy, yy, count = xx + load * x * x, xy + load * x * y, yy + load * y * y, count + 1.0
    xx, xy, yy = xx / total, xy / total, yy / total
    mean, within, far_x, far_y = total / count, 2.0 * (xx + yy), 0.0, 0.0
    for i in range(len(reading)):
        p = reading[i]
        x, y = places[0, i] - middle[0], places[1, i] - middle[1]
        wrong = noise = 0.0
        if variance[i] > 0.0 and x * x + y * y <= middle[4]:
            wrong, noise = (error * p / total) ** 2, variance[i] / (total * total)
            if p >= ceiling[i]:
                far_x, far_y = far_x + p * abs(x) / total, far_y + p * abs(y) / total
        elif variance[i] == 0.0 and x * x + y * y < within:
            wrong = (mean / total) ** 2
        out[0], out[1], out[2] = out[0] + wrong * x * x, out[1] + wrong * x * y, out[2] + wrong * y * y
        out[3], out[4], out[5] = out[3] + noise * x * x, out[4] + noise * x * y, out[5] + noise * y * y
    shifted = eccentricity_variance(tilt, 0.5 * (xx + yy))
    out[6], out[7], out[8] = xx, xy, yy
    out[0], out[2] = out[0] + shifted, out[2] + shifted
    xx, xy, yy = inverse2(1.0 + xx / _CELL, xy / _CELL, 1.0 + yy / _CELL)
    out[0], out[2] = out[0] + _CELL * xx + far_x * far_x, out[2] + _CELL * yy + far_y * far_y
    out[1] += _CELL * xy
