"""Noise of each taxel, learned from the scans themselves, with a floor.

Many sensors clip idle taxels to 0, so that the noise of a tare is zero; what counts is how much a *loaded*
taxel differs from scan to scan. Second differences within a window remove whatever changes linearly (load,
slow motion), and the quietest fifth of a taxel's windows forgets those in which the object moved.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools, Floats

_QUIETEST = 0.2
_QUIETEST_OF_NORMAL = 0.706
"""That quantile of a 12-scan window's figure for normal noise of standard deviation 1."""
_SECOND_DIFFERENCE = 6.0
"""Variance of a - 2 b + c over that of one reading."""
_ENOUGH_WINDOWS = 8
_ENOUGH_CHANGES = 8
_TINY = 1e-150
"""Above 0, and so is its square."""
_CLIPPED = 0.1
"""A window in which a taxel reads its lowest value more often than this tells of clipping, not of noise."""
_UNSATURATED = 0.25
"""A taxel whose other windows are fewer than this share tells nothing of its noise."""
_READINGS = 200_000
_LEVELS = 16
_NO_GLITCH = 0.995
"""One reading beyond all others says nothing of the sensor's range."""
RANGE_FLOOR = 1e-4
"""No sensor is taken to be finer than this share of its largest reading."""


def learn_noise(
    windows: Floats, masked: Bools, step: float = 0.0, unknown: float = 0.0, ceiling: Floats | float = np.inf
) -> Floats:
    """(windows, scans, taxels) of raw pressure, NaN where missing -> (taxels,) standard deviation; 0 where masked.

    step: quantisation step of the sensor, if declared. unknown: the noise to assume while all readings are alike.
    ceiling: (taxels,), where readings saturate: there they are as quiet as where they clip.
    """
    live = windows[:, :, ~masked]
    noise = np.zeros(len(masked))
    if not live.size:
        return noise
    with np.errstate(over="ignore", invalid="ignore"):  # an absurd reading makes its window unusable, no more
        change = (live[:, :-2] - 2 * live[:, 1:-1] + live[:, 2:]) ** 2
    known = np.isfinite(change)
    count = known.sum(axis=1)
    enough = min(_ENOUGH_CHANGES, int(count.max(initial=1)))
    figure = np.sqrt(np.sum(change, axis=1, where=known) / np.maximum(count, 1) / _SECOND_DIFFERENCE)
    bottom = np.min(live, axis=(0, 1), initial=np.inf, where=np.isfinite(live))
    top = np.broadcast_to(ceiling, masked.shape)[~masked]
    lively = (count >= max(enough, 1)) & ((live <= bottom).mean(axis=1) < _CLIPPED)
    usable = lively & ((live >= top).mean(axis=1) < _CLIPPED)
    usable &= usable.sum(axis=0) > _UNSATURATED * lively.sum(axis=0)  # else only what leads up to saturation is left
    floor = max(noise_floor(live), step / 12**0.5)
    floor = floor if floor > _TINY else max(unknown, _TINY)
    pooled = _quietest(figure[usable]) if usable.sum() >= _ENOUGH_WINDOWS else floor
    own = [
        _quietest(figure[usable[:, taxel], taxel]) if usable[:, taxel].sum() >= _ENOUGH_WINDOWS else pooled
        for taxel in range(live.shape[2])
    ]
    noise[~masked] = np.maximum(own, floor)
    return noise


def noise_floor(readings: Floats) -> float:
    """Standard deviation of the quantisation step seen in any array of readings, at least a share of the largest."""
    some = readings.reshape(-1)[:: 1 + readings.size // _READINGS]
    levels = np.unique(some[np.isfinite(some)])
    if not len(levels):
        return _TINY
    largest = float(np.quantile(np.abs(levels), _NO_GLITCH))
    step = 0.0
    if len(levels) >= _LEVELS:  # fewer cannot tell a converter's step from an image of few values
        with np.errstate(over="ignore"):
            steps = np.diff(levels)
        step = float(steps[steps > 1e-9 * largest].min(initial=largest))
    return max(step / 12**0.5 if step < largest / _LEVELS else 0.0, RANGE_FLOOR * largest, _TINY)


def _quietest(figures: Floats) -> float:
    return float(np.quantile(figures, _QUIETEST)) / _QUIETEST_OF_NORMAL
