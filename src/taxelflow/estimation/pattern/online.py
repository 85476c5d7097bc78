"""One scan after the other: every pad's scan registered to its pattern, in one call for the whole hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.estimation.pattern.carry import bring, keep
from taxelflow.estimation.pattern.register import HELD, factor_small, register, solve_factored
from taxelflow.estimation.pattern.spline import GAIN, SIZE, STATE, THETA, evaluate
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

(
    ACTIVE,  # whether the pad has a pattern
    SPACING,  # lattice, three numbers
    _,
    LOW,
    ROUGH,  # error of the pattern relative to it
    USUAL,  # chi-square per reading that its scans usually leave
    TURN_STD,  # how far theta may move from scan to scan; 0 if it is fixed
    GAIN_STD,  # and the gain
    CHI,  # chi-square per reading of the last scan
    COUNT,  # readings in it
    SPEED_X,  # of the last scan, per s
    SPEED_Y,
    SPEED_T,
    SPAN,  # time from the scan before it
    LAST_T,  # time of the last registered scan
    CENTROID_X,
    CENTROID_Y,
    RADIUS,  # of the pattern
    SHARE,  # of the information on theta that is real, see `poses.to_pad`
    SHARE_OF_PLACE,  # and of that on x and y
    SEEN,  # whether theta is reported
    THETA_0,  # where it counts from
    POOR,  # scans in a row that do not fit
    CONTINUES,  # whether the scan before was registered, on this pattern
    KEYFRAMES,  # how many there are
    SLACK,  # variance of x and y, in pitches^2, from errors of the pattern
    SLACK_T,  # and of theta
    CUT,  # whether this contact has ever been cut by the border
    PROBATION,  # scans for which a recognised pattern is looked for all over the pad
    LOAD,  # sum of the loaded readings, of the last scan
    GROWS,  # whether the contact has been seen to grow with the load
    AWAY,  # how far the object has been from its first keyframe, in pitches
    TURNED,  # whether a scan was explained by a turn although theta was fixed
    PLACE_X,  # where the object has been lately
    PLACE_Y,
    PLACE_T,
    CARRIES,  # whether a rest is carried from scan to scan, see `carry`
    CHANGING,  # whether the pattern does not stay: every scan is learned from, and the old forgotten
    FLAG,  # what the last scan calls for, one of the below
    SLOTS,
) = range(40)
"""Places in a pad's memory."""

NOTHING, NOVEL, GONE = range(3)
"""What a scan calls for: nothing, to be learned from, a new start."""

_ITERATIONS = 12
HUBER = 5.0
_POOR = 2.0
"""A scan that fits so many times worse than usual is tried from other starts."""
_REST = 2.0
"""And what it leaves is carried over to the next."""
_MOVES, _SETTLES_S = 0.15, 0.2
"""An object that is closer, in pitches, than this to where it was in so many seconds is still."""
_LOOSE_GAIN_STD = 0.5
_TURNS_GAIN = 0.3
"""What turning or growing must explain of the misfit to be believed."""
_STAYS = 0.5
"""Only an object that has stayed within so many pitches may be seen to grow."""
_GROWTH, _LEAST_GROWTH, _FIRST_GROWTH = 0.5, 0.002, 0.1
"""Change of the size's logarithm from scan to scan, per change of the load's; and where it first shows."""
_CUT, _FIRST_TURN_STD = 0.1, 0.1
"""A contact is cut if so much of its load lies at the border; an object that is whole may begin to turn."""
_GATE, _FAR_OFF = 2.0, 10.0
"""Chi-square over the usual above which a scan does not fit, and does not fit at all."""
_PATIENCE, _MOST_POOR = 5, 20
_LEAP = 1.5
"""A scan that moves so many radii and pitches at once is not believed."""
_YOUNG = 12
_NEAR, _SAME = 0.25, 5
"""Keyframes closer than this, in pitches, show the same, and so many are enough."""
_LOUDER = 0.5
"""A change of the gain's logarithm by this much counts as a pitch."""
BLURRED = 0.25
_TELLS = 0.51
"""A pattern that tells no more of a place than its noise pretends to."""
FAINT = 3.0
"""A pattern from scans so many times fainter is not worth keeping."""


