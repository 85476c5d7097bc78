"""Output of a registered scan: pose, displacement, covariances, quality; and whether it becomes a keyframe."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.estimation.template.online.explained import UNEXPLAINED, fits
from taxelflow.estimation.template.online.hand import POSE, SPAN, STEP, Room, Rows
from taxelflow.estimation.template.online.track_state import FAINT, GONE, KEYFRAMES, NOTHING, NOVEL, Track
from taxelflow.estimation.template.online.witness import (
    add_errors,
    add_weighted,
    find_centre,
    find_sure_shift,
    follow_centre,
    leave_open,
    move_covariance,
    reported_arm,
    weigh_pose,
    weigh_step,
)
from taxelflow.estimation.template.two_witnesses import transformed
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED, Floats
from taxelflow.numerics.bspline import state_of
from taxelflow.numerics.rounding import BLURRED, NEGLIGIBLE
from taxelflow.numerics.small_linalg import eigenvalues2, factor5, solved5
from taxelflow.runtime.compiling import lean_kernel


class _Unfit(NamedTuple):
    """Scans that do not fit."""

    far: float = 10.0
    """Chi-square over the usual above which a scan does not fit at all."""
    learned: int = 5
    given_up: int = 20
    """After this many scans in a row that do not fit, they are learned from, and the pattern is given up: the latter
    only where they do not fit at all, for a pattern that changes is learned again."""
    leap: float = 1.5
    """A scan that moves this many radii and pitches at once is not believed."""


_UNFIT = _Unfit()


@lean_kernel
def report(t: float, k: int, pad: int, scale: float, floor: float, m: Track, room: Room, rows: Rows) -> None:
    """Fill one pad's part of row k, and m.flag. scale: of a pitch, m. floor: see `Hand`."""
    centre, noise, weight = room.states[0], room.squares[0], room.squares[1]
    weight[0, 0] = weight[0, 1] = weight[1, 0] = weight[1, 1] = 0.0
    cov, pose = rows.matrices[POSE, k, pad], rows.vectors[POSE, k, pad]
    _invert(m.doubted, scale, cov)
    _invert(m.step, scale, noise)
    arm_x, arm_y = reported_arm(scale, m)
    move_covariance(arm_x, arm_y, cov)
    move_covariance(arm_x, arm_y, noise)
    pose[0] = scale * (m.state[0] + m.origin[0]) + arm_x
    pose[1] = scale * (m.state[1] + m.origin[1]) + arm_y
    pose[2] = m.state[2] - m.theta_0
    if not m.seen:
        pose[2] = np.nan
        for a in range(3):
            cov[a, 2] = cov[2, a] = noise[a, 2] = noise[2, a] = np.nan
    largest = eigenvalues2(cov[0, 0], cov[1, 1], cov[0, 1])[1]
    in_line = _widen(m, scale, cov, noise)
    cov[2, 2] += m.slack_t
    if m.keyframes > 0:
        m.away = max(m.away, np.hypot(m.state[0] - m.keyframe[0, 0], m.state[1] - m.keyframe[0, 1]))
    find_sure_shift(scale, m, cov)
    find_centre(scale, m, centre)
    if floor > 0.0 and not in_line:
        weigh_pose(scale, floor, m, centre, pose, cov, weight)
    _add_step((m.broken + m.wander) * scale * scale, weight, cov)
    alone = m.keyframes == 1 and not m.continues  # with a pattern of one scan, which only that one has fitted
    moved = _displacement(t, k, pad, m, noise, centre, weight, rows) / scale
    follow_centre(scale, floor, m)
    add_weighted(pose, centre[0] - pose[0], centre[1] - pose[1], weight)
    leave_open(scale, m, cov)
    blurred = eigenvalues2(cov[0, 0], cov[1, 1], cov[0, 1])[1] > (BLURRED * scale) ** 2
    unsure = m.probation > 0.0
    rows.quality[k, pad] = AMBIGUOUS if blurred or in_line or unsure or m.changing else UNRESOLVED if alone else OK
    if fits(m):
        m.poor = 0.0
        clear = largest < (BLURRED * scale) ** 2 or m.keyframes < KEYFRAMES.young
        if clear and (m.changing or not _shown(m)):
            m.flag = NOVEL
    else:
        rows.quality[k, pad] = UNRESOLVED if m.strange else rows.quality[k, pad]
        _add_poor(t, m)
        if m.poor >= _UNFIT.learned or m.keyframes < KEYFRAMES.young:
            m.flag = NOVEL
    if state_of(m.state).gain > FAINT and m.keyframes < KEYFRAMES.young:
        m.flag = NOVEL
    if unsure:
        m.flag = NOTHING  # a pattern must not learn from where it is not
    if moved > _UNFIT.leap * (1.0 + m.radius) or is_given_up(m):
        m.flag = GONE
        rows.quality[k, pad] = LOST


