"""Velocity of the object's point at each contact in the hand: a straight line through the poses of a window.

The pose of a contact on its pad and the pad's own pose give the point in the hand's frame, so that a moving finger and
a slip are separated. The turn about the contact's normal is that on the pad plus that of the pad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.fusion.reference import UNOBSERVABLE_M_S
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.rounding import LINE_POINTS
from taxelflow.numerics.small_linalg import copy_matrix, mirror
from taxelflow.runtime.compiling import inlined, lean_kernel, routine

_SMALL = 0.01
"""Tangents below which three terms of the arctangent's series are used, exact to 1e-15 rad."""
_LEAST_SHARE = 0.4
"""Share of the window that the scans must span; younger contacts have no velocity yet."""


class Seen(NamedTuple):
    """Observations of the pads, scan by scan.

    t_s: (scans,). frames: (scans, pads, 4, 4), contact frames in the hand, axes those of the pad. theta: (scans, pads),
    turn of the contact on its pad, NaN if unknown. covariance: (scans, pads, 3, 3), of the pose in the pad's axes.
    noise: (scans, pads, 3, 3), the part of it that is independent from scan to scan. doubt: (scans, pads), variance of
    the place, m^2, if a contact is anchored in a scan that contradicts its method's model. known, held: (scans, pads),
    whether the pose is known, and whether there is contact. kept: (scans, pads), the contact goes on, and where its
    pose is known so is the way from its last one. height: (scans, pads), of the point over its pad, m, filled in by the
    fit of the pose: pads do not measure the indentation. under: (scans, pads, 3), from the contact to the point whose
    motion it observes, in its axes, m; see `roundness`. unobservable: (scans, pads, 2, 2), see `Texture`.
    """

    t_s: Floats
    frames: Floats
    theta: Floats
    covariance: Floats
    noise: Floats
    doubt: Floats
    known: Bools
    held: Bools
    kept: Bools
    height: Floats
    under: Floats
    unobservable: Floats


class Velocities(NamedTuple):
    """Of one scan. frames: (pads, 4, 4), in the middle of the window, at the object's point. rate: (pads, 3), of that
    point along x and y and about z. covariance: (pads, 3, 3). known: (pads,).
    """

    frames: Floats
    rate: Floats
    covariance: Floats
    known: Bools


@routine
def rates(seen: Seen, scan: int, window_s: float, out: Velocities) -> None:
    """Fill the velocities of the window that ends with a scan."""
    for pad in range(len(out.known)):
        out.known[pad] = False
        if not seen.known[scan, pad]:
            continue
        first, count, since_s = scan, 0, seen.t_s[scan] - window_s - SAME_S
        going_on = True
        while going_on and first >= 0 and seen.held[first, pad] and seen.t_s[first] >= since_s:
            count += seen.known[first, pad]
            going_on = seen.kept[first, pad]
            first -= 1
        first += 1
        if count >= LINE_POINTS and seen.t_s[scan] - seen.t_s[first] >= _LEAST_SHARE * window_s - SAME_S:
            fit_line(seen, pad, first, scan, out)


