"""The fast form of Method II: centroids in one pass, and their covariance from the noise of the taxels.

The centroid of a full convolution is the sum of the two centroids. With c[T] the 1-based pressure-weighted centroid of
scan T and N the columns of the pad, the paper's equations become
    (2), (3)  i[T] - N = c[T-1] + c[T] - (N + 1),
    (6)       S[T] = i[T] - i[T-1] = c[T] - c[T-2]: the motion over two scans, half a scan late.
`paper_reference` holds the equations to the letter; a test holds both equal.

Here c is in m from the pad's middle (y up, against the row index) and times the calibration's gain, which removes
the (N + 1), and one scan's motion is half of S:
    x[T] = (c[T-1] + c[T]) / 2,   dx[T] = x[T] - x[T-1] = (c[T] - c[T-2]) / 2.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from taxelflow.estimation.centroid.records import Pad, Place, Row, ScanBlock
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records, records
from taxelflow.runtime.compiling import kernel, routine


class NoiseSums:
    """Sums of noise^2 times 1, x, y, x^2, y^2 and xy over the taxels of a pad that have noise, and the least of them.

    least_x, least_y: noise^2 of a mean taxel times half a pitch squared.
    """

    s: float
    x: float
    y: float
    xx: float
    yy: float
    xy: float
    least_x: float
    least_y: float


class Memory:
    """What is kept of a pad. usable: how many usable scans came in a row before this one.

    centroids: of this scan and the two before, c[T] at `usable` modulo 3. noise: scratch.
    """

    usable: int
    centroids: Annotated[Records, Place, 3]
    noise: NoiseSums


@kernel
def convolution_flow(
    block: ScanBlock,
    places: Floats,
    pads: Records,
    noise_sums: Records,
    memory: Records,
    rows: Records,
) -> None:
    """Fill rows (scans, pads) of `Row`, which come in as NaN.

    places: (2, taxels), m. pads, noise_sums, memory: (pads,) of `Pad`, `NoiseSums` and `Memory`; memory is kept from
    block to block. The index needs two usable scans in a row, the slip vector three; a scan without contact, or with
    a missing loaded taxel, begins again, so that nothing jumps at lift-off and re-contact.
    """
    t, pressure, noise, contact, complete = block
    for number in range(len(pads)):
        pad: Pad = pads[number]
        m: Memory = memory[number]
        x, y = places[0, pad.begin : pad.end], places[1, pad.begin : pad.end]
        own_noise = noise[pad.begin : pad.end]
        for scan in range(len(t)):
            if not (contact[scan, number] and complete[scan, number]):
                m.usable = 0
                continue
            c = m.centroids
            now, last, before = c[m.usable % 3], c[(m.usable + 2) % 3], c[(m.usable + 1) % 3]
            now.t_s = t[scan]
            centroid(pressure[scan, pad.begin : pad.end], own_noise, x, y, pad, noise_sums[number], m.noise, now)
            if m.usable >= 1:
                index(last, now, rows[scan, number])
            if m.usable >= 2:
                slip_vector(before, now, rows[scan, number])
            m.usable += 1


@routine
def centroid(
    p: Floats, noise: Floats, x: Floats, y: Floats, pad: Pad, usual: NoiseSums, scratch: NoiseSums, c: Place
) -> None:
    """Fill c with the pressure-weighted centroid of a scan's pad, (taxels,) each, and its covariance.

    c = sum(p r) / sum(p), so dc/dp_i = (r_i - c) / sum(p): first-order propagation of the taxels' noise. usual: sums of
    the noise if no taxel reads 0.
    """
    s, sx, sy, has_zeros = weighted_sums(p, x, y, pad.row_length)
    cx, cy = sx / s, sy / s  # contact means that s stands well above its noise
    g = 1.0 / (s * s)
    g_x, g_y = pad.gain_x * pad.gain_x * g, pad.gain_y * pad.gain_y * g
    n = usual
    if has_zeros:
        n = scratch
        sum_noise(noise, x, y, p, n)
    # At least what one taxel half a pitch aside would do: clipped neighbours are quiet, not without noise.
    c.var_x = max(g_x * (n.xx - 2.0 * cx * n.x + cx * cx * n.s), g_x * usual.least_x)
    c.var_y = max(g_y * (n.yy - 2.0 * cy * n.y + cy * cy * n.s), g_y * usual.least_y)
    c.cov_xy = pad.gain_x * pad.gain_y * g * (n.xy - cx * n.y - cy * n.x + cx * cy * n.s)
    c.x, c.y = pad.gain_x * cx, pad.gain_y * cy


@routine
def index(last: Place, now: Place, row: Row) -> None:
    """Position from equations (2) and (3): the mean of c[T-1] and c[T], half a scan old."""
    row.pose.x, row.pose.y = 0.5 * (last.x + now.x), 0.5 * (last.y + now.y)
    row.pose.var_x = 0.25 * (last.var_x + now.var_x)
    row.pose.var_y = 0.25 * (last.var_y + now.var_y)
    row.pose.cov_xy = 0.25 * (last.cov_xy + now.cov_xy)
    row.lag_s = 0.5 * (now.t_s - last.t_s)


@routine
def slip_vector(before: Place, now: Place, row: Row) -> None:
    """Displacement from equation (6): half of c[T] - c[T-2], in half of the time between them."""
    row.displacement.x, row.displacement.y = 0.5 * (now.x - before.x), 0.5 * (now.y - before.y)
    row.displacement.var_x = 0.25 * (before.var_x + now.var_x)
    row.displacement.var_y = 0.25 * (before.var_y + now.var_y)
    row.displacement.cov_xy = 0.25 * (before.cov_xy + now.cov_xy)
    row.span_s = 0.5 * (now.t_s - before.t_s)


@routine
def weighted_sums(p: Floats, x: Floats, y: Floats, row_length: int) -> tuple[float, float, float, bool]:
    """Sums of p, p x, p y over (taxels,), and whether some p is 0. row_length: of a full grid's rows if they are long.

    Slices that start at 0 are what the compiler can vectorise; on long rows y is applied once a row, and one load and
    one product a taxel are saved.
    """
    s = sx = sy = 0.0
    zeros = np.int64(0)
    if row_length == 0:
        for k in range(len(p)):
            s += p[k]
            sx += p[k] * x[k]
            sy += p[k] * y[k]
            zeros |= np.int64(p[k] == 0.0)
        return s, sx, sy, bool(zeros > 0)
    for start in range(0, len(p), row_length):
        row_s, row_sx, row_zeros = _row_sums(p[start : start + row_length], x[:row_length])
        s += row_s
        sx += row_sx
        sy += row_s * y[start]
        zeros |= row_zeros
    return s, sx, sy, bool(zeros > 0)


@routine
def _row_sums(p: Floats, x: Floats) -> tuple[float, float, np.int64]:
    s = sx = 0.0
    zeros = np.int64(0)
    for k in range(len(x)):
        s += p[k]
        sx += p[k] * x[k]
        zeros |= np.int64(p[k] == 0.0)
    return s, sx, zeros


@routine
def sum_noise(noise: Floats, x: Floats, y: Floats, reading: Floats, sums: NoiseSums) -> None:
    """Fill the sums over the taxels (taxels,) whose reading is not 0: where it is, the sensor clips, without noise."""
    s = sx = sy = sxx = syy = sxy = 0.0
    for k in range(len(noise)):
        variance = noise[k] * noise[k] if reading[k] != 0.0 else 0.0
        s += variance
        sx += variance * x[k]
        sy += variance * y[k]
        sxx += variance * x[k] * x[k]
        syy += variance * y[k] * y[k]
        sxy += variance * x[k] * y[k]
    sums.s, sums.x, sums.y, sums.xx, sums.yy, sums.xy = s, sx, sy, sxx, syy, sxy


def noise_sums(noise: Floats, places: Floats, pads: Records) -> Records:
    """(pads,) of `NoiseSums` for scans in which no taxel reads 0. noise: (taxels,). places: (2, taxels)."""
    held = records(NoiseSums, len(pads))
    _sum_pads(noise, places, pads, held)
    return held


@kernel
def _sum_pads(noise: Floats, places: Floats, pads: Records, held: Records) -> None:
    for number in range(len(pads)):
        _sum_pad(noise, places, pads[number], held[number])


@routine
def _sum_pad(noise: Floats, places: Floats, pad: Pad, sums: NoiseSums) -> None:
    own = noise[pad.begin : pad.end]
    sum_noise(own, places[0, pad.begin : pad.end], places[1, pad.begin : pad.end], own, sums)
    mean = sums.s / (pad.end - pad.begin)
    sums.least_x, sums.least_y = mean * (0.5 * pad.pitch_x) ** 2, mean * (0.5 * pad.pitch_y) ** 2