@lean_kernel
def is_given_up(m: Track) -> bool:
    """Whether the pattern is given up: scans do not fit, though it has learned from such, or are another object's.

    Learning takes as long at any rate: scans that come meanwhile show no more than that it is still to be learned.
    """
    taught = m.learned_s >= m.poor_s or m.probation > 0.0 or m.unexplained > UNEXPLAINED.most
    return bool(m.poor >= _UNFIT.given_up and m.unexplained > UNEXPLAINED.known and taught)


@lean_kernel
def _add_poor(t: float, m: Track) -> None:
    """Count a scan that does not fit, by how little it does."""
    if m.poor == 0.0:
        m.poor_s = t
    if m.unexplained > UNEXPLAINED.most:
        m.poor += _UNFIT.given_up / UNEXPLAINED.scans
    elif m.chi / m.usual > _UNFIT.far:
        m.poor += 2.0
    else:
        m.poor = max(m.poor, min(m.poor + 1.0, _UNFIT.learned))


@lean_kernel
def _add_step(variance: float, weight: Floats, cov: Floats) -> None:
    """Add to cov (3, 3) what steps of the map add: a variance of x and y, less what the centre of pressure holds."""
    p, q, r, s = 1.0 - weight[0, 0], -weight[0, 1], -weight[1, 0], 1.0 - weight[1, 1]
    xx, xy, yy = transformed(p, q, r, s, (variance, 0.0, variance))
    cov[0, 0], cov[1, 1] = cov[0, 0] + xx, cov[1, 1] + yy
    cov[0, 1], cov[1, 0] = cov[0, 1] + xy, cov[1, 0] + xy


@lean_kernel
def _widen(m: Track, scale: float, cov: Floats, noise: Floats) -> bool:
    """Add what the pattern's errors and a tilt add to cov (3, 3); whether a place is open across a line of taxels."""
    in_line = False
    for a in range(2):
        if m.across[a] > 0.0:
            in_line = True
            cov[a, a] = noise[a, a] = (m.across[a] * scale) ** 2
    add_errors(scale, m, cov)
    return in_line


@lean_kernel
def _displacement(
    t: float, k: int, pad: int, m: Track, noise: Floats, centre: Floats, weight: Floats, rows: Rows
) -> float:
    """Fill the displacement since the scan before, and keep this scan for the next; how far it is on the map, m.

    Both witnesses' displacements, weighted as they are now: what a change of the weight makes of the pose is no motion.
    """
    pose, moved = rows.vectors[POSE, k, pad], 0.0
    if m.continues:
        step, covariance = rows.vectors[STEP, k, pad], rows.matrices[STEP, k, pad]
        for a in range(3):
            step[a] = pose[a] - m.before[a]
            for b in range(3):
                covariance[a, b] = noise[a, b] + m.before_covariance[a, b]
        rows.scalars[SPAN, k, pad] = t - m.before_t
        moved = np.hypot(step[0], step[1])
        weigh_step(step, covariance, centre, m.before_centre, weight)
    for a in range(3):
        m.before[a] = pose[a]
        for b in range(3):
            m.before_covariance[a, b] = noise[a, b]
    for a in range(5):
        m.before_centre[a] = centre[a]
    m.before_t, m.continues = t, True
    return float(moved)


@lean_kernel
def _shown(m: Track) -> bool:
    """Whether enough keyframes show the object where it is, as loud as it is."""
    now, close = state_of(m.state), 0
    for k in range(m.keyframes):
        shown = state_of(m.keyframe[k])
        dx, dy = now.x - shown.x, now.y - shown.y
        if dx * dx + dy * dy >= KEYFRAMES.near * KEYFRAMES.near:
            continue
        apart = np.sqrt(dx * dx + dy * dy) + m.radius * abs(now.theta - shown.theta)
        apart += abs(np.log(now.gain / shown.gain)) * KEYFRAMES.near / KEYFRAMES.louder
        close += 1 if apart < KEYFRAMES.near else 0
        if close == KEYFRAMES.same:
            return True
    return False


@lean_kernel
def _invert(information: Floats, scale: float, cov: Floats) -> None:
    """Fill cov (3, 3), m and rad, with the covariance of x, y and theta, given information (5, 5) in pitches and rad.

    A unit matrix if it is not positive.
    """
    factor = factor5(information, 0.0, NEGLIGIBLE)
    for column in range(3):
        x, y, theta = 1.0 if column == 0 else 0.0, 1.0 if column == 1 else 0.0, 1.0 if column == 2 else 0.0
        if factor.positive:
            x, y, theta, _, _ = solved5(factor, x, y, theta, 0.0, 0.0)
        unit = scale if column < 2 else 1.0
        cov[0, column], cov[1, column], cov[2, column] = x * scale * unit, y * scale * unit, theta * unit
