"""Second central moments of the pressure: the direction of its long axis, with first-order uncertainty.

With weights p_i, sum s, centroid c and (x_i, y_i) from it:  u = mean(x^2 - y^2), v = mean(2 x y),
axis = atan2(v, u) / 2, anisotropy A = hypot(u, v). The centroid's own motion drops out to first order, so
du/dp_i = (x_i^2 - y_i^2 - u) / s,  dv/dp_i = (2 x_i y_i - v) / s,
d axis = (u dv - v du) / (2 A^2),  dA = (u du + v dv) / A.

An axis has no head: it is known up to half turns, and followed from scan to scan by the smaller turn. It must turn by
less than a quarter turn between two scans (or while it is unknown within a contact).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Bools, Floats, Scans, Slips, judged, no_scans
from taxelflow.sensors.border import border_of, mark_border

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.sensors.layout import Layout

# Memory per pad. _RUN: the last scan was usable; _T its time; _POSE its x, y, axis (NaN if unknown) and _COV their
# covariance xx, yy, tt, xy, xt, yt. _SINCE: an axis has been known in this contact; _AXIS the last one known, _THETA
# the turn since the first, _FIRST the variance of the first.
_RUN, _T, _POSE, _COV, _SINCE, _AXIS, _THETA, _FIRST, MEMORY = 0, 1, 2, 5, 11, 12, 13, 14, 15


class AxisSession:
    """anisotropy causal estimator of position and turn. Nothing is kept but the kernel's few numbers per pad."""

    def __init__(self, layout: Layout, most_std_rad: float, sigmas: float, least_anisotropy: float) -> None:
        self._layout = layout
        self._places = np.stack([layout.x_m, layout.y_m])
        self._bounds = np.array([most_std_rad, sigmas, least_anisotropy])
        self._edge = border_of(layout)
        self._memory = np.zeros((len(layout.pads), MEMORY))
        self.finish()  # compiles the kernels, or loads them from the cache, before the loop begins

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; see `EstimatorSession.step`."""
        layout = self._layout
        slips = Slips.unknown(scans, layout.starts)
        axis_motion(
            scans.t_s,
            scans.pressure,
            scans.noise,
            scans.contact,
            scans.complete,
            self._places,
            layout.starts,
            layout.pitch_m,
            self._bounds,
            self._memory,
            slips.pose,
            slips.covariance,
            slips.displacement,
            slips.displacement_covariance,
            slips.span_s,
            slips.lag_s,
        )
        mark_border(scans.pressure, scans.noise, scans.contact, *self._edge, slips.border)
        slips.quality[...] = judged(slips.pose, slips.border)
        return slips

    def finish(self) -> Slips:
        """Nothing is held back."""
        return self.step(no_scans(self._layout.entries, len(self._layout.pads)))


@kernel
def moments(p: Floats, noise: Floats, x: Floats, y: Floats, floor_m: Floats, bounds: Floats, out: Floats) -> None:
    """Fill out (9,) with x, y, axis and their covariance xx, yy, tt, xy, xt, yt, for one pad's scan p (taxels,).

    floor_m: (2,), half the pitch. bounds: most_std_rad, sigmas, least_anisotropy; beyond them the axis is NaN.
    anisotropy taxel that reads 0 has no noise; the covariance is at least what one taxel half a pitch aside would do.
    """
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
    anisotropy = np.hypot(u, v)
    axis = 0.5 * np.arctan2(v, u)
    out[3:] = 0.0
    var_anisotropy = 0.0
    for i in range(len(p)):
        if p[i] != 0.0 and anisotropy > 0.0:
            dx, dy = x[i] - cx, y[i] - cy
            gx, gy = dx / s, dy / s
            du, dv = (dx * dx - dy * dy - u) / s, (2.0 * dx * dy - v) / s
            gt = 0.5 * (u * dv - v * du) / (anisotropy * anisotropy)
            g_anisotropy = (u * du + v * dv) / anisotropy
            n = noise[i] ** 2
            out[3] += n * gx * gx
            out[4] += n * gy * gy
            out[5] += n * gt * gt
            out[6] += n * gx * gy
            out[7] += n * gx * gt
            out[8] += n * gy * gt
            var_anisotropy += n * g_anisotropy * g_anisotropy
        elif p[i] != 0.0:
            out[3] += (noise[i] * (x[i] - cx) / s) ** 2
            out[4] += (noise[i] * (y[i] - cy) / s) ** 2
            out[6] += noise[i] ** 2 * (x[i] - cx) * (y[i] - cy) / (s * s)
    least = mean_variance / (s * s)
    out[3] = max(out[3], least * floor_m[0] ** 2)
    out[4] = max(out[4], least * floor_m[1] ** 2)
    if anisotropy > 0.0:
        out[5] = max(out[5], least * max(floor_m[0], floor_m[1]) ** 2 / (0.5 * (size + anisotropy)))
    needed = max(bounds[1] * np.sqrt(var_anisotropy), bounds[2] * size)
    sure = anisotropy > needed and out[5] <= bounds[0] ** 2
    out[0], out[1] = cx, cy
    out[2] = axis if sure and size > 0.0 and anisotropy > 0.0 else np.nan


@kernel
def spread(parts: Floats, matrix: Floats, known: bool) -> None:
    """Six numbers xx, yy, tt, xy, xt, yt into a symmetric (3, 3); theta's only if it is known."""
    matrix[0, 0], matrix[1, 1] = parts[0], parts[1]
    matrix[0, 1] = matrix[1, 0] = parts[3]
    if known:
        matrix[2, 2] = parts[2]
        matrix[0, 2] = matrix[2, 0] = parts[4]
        matrix[1, 2] = matrix[2, 1] = parts[5]


