"""Second central moments of the pressure: the direction of its long axis, with first-order uncertainty.

With weights p_i, sum s, centroid c and (x_i, y_i) from it:  u = mean(x^2 - y^2), v = mean(2 x y),
axis = atan2(v, u) / 2, anisotropy A = hypot(u, v). The centroid's own motion drops out to first order, so
du/dp_i = (x_i^2 - y_i^2 - u) / s,  dv/dp_i = (2 x_i y_i - v) / s,
d axis = (u dv - v du) / (2 A^2),  dA = (u du + v dv) / A.

An axis has no head: it is known up to half turns, and followed from scan to scan by the smaller turn. It must turn by
less than a quarter turn between two scans (or while it is unknown within a contact).
"""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.centroid.records import Estimate, Pad, Row, ScanBlock
from taxelflow.messages import Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import kernel, routine


class Bounds:
    """Beyond these the axis is unknown; see `PrincipalAxis`."""

    most_std_rad: float
    sigmas: float
    least_anisotropy: float


class Moments:
    """Sums over a pad's scan: load, centroid, u, v, the mean square radius, and the mean variance of a taxel."""

    s: float
    x: float
    y: float
    u: float
    v: float
    size: float
    mean_variance: float


class Memory:
    """What is kept of a pad. `theta` of now and last is the axis itself, NaN where it is unknown.

    usable: the last scan was; t_s: its time. has_axis: an axis has been known in this contact; axis: the last one,
    theta: the turn since the first, first_variance: the variance of the first. moments: scratch.
    """

    usable: bool
    t_s: float
    now: Estimate
    last: Estimate
    has_axis: bool
    axis: float
    theta: float
    first_variance: float
    moments: Moments


@kernel
def axis_motion(
    block: ScanBlock,
    places: Floats,
    pads: Records,
    bounds: Records,
    memory: Records,
    rows: Records,
) -> None:
    """Fill rows (scans, pads) of `Row`, which come in as NaN; other arguments as for `convolution_flow`.

    bounds: (1,) of `Bounds`. A scan with a missing loaded taxel interrupts displacement, not the turn; a lift-off ends
    both.
    """
    t, pressure, noise, contact, complete = block
    for number in range(len(pads)):
        pad: Pad = pads[number]
        m: Memory = memory[number]
        own = slice(pad.begin, pad.end)
        for k in range(len(t)):
            if not contact[k, number]:
                m.has_axis = False
            if not (contact[k, number] and complete[k, number]):
                m.usable = False
                continue
            p, x, y = pressure[k, own], places[0, own], places[1, own]
            sum_moments(p, noise[own], x, y, m.moments)
            measure(p, noise[own], x, y, m.moments, pad, bounds[0], m.now)
            row: Row = rows[k, number]
            follow_axis(m, row.pose)
            row.lag_s = 0.0
            if m.usable:
                step(m.last, m.now, row.displacement)
                row.span_s = t[k] - m.t_s
            m.usable, m.t_s = True, t[k]
            m.last = m.now


@routine
def sum_moments(p: Floats, noise: Floats, x: Floats, y: Floats, sums: Moments) -> None:
    """Fill the sums over one pad's scan, (taxels,) each."""
    s = sx = sy = mean_variance = 0.0
    for i in range(len(p)):
        s += p[i]
        sx += p[i] * x[i]
        sy += p[i] * y[i]
        mean_variance += noise[i] ** 2 / len(p)
    cx, cy = sx / s, sy / s  # contact means that s stands well above its noise
    u = v = size = 0.0
    for i in range(len(p)):
        dx, dy = x[i] - cx, y[i] - cy
        u += p[i] * (dx * dx - dy * dy) / s
        v += p[i] * 2.0 * dx * dy / s
        size += p[i] * (dx * dx + dy * dy) / s
    sums.s, sums.x, sums.y, sums.u, sums.v = s, cx, cy, u, v
    sums.size, sums.mean_variance = size, mean_variance