@routine
def fit_line(seen: Seen, pad: int, first: int, last: int, out: Velocities) -> None:
    """Weighted regression of the point and of the turn on time; weights are the inverse variances of the place.

    The part of a pose's error that is not noise, that of the pattern, changes slowly: it may differ between the two
    ends of the window, and does not average out.
    """
    share = np.empty(last + 1 - first)
    weight = mean_s = 0.0
    for k in range(first, last + 1):
        w = 1.0 / (seen.covariance[k, pad, 0, 0] + seen.covariance[k, pad, 1, 1]) if seen.known[k, pad] else 0.0
        share[k - first] = w
        weight += w
        mean_s += w * (seen.t_s[k] - seen.t_s[last]) if w > 0.0 else 0.0
    mean_s /= weight
    middle, spread, nearest = last, 0.0, np.inf
    for k in range(first, last + 1):
        share[k - first] /= weight
        if share[k - first] > 0.0:
            off = seen.t_s[k] - seen.t_s[last] - mean_s
            spread += share[k - first] * off * off
            if abs(off) < nearest:
                middle, nearest = k, abs(off)
    slow = 2.0 / (seen.t_s[last] - seen.t_s[first]) ** 2
    begin_at(seen.frames[middle, pad], out.frames[pad], out.rate[pad], out.covariance[pad])
    moved = np.zeros(3)
    for k in range(first, last + 1):
        own = share[k - first]
        if own > 0.0:
            slope = own * (seen.t_s[k] - seen.t_s[last] - mean_s) / spread
            add_scan(seen, pad, (k, last), (own, slope), moved, out)
            add_covariance(slope * slope, own * slow, seen.covariance[k, pad], seen.noise[k, pad], out.covariance[pad])
            out.rate[pad, 2] += slope * (seen.theta[k, pad] - seen.theta[middle, pad])
    mirror(out.covariance[pad])
    K = out.frames[pad]
    for i in range(3):
        out.rate[pad, 0] += K[i, 0] * moved[i]
        out.rate[pad, 1] += K[i, 1] * moved[i]
    if seen.under[last, pad, 2] > 0.0:  # points that are one stay one: levers of noise would pretend to see a turn
        point = put_under(seen.frames[last, pad], seen.under[last, pad])
        for i in range(3):
            out.frames[pad, i, 3] = point[i]
    for a in range(2):
        for b in range(2):
            out.covariance[pad, a, b] += UNOBSERVABLE_M_S**2 * seen.unobservable[last, pad, a, b]
    out.known[pad] = True


@lean_kernel
def add_scan(
    seen: Seen, pad: int, scans: tuple[int, int], weights: tuple[float, float], moved: Floats, out: Velocities
) -> None:
    """Add a scan's point and the pad's turn, with weights in the mean and in the slope; moved (3,): slope of the point.

    scans: this one, and the last of the window, whose point under the contact holds for all.
    """
    (scan, last), (share, slope) = scans, weights
    F, K = seen.frames[scan, pad], out.frames[pad]
    under, height = seen.under[last, pad], seen.height[scan, pad]
    for i in range(3):
        point = F[i, 3] + F[i, 0] * under[0] + F[i, 1] * under[1] + F[i, 2] * (under[2] + height)
        K[i, 3] += share * point
        moved[i] += slope * point
    out.rate[pad, 2] += slope * turned(K, F)


@lean_kernel
def begin_at(middle: Floats, frame: Floats, rate: Floats, covariance: Floats) -> None:
    """Take the axes of a frame (4, 4) in the middle of the window; its origin, rate and covariance are sums from 0."""
    copy_matrix(middle, frame)
    for a in range(3):
        frame[a, 3] = rate[a] = 0.0
        for b in range(3):
            covariance[a, b] = 0.0


@lean_kernel
def add_covariance(of_noise: float, of_rest: float, own: Floats, noise: Floats, total: Floats) -> None:
    """Add a pose's noise (3, 3) and the rest of its covariance (3, 3), with factors, to the total's lower half."""
    for a in range(3):
        for b in range(a + 1):
            total[a, b] += of_noise * noise[a, b] + of_rest * (own[a, b] - noise[a, b])


@inlined
def put_under(frame: Floats, under: Floats) -> tuple[float, float, float]:
    """Point of a frame (4, 4) at coordinates (3,)."""
    x, y, z = under[0], under[1], under[2]
    return (
        frame[0, 3] + frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 3] + frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 3] + frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@lean_kernel
def turned(K: Floats, F: Floats) -> float:
    """Turn of a frame F (4, 4) against K about the z axis of K, rad."""
    sin = cos = 0.0
    for i in range(3):
        cos += K[i, 0] * F[i, 0]
        sin += K[i, 1] * F[i, 0]
    if cos > 0.0 and abs(sin) < _SMALL * cos:  # most turns within a window: a tenth of the time of arctan2
        t = sin / cos
        t2 = t * t
        small: float = t * (1.0 - t2 * (1.0 / 3.0 - t2 / 5.0))
        return small
    angle: float = np.arctan2(sin, cos)
    return angle