@kernel
def centroid(reading: Floats, variance: Floats, places: Floats, edge: Bools, out: Floats) -> None:
    """Fill out (4,) with the centroid of what is loaded above 4 standard deviations and 5 % of the peak, the share of
    it that lies at the border, and its sum; edge: (taxels,).
    """
    peak = 0.0
    for i in range(len(reading)):
        peak = max(peak, reading[i])
    total = x = y = border = 0.0
    for i in range(len(reading)):
        p = reading[i]
        if p > 0.05 * peak and p * p > 16.0 * variance[i] > 0.0:
            total += p
            x += p * places[0, i]
            y += p * places[1, i]
            border += p if edge[i] else 0.0
    out[:] = 0.0
    if total > 0.0:
        out[0], out[1], out[2], out[3] = x / total, y / total, border / total, total


@kernel
def follow(  # noqa: PLR0912, PLR0915  one loop, as a kernel must be
    t: float,
    reading: Floats,
    variance: Floats,
    ceiling: Floats,
    places: Floats,
    delay: Floats,
    edge: Bools,
    starts: NDArray[np.int64],
    contact: Bools,
    patterns: Floats,
    doubts: Floats,
    memory: Floats,
    states: Floats,
    information: Floats,
    steps: Floats,
    rests: Floats,
) -> bool:
    """Register one scan (entries,) on the patterns (pads, rows, cols) of all pads in contact; whether all of them fit.

    A pattern is NaN beyond its own rows and columns. memory: (pads, SLOTS), states: (pads, 5) and rests: (4, entries),
    see `carry`, are kept from scan to scan. information: (pads, 5, 5) of the states, steps: (pads, 5, 5) of how far
    they are from those before. places: (2, entries) in pitches; delay: (entries,) or (0,); edge: (entries,), at a
    border of its pad.
    """
    fits = True
    one_point, no_doubt = np.zeros((1, 2)), np.zeros((0, 0))
    no_bend, middle = np.zeros((3, 0)), np.empty(4)
    last, prior, trial, stiffness = np.empty(STATE), np.empty(STATE), np.empty(STATE), np.empty(STATE)
    found = np.zeros((STATE, STATE))
    for pad in range(len(starts) - 1):
        m = memory[pad]
        if not contact[pad] or m[ACTIVE] == 0.0:
            continue
        own = slice(starts[pad], starts[pad + 1])
        where = places[:, own]
        span = t - m[LAST_T]
        last[:] = states[pad]
        centroid(reading[own], variance[own], where, edge[own], middle)
        m[CUT] = max(m[CUT], 1.0 if middle[2] > _CUT else 0.0)
        bend = no_bend
        if len(delay):
            bend = np.empty((3, where.shape[1]))
            for i in range(where.shape[1]):
                late = delay[starts[pad] + i]
                bend[0, i], bend[1, i], bend[2, i] = m[SPEED_X] * late, m[SPEED_Y] * late, m[SPEED_T] * late
        stiffness[0] = stiffness[1] = 1e-6
        stiffness[THETA] = 1.0 / m[TURN_STD] ** 2 if m[TURN_STD] > 0.0 else HELD
        pressed = abs(np.log(middle[3] / m[LOAD])) if middle[3] > 0.0 and m[LOAD] > 0.0 else 1.0
        grown_std = _GROWTH * pressed + _LEAST_GROWTH
        stiffness[SIZE] = 1.0 / grown_std**2 if m[GROWS] > 0.0 else HELD
        pattern, doubt = patterns[pad], doubts[pad]
        seen, against, limit = reading[own], variance[own], ceiling[own]
        rough, usual = m[ROUGH], m[USUAL]
        brought = np.empty((3, 0))
        best, best_chi, count = np.inf, np.inf, 0
        may_turn = m[TURN_STD] == 0.0 and m[CUT] == 0.0
        may_grow = m[GROWS] == 0.0 and m[AWAY] <= _STAYS and m[KEYFRAMES] >= _SAME
        poor = m[CHI] > gate(m[USUAL], m[COUNT])
        for carried in range(2):
            if carried == 0 and m[CARRIES] > 0.0 and not (poor and (may_turn or may_grow)):
                continue
            if carried == 1:
                if m[CARRIES] == 0.0:
                    break
                moved = span * np.hypot(m[SPEED_X], m[SPEED_Y])
                moved = np.sqrt(max(moved * moved - 4.0 / steps[pad, 0, 0] - 4.0 / steps[pad, 1, 1], 0.0))
                brought = np.empty((3, len(seen)))
                bring(span, moved, rests[:, own], seen, against, limit, brought)
                seen, against, limit = brought
                doubt, rough, usual = no_doubt, 0.0, 1.0
                best, best_chi = np.inf, np.inf
            for attempt in range(6 if carried == 0 else 4):
                trial[:] = last
                if attempt == 0:
                    trial[0] += m[SPEED_X] * span
                    trial[1] += m[SPEED_Y] * span
                    if m[TURN_STD] > 0.0:
                        trial[THETA] += m[SPEED_T] * span
                elif attempt == 2:
                    trial[0] += middle[0] - m[CENTROID_X]
                    trial[1] += middle[1] - m[CENTROID_Y]
                prior[:] = last
                stiffness[GAIN] = 1.0 / (m[GAIN_STD] * last[GAIN]) ** 2
                if attempt >= 3:
                    trial[:] = states[pad]
                    stiffness[GAIN] = 1.0 / (_LOOSE_GAIN_STD * last[GAIN]) ** 2
                if attempt >= 4 and best_chi <= gate(usual, m[COUNT]):
                    break
                if attempt == 4:  # it may have begun to turn
                    if not may_turn:
                        continue
                    stiffness[THETA] = 1.0 / _FIRST_TURN_STD**2
                if attempt == 5:  # or it grows with the load
                    if not may_grow:
                        continue
                    stiffness[SIZE] = 1.0 / _FIRST_GROWTH**2
                    stiffness[THETA] = HELD if m[TURN_STD] == 0.0 else stiffness[THETA]
                prior[THETA] = trial[THETA] if m[TURN_STD] > 0.0 else last[THETA]
                cost, chi, count = register(
                    pattern,
                    doubt,
                    m[SPACING : LOW + 1],
                    where,
                    bend,
                    seen,
                    against,
                    limit,
                    rough,
                    HUBER,
                    prior,
                    stiffness,
                    _ITERATIONS,
                    trial,
                    found,
                )
                needed = 1e-3 if attempt < 4 else _TURNS_GAIN * best
                if cost < best - needed:
                    best = cost
                    states[pad] = trial
                    information[pad] = found
                    best_chi, m[COUNT] = chi / max(count, 1), count
                    if attempt >= 4:
                        m[CARRIES] = 0.0
                        m[TURNED] = 1.0 if attempt == 4 else m[TURNED]
                        if attempt == 5:  # the pose steps, for what was taken for motion was growth
                            m[GROWS], m[CONTINUES] = 1.0, 0.0
                if best_chi <= _POOR * usual:
                    break
            if carried == 0:
                stiffness[THETA] = 1.0 / m[TURN_STD] ** 2 if m[TURN_STD] > 0.0 else HELD
                stiffness[SIZE] = 1.0 / grown_std**2 if m[GROWS] > 0.0 else HELD
        steps[pad] = information[pad]
        m[CHI] = best_chi
        rests[3, own] = 0.0
        away = np.hypot(states[pad, 0] - m[PLACE_X], states[pad, 1] - m[PLACE_Y])
        away += m[RADIUS] * abs(states[pad, 2] - m[PLACE_T])
        still = m[CONTINUES] > 0.0 and away < _MOVES + 3.0 * np.sqrt(1.0 / steps[pad, 0, 0] + 1.0 / steps[pad, 1, 1])
        follows = 1.0 - np.exp(-span / _SETTLES_S) if m[CONTINUES] > 0.0 else 1.0
        for a in range(3):
            m[PLACE_X + a] += follows * (states[pad, a] - m[PLACE_X + a])
        if m[CARRIES] > 0.0 or still or best_chi > _REST * usual:
            if m[CARRIES] > 0.0:
                rests[3, own] = reading[own] - brought[0]
            values = np.empty((len(seen), STATE))
            evaluate(pattern, m[SPACING : LOW + 1], where, states[pad], one_point, bend, values)
            m[CHI] = keep(
                values,
                doubts[pad],
                m[SPACING : LOW + 1],
                where,
                bend,
                states[pad],
                reading[own],
                variance[own],
                ceiling[own],
                m[ROUGH],
                m[USUAL],
                stiffness,
                best_chi / usual,
                still,
                brought,
                rests[:, own],
                information[pad],
            )
            m[CARRIES] = 1.0 if still or m[CHI] > _REST * m[USUAL] else 0.0
        if span > 0.0:
            m[SPEED_X] = (states[pad, 0] - last[0]) / span
            m[SPEED_Y] = (states[pad, 1] - last[1]) / span
            m[SPEED_T] = (states[pad, 2] - last[2]) / span
            m[SPAN] = span
        m[LAST_T] = t
        m[CENTROID_X], m[CENTROID_Y], m[LOAD] = middle[0], middle[1], middle[3]
        fits = fits and m[CHI] <= gate(m[USUAL], m[COUNT]) and m[PROBATION] == 0.0
    return fits