@kernel
def follow(now: Floats, m: Floats, pose: Floats, covariance: Floats) -> None:
    """Pose (3,) and covariance (3, 3) of a scan from its moments `now` (9,), and the memory of the axis."""
    pose[0], pose[1] = now[0], now[1]
    parts = now[3:].copy()
    known = not np.isnan(now[2])
    if known and m[_SINCE] == 0.0:
        m[_SINCE], m[_AXIS], m[_THETA], m[_FIRST] = 1.0, now[2], 0.0, parts[2]
        pose[2] = 0.0
        parts[2:] = np.array([0.0, parts[3], 0.0, 0.0])  # it is 0 by definition
    elif known:
        turn = now[2] - m[_AXIS]
        m[_THETA] += turn - np.pi * np.round(turn / np.pi)
        m[_AXIS] = now[2]
        pose[2] = m[_THETA]
        parts[2] += m[_FIRST]
    spread(parts, covariance, known)


@kernel
def axis_motion(
    t: Floats,
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    places: Floats,
    starts: NDArray[np.int64],
    pitch: Floats,
    bounds: Floats,
    memory: Floats,
    pose: Floats,
    covariance: Floats,
    displacement: Floats,
    displacement_covariance: Floats,
    span: Floats,
    lag: Floats,
) -> None:
    """Fill pose ... lag, arrays of `Slips`, which come in as NaN; other arguments as for `flow.convolution_flow`.

    anisotropy scan with a missing loaded taxel interrupts displacement, not the turn; a lift-off ends both.
    """
    now = np.empty(9)
    for pad in range(len(starts) - 1):
        own = slice(starts[pad], starts[pad + 1])
        m = memory[pad]
        for k in range(len(t)):
            if not contact[k, pad]:
                m[_RUN] = m[_SINCE] = 0.0
                continue
            if not complete[k, pad]:
                m[_RUN] = 0.0
                continue
            moments(pressure[k, own], noise[own], places[0, own], places[1, own], 0.5 * pitch[pad], bounds, now)
            follow(now, m, pose[k, pad], covariance[k, pad])
            lag[k, pad] = 0.0
            if m[_RUN] > 0.0:
                step = now[:3] - m[_POSE : _POSE + 3]
                turn = step[2] - np.pi * np.round(step[2] / np.pi)
                displacement[k, pad, 0], displacement[k, pad, 1], displacement[k, pad, 2] = step[0], step[1], turn
                spread(now[3:] + m[_COV : _COV + 6], displacement_covariance[k, pad], not np.isnan(turn))
                span[k, pad] = t[k] - m[_T]
            m[_RUN], m[_T] = 1.0, t[k]
            m[_POSE : _COV + 6] = now
