"""What a registered scan says: slips with covariance and quality, and what it calls for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel, lean_kernel
from taxelflow.estimation.template.online import track_state as online
from taxelflow.estimation.template.online.track_state import BLURRED, FAINT
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED
from taxelflow.numerics.bspline import GAIN, STATE, THETA
from taxelflow.numerics.robust import gate
from taxelflow.numerics.small_linalg import factor_small, solve_factored

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

_FAR_OFF = 10.0
"""Chi-square over the usual above which a scan does not fit at all."""
_PATIENCE, _MOST_POOR = 5, 20
"""After so many scans in a row that do not fit, they are learned from, and the pattern is given up."""
_LEAP = 1.5
"""A scan that moves so many radii and pitches at once is not believed."""
_YOUNG = 12
"""A pattern of fewer keyframes learns from every scan that does not fit."""
_NEAR, _SAME = 0.25, 5
"""Keyframes closer than this, in pitches, show the same, and so many are enough."""
_LOUDER = 0.5
"""A change of the gain's logarithm by this much counts as a pitch."""
_TELLS = 0.51
"""A pattern that tells no more of a place than its noise pretends to."""


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
    """Fill one scan's pose ... quality (pads, ...), which come in as NaN and 0, and each pad's online.FLAG.

    before, before_cov: (pads, 3), (pads, 3, 3), the pose before on the same pattern, before_t (pads,) its time.
    keyframes: (pads, n, 4), pose in pitches and rad, and gain, of the scans that the pattern is learned from.
    """
    room = np.empty((STATE + 4, STATE))
    matrix, unit, noise = room[:STATE], room[STATE], room[STATE + 1 :, :3]
    for pad in range(len(contact)):
        m = memory[pad]
        m[online.FLAG] = online.NOTHING
        if not contact[pad] or m[online.ACTIVE] == 0.0:
            m[online.CONTINUES] = 0.0
            continue
        state = states[pad]
        scale = pitch_m[pad]
        cov = covariance[pad]
        _invert(information[pad], m[online.SHARE], scale, matrix, unit, cov)
        if m[online.CARRIES] > 0.0:
            _invert(steps[pad], m[online.SHARE], scale, matrix, unit, noise)
        for a in range(3):
            for b in range(3):
                if m[online.CARRIES] == 0.0:
                    noise[a, b] = cov[a, b]
                cov[a, b] /= m[online.SHARE_OF_PLACE]
        pose[pad, 0], pose[pad, 1] = scale * state[0], scale * state[1]
        pose[pad, 2] = state[2] - m[online.THETA_0]
        if m[online.SEEN] == 0.0:
            pose[pad, 2] = np.nan
            for a in range(3):
                cov[a, 2] = cov[2, a] = noise[a, 2] = noise[2, a] = np.nan
        xx, yy, xy = cov[0, 0], cov[1, 1], cov[0, 1]
        in_line = False
        for a in range(2):
            if m[online.ACROSS_X + a] > 0.0:
                in_line = True
                cov[a, a] = noise[a, a] = (m[online.ACROSS_X + a] * scale) ** 2
        cov[0, 0] += m[online.SLACK] * scale * scale
        cov[1, 1] += m[online.SLACK] * scale * scale
        cov[2, 2] += m[online.SLACK_T]
        if m[online.KEYFRAMES] > 0.0:
            away = np.hypot(state[0] - keyframes[pad, 0, 0], state[1] - keyframes[pad, 0, 1])
            m[online.AWAY] = max(m[online.AWAY], away)
        misfit = m[online.CHI] / m[online.USUAL]
        moved = 0.0
        if m[online.CONTINUES] > 0.0:
            for a in range(3):
                displacement[pad, a] = pose[pad, a] - before[pad, a]
                for b in range(3):
                    displacement_covariance[pad, a, b] = noise[a, b] + before_cov[pad, a, b]
            span[pad] = t - before_t[pad]
            moved = np.hypot(displacement[pad, 0], displacement[pad, 1]) / scale
        for a in range(3):
            before[pad, a] = pose[pad, a]
            for b in range(3):
                before_cov[pad, a, b] = noise[a, b]
        before_t[pad] = t
        m[online.CONTINUES] = 1.0
        largest = 0.5 * (xx + yy) + np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        blurred = largest + m[online.SLACK] * scale * scale > (BLURRED * scale) ** 2
        unsure = m[online.PROBATION] > 0.0
        blurred = blurred or in_line or m[online.SHARE_OF_PLACE] < _TELLS
        quality[pad] = AMBIGUOUS if blurred or unsure or m[online.CHANGING] > 0.0 else OK
        if m[online.CHI] <= gate(m[online.USUAL], m[online.COUNT]):
            m[online.POOR] = 0.0
            if largest < (BLURRED * scale) ** 2:
                close = 0
                for k in range(int(m[online.KEYFRAMES])):
                    apart = np.hypot(state[0] - keyframes[pad, k, 0], state[1] - keyframes[pad, k, 1])
                    apart += m[online.RADIUS] * abs(state[THETA] - keyframes[pad, k, 2])
                    if (
                        apart < _NEAR
                        and apart + abs(np.log(state[GAIN] / keyframes[pad, k, 3])) * _NEAR / _LOUDER < _NEAR
                    ):
                        close += 1
                        if close == _SAME:
                            break
                if close < _SAME or m[online.CHANGING] > 0.0:
                    m[online.FLAG] = online.NOVEL
        else:
            quality[pad] = UNRESOLVED
            m[online.POOR] += 1.0 if misfit <= _FAR_OFF else 2.0
            if m[online.POOR] >= _PATIENCE or m[online.KEYFRAMES] < _YOUNG:
                m[online.FLAG] = online.NOVEL
        if unsure:
            m[online.FLAG] = online.NOTHING  # a pattern must not learn from where it is not
        if state[GAIN] > FAINT and m[online.KEYFRAMES] < _YOUNG:
            m[online.FLAG] = online.NOVEL
        if moved > _LEAP * (1.0 + m[online.RADIUS]) or m[online.POOR] >= _MOST_POOR:
            m[online.FLAG] = online.GONE
            quality[pad] = LOST


@lean_kernel
def _invert(information: Floats, share: float, scale: float, matrix: Floats, unit: Floats, cov: Floats) -> None:
    """Fill cov (3, 3), m and rad, with the covariance of x, y and theta, given that of (5, 5) in pitches and rad.

    matrix, unit: (5, 5), (5,), to work in.
    """
    for a in range(STATE):
        for b in range(STATE):
            matrix[a, b] = information[a, b]
    for a in range(STATE):
        matrix[a, THETA] *= share
        matrix[THETA, a] *= share
        matrix[a, a] += 1e-12
    positive = factor_small(matrix, STATE)
    for column in range(3):
        for a in range(STATE):
            unit[a] = 1.0 if a == column else 0.0
        if positive:
            solve_factored(matrix, unit, STATE)
        for a in range(3):
            cov[a, column] = unit[a] * (scale if a < 2 else 1.0) * (scale if column < 2 else 1.0)