@routine
def measure(
    p: Floats, noise: Floats, x: Floats, y: Floats, sums: Moments, pad: Pad, bounds: Bounds, out: Estimate
) -> None:
    """Fill out with centroid and axis of one pad's scan, (taxels,) each, and their covariance.

    A taxel that reads 0 has no noise; the variances are at least what one taxel half a pitch aside would do.
    """
    s, u, v = sums.s, sums.u, sums.v
    anisotropy = np.hypot(u, v)
    round_ = not anisotropy > 0.0
    var_x = var_y = var_axis = cov_xy = cov_xt = cov_yt = var_anisotropy = 0.0
    for i in range(len(p)):
        if p[i] == 0.0:
            continue
        dx, dy, n = x[i] - sums.x, y[i] - sums.y, noise[i] ** 2
        gx, gy = dx / s, dy / s
        var_x += n * gx * gx
        var_y += n * gy * gy
        cov_xy += n * gx * gy
        if round_:
            continue
        du, dv = (dx * dx - dy * dy - u) / s, (2.0 * dx * dy - v) / s
        gt = 0.5 * (u * dv - v * du) / (anisotropy * anisotropy)
        g_anisotropy = (u * du + v * dv) / anisotropy
        var_axis += n * gt * gt
        cov_xt += n * gx * gt
        cov_yt += n * gy * gt
        var_anisotropy += n * g_anisotropy * g_anisotropy
    least = sums.mean_variance / (s * s)
    half_x, half_y = 0.5 * pad.pitch_x, 0.5 * pad.pitch_y
    if not round_:
        var_axis = max(var_axis, least * max(half_x, half_y) ** 2 / (0.5 * (sums.size + anisotropy)))
    needed = max(bounds.sigmas * np.sqrt(var_anisotropy), bounds.least_anisotropy * sums.size)
    known = anisotropy > needed and var_axis <= bounds.most_std_rad**2 and sums.size > 0.0 and not round_
    out.x, out.y = sums.x, sums.y
    out.theta = 0.5 * np.arctan2(v, u) if known else np.nan
    out.var_x, out.var_y = max(var_x, least * half_x**2), max(var_y, least * half_y**2)
    out.var_theta, out.cov_xy, out.cov_x_theta, out.cov_y_theta = var_axis, cov_xy, cov_xt, cov_yt


@routine
def follow_axis(m: Memory, pose: Estimate) -> None:
    """Fill the pose, whose theta is the turn since the first axis of the contact, and keep the axis in memory."""
    now = m.now
    pose.x, pose.y = now.x, now.y
    pose.var_x, pose.var_y, pose.cov_xy = now.var_x, now.var_y, now.cov_xy
    if np.isnan(now.theta):
        return
    if not m.has_axis:
        m.has_axis, m.axis, m.theta, m.first_variance = True, now.theta, 0.0, now.var_theta
        pose.theta = pose.var_theta = pose.cov_x_theta = pose.cov_y_theta = 0.0  # theta is 0 by definition
        return
    turn = now.theta - m.axis
    m.theta += turn - np.pi * np.round(turn / np.pi)
    m.axis = now.theta
    pose.theta, pose.var_theta = m.theta, now.var_theta + m.first_variance
    pose.cov_x_theta, pose.cov_y_theta = now.cov_x_theta, now.cov_y_theta


@routine
def step(last: Estimate, now: Estimate, out: Estimate) -> None:
    """Fill out with the displacement between two scans; the turn is the smaller one, NaN if an axis is unknown."""
    turn = now.theta - last.theta
    out.x, out.y = now.x - last.x, now.y - last.y
    out.var_x, out.var_y = now.var_x + last.var_x, now.var_y + last.var_y
    out.cov_xy = now.cov_xy + last.cov_xy
    if not np.isnan(turn):
        out.theta = turn - np.pi * np.round(turn / np.pi)
        out.var_theta = now.var_theta + last.var_theta
        out.cov_x_theta, out.cov_y_theta = now.cov_x_theta + last.cov_x_theta, now.cov_y_theta + last.cov_y_theta
