"""Method I: the largest taxel of each pad, and the variance of its place by noise."""

from __future__ import annotations

from math import erfc
from typing import NamedTuple

import numpy as np

from taxelflow.estimation.centroid.records import Pad, Place, Row, ScanBlock
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.rounding import CERTAIN
from taxelflow.runtime.compiling import inlined, kernel, lean_kernel, routine

_LARGER = np.array([0.5 * erfc(0.01 * step / np.sqrt(2.0)) for step in range(100 * int(CERTAIN) + 2)])
"""Probability that a normal number exceeds 0, 0.01, 0.02 ... standard deviations."""


class Memory:
    """The place of the largest taxel, with the covariance of a tie, in this scan and in the last usable one."""

    usable: bool
    now: Place
    last: Place


@kernel
def peak_flow(
    block: ScanBlock,
    places: Floats,
    pads: Records,
    share: float,
    memory: Records,
    rows: Records,
) -> None:
    """Fill rows (scans, pads) of `Row`, which come in as NaN; other arguments as for `convolution_flow`.

    Equal maxima: the first in scan order. Variance of the pose: that of a place unknown within its taxel (pitch^2 /
    12), plus that of a tie. The displacement of a still object has the variance of the ties only, by noise. share: of a
    reading, its standard deviation by what the sensor does not show, which ties poses.
    """
    t, pressure, noise, contact, complete = block
    for number in range(len(pads)):
        pad: Pad = pads[number]
        m: Memory = memory[number]
        for scan in range(len(t)):
            if not (contact[scan, number] and complete[scan, number]):
                m.usable = False
                continue
            own = slice(pad.begin, pad.end)
            now = m.now
            now.t_s = t[scan]
            p, x, y = pressure[scan, own], places[0, own], places[1, own]
            row: Row = rows[scan, number]
            peak = find_peak(p, noise[own])
            fill_place(p, noise[own], x, y, pad, peak, share, now)
            row.pose.x, row.pose.y, row.lag_s = now.x, now.y, 0.0
            row.pose.var_x = now.var_x + pad.gain_x * pad.gain_x * pad.pitch_x**2 / 12.0
            row.pose.var_y = now.var_y + pad.gain_y * pad.gain_y * pad.pitch_y**2 / 12.0
            row.pose.cov_xy = now.cov_xy
            if share > 0.0:
                fill_place(p, noise[own], x, y, pad, peak, 0.0, now)
            if m.usable:
                row.displacement.x, row.displacement.y = now.x - m.last.x, now.y - m.last.y
                row.displacement.var_x = now.var_x + m.last.var_x
                row.displacement.var_y = now.var_y + m.last.var_y
                row.displacement.cov_xy = now.cov_xy + m.last.cov_xy
                row.span_s = t[scan] - m.last.t_s
            m.usable = True
            m.last = now


class Peak(NamedTuple):
    """The largest taxel of a pad: its number, the first in scan order of equals. noise: the largest of its taxels."""

    taxel: int
    noise: float


@lean_kernel
def find_peak(p: Floats, noise: Floats) -> Peak:
    """That of one scan of a pad, (taxels,) each; taxels without noise are masked."""
    best, loudest = -1, 0.0
    for k in range(len(p)):
        if noise[k] > 0.0 and (best < 0 or p[k] > p[best]):
            best = k
        loudest = max(loudest, noise[k])
    return Peak(best, loudest)


@inlined
def _larger(deviations: float) -> float:
    """Probability that a normal number exceeds this many standard deviations, 0 to CERTAIN, to 3e-6."""
    place = 100.0 * deviations
    step = int(place)
    probability: float = _LARGER[step] + (place - step) * (_LARGER[step + 1] - _LARGER[step])
    return probability


@routine
def fill_place(
    p: Floats, noise: Floats, x: Floats, y: Floats, pad: Pad, peak: Peak, share: float, place: Place
) -> None:
    """Fill place from one scan of a pad, (taxels,) each: where the largest taxel is; the covariance is that of a tie.

    Each taxel weighs as much as it is likely, by the noise of both and an error of this share of each reading, to be
    larger than the largest. These errors are of gains that are spread evenly: none is beyond the root of 3 of them.
    """
    best, most = peak.taxel, np.sqrt(3.0) * share
    least = (p[best] * (1.0 - most) - CERTAIN * np.sqrt(2.0) * peak.noise) / (1.0 + most)
    own2, share2 = noise[best] ** 2 + share * share * p[best] * p[best], share * share
    weight = var_x = var_y = cov = 0.0
    for k in range(len(p)):
        if p[k] < least:
            continue
        sd2 = noise[k] ** 2 + own2 + share2 * p[k] * p[k]
        behind = p[best] - p[k]
        if noise[k] > 0.0 and behind * behind < CERTAIN**2 * sd2:
            w = _larger(behind / np.sqrt(sd2))
            ex, ey = x[k] - x[best], y[k] - y[best]
            weight += w
            var_x += w * ex * ex
            var_y += w * ey * ey
            cov += w * ex * ey
    place.x, place.y = pad.gain_x * x[best], pad.gain_y * y[best]
    place.var_x = pad.gain_x * pad.gain_x * var_x / weight
    place.var_y = pad.gain_y * pad.gain_y * var_y / weight
    place.cov_xy = pad.gain_x * pad.gain_y * cov / weight