@kernel
def gate(usual: float, count: float) -> float:
    """Chi-square per reading up to which a scan of so many readings fits."""
    return float(usual * _GATE * (1.0 + 2.0 / np.sqrt(max(count, 1.0))))


@kernel
def report(  # noqa: PLR0912, PLR0915  one loop, as a kernel must be
    t: float,
    contact: Bools,
    pitch_m: Floats,
    memory: Floats,
    states: Floats,
    information: Floats,
    steps: Floats,
    before: Floats,
    before_cov: Floats,
    before_t: Floats,
    keyframes: Floats,
    pose: Floats,
    covariance: Floats,
    displacement: Floats,
    displacement_covariance: Floats,
    span: Floats,
    quality: NDArray[np.uint8],
) -> None:
    """Fill one scan's pose ... quality (pads, ...), which come in as NaN and 0, and each pad's FLAG.

    before, before_cov: (pads, 3), (pads, 3, 3), the pose before on the same pattern, before_t (pads,) its time.
    keyframes: (pads, n, 4), pose in pitches and rad, and gain, of the scans that the pattern is learned from.
    """
    for pad in range(len(contact)):
        m = memory[pad]
        m[FLAG] = NOTHING
        if not contact[pad] or m[ACTIVE] == 0.0:
            m[CONTINUES] = 0.0
            continue
        state = states[pad]
        scale = pitch_m[pad]
        cov = covariance[pad]
        _invert(information[pad], m[SHARE], scale, cov)
        noise = cov.copy()
        if m[CARRIES] > 0.0:
            _invert(steps[pad], m[SHARE], scale, noise)
        cov /= m[SHARE_OF_PLACE]
        pose[pad, 0], pose[pad, 1] = scale * state[0], scale * state[1]
        pose[pad, 2] = state[2] - m[THETA_0]
        if m[SEEN] == 0.0:
            pose[pad, 2] = np.nan
            for a in range(3):
                cov[a, 2] = cov[2, a] = noise[a, 2] = noise[2, a] = np.nan
        xx, yy, xy = cov[0, 0], cov[1, 1], cov[0, 1]
        cov[0, 0] += m[SLACK] * scale * scale
        cov[1, 1] += m[SLACK] * scale * scale
        cov[2, 2] += m[SLACK_T]
        if m[KEYFRAMES] > 0.0:
            away = np.hypot(state[0] - keyframes[pad, 0, 0], state[1] - keyframes[pad, 0, 1])
            m[AWAY] = max(m[AWAY], away)
        misfit = m[CHI] / m[USUAL]
        moved = 0.0
        if m[CONTINUES] > 0.0:
            for a in range(3):
                displacement[pad, a] = pose[pad, a] - before[pad, a]
                for b in range(3):
                    displacement_covariance[pad, a, b] = noise[a, b] + before_cov[pad, a, b]
            span[pad] = t - before_t[pad]
            moved = np.hypot(displacement[pad, 0], displacement[pad, 1]) / scale
        before[pad] = pose[pad]
        before_cov[pad] = noise
        before_t[pad] = t
        m[CONTINUES] = 1.0
        largest = 0.5 * (xx + yy) + np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        blurred = largest + m[SLACK] * scale * scale > (BLURRED * scale) ** 2
        unsure = m[PROBATION] > 0.0
        blurred = blurred or m[SHARE_OF_PLACE] < _TELLS
        quality[pad] = AMBIGUOUS if blurred or unsure or m[CHANGING] > 0.0 else OK
        if m[CHI] <= gate(m[USUAL], m[COUNT]):
            m[POOR] = 0.0
            if largest < (BLURRED * scale) ** 2:
                close = 0
                for k in range(int(m[KEYFRAMES])):
                    apart = np.hypot(state[0] - keyframes[pad, k, 0], state[1] - keyframes[pad, k, 1])
                    apart += m[RADIUS] * abs(state[THETA] - keyframes[pad, k, 2])
                    if (
                        apart < _NEAR
                        and apart + abs(np.log(state[GAIN] / keyframes[pad, k, 3])) * _NEAR / _LOUDER < _NEAR
                    ):
                        close += 1
                        if close == _SAME:
                            break
                if close < _SAME or m[CHANGING] > 0.0:
                    m[FLAG] = NOVEL
        else:
            quality[pad] = UNRESOLVED
            m[POOR] += 1.0 if misfit <= _FAR_OFF else 2.0
            if m[POOR] >= _PATIENCE or m[KEYFRAMES] < _YOUNG:  # a young pattern is not yet to be trusted more
                m[FLAG] = NOVEL
        if unsure:
            m[FLAG] = NOTHING  # a pattern must not learn from where it is not
        if state[GAIN] > FAINT and m[KEYFRAMES] < _YOUNG:
            m[FLAG] = NOVEL
        if moved > _LEAP * (1.0 + m[RADIUS]) or m[POOR] >= _MOST_POOR:
            m[FLAG] = GONE
            quality[pad] = LOST


@kernel
def _invert(information: Floats, share: float, scale: float, cov: Floats) -> None:
    """Fill cov (3, 3), m and rad, with the covariance of x, y and theta, given that of (5, 5) in pitches and rad."""
    matrix, unit = information.copy(), np.empty(STATE)
    for a in range(STATE):
        matrix[a, THETA] *= share
        matrix[THETA, a] *= share
        matrix[a, a] += 1e-12
    positive = factor_small(matrix, STATE)
    for column in range(3):
        unit[:] = 0.0
        unit[column] = 1.0
        if positive:
            solve_factored(matrix, unit, STATE)
        for a in range(3):
            cov[a, column] = unit[a] * (scale if a < 2 else 1.0) * (scale if column < 2 else 1.0)
