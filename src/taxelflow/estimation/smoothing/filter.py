"""Kalman filter and Rauch-Tung-Striebel smoother of a constant velocity with white acceleration.

State (x, y, theta and their velocities); over dt, per axis, with q the spectral density of the acceleration,
F = [[1, dt], [0, 1]],  Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]
(Bar-Shalom, Li & Kirubarajan 2001, 6.2.2; smoother 8.6).
A pose without theta measures x and y alone.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple, TypeAlias

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.small_linalg import factor_small, solve_factored
from taxelflow.runtime.compiling import long_kernel, routine

STATES = 6
"""Components of a state: x, y, theta and their rates."""
State: TypeAlias = Annotated[Floats, 6]
Matrix: TypeAlias = Annotated[Floats, 6, 6]


class _Start(NamedTuple):
    """What is known where a track starts."""

    velocity_std: float = 1.0
    spin_std: float = 100.0
    """Standard deviations of a velocity at a track's start, m/s and rad/s: above what a hand can do."""
    turn_std: float = 10.0
    """Standard deviation of an unknown turn at a track's start, rad: more than a full turn."""


_START = _Start()


class Memory:
    """What the filter keeps of a track: whether it runs, the time of its last pose, state and covariance then."""

    running: bool
    tau_s: float
    state: State
    covariance: Matrix


class Smoothed:
    """What filter or smoother estimate at one pose; NaN where there is none.

    begins: a track begins here. state, covariance: after all poses so far (filter), or all of the track (smoother).
    before, before_covariance: of the pose before, given this one. moved_covariance: of the displacement since then,
    span_s: the time since then.
    """

    begins: bool
    span_s: float
    state: State
    covariance: Matrix
    before: State
    before_covariance: Matrix
    moved_covariance: Annotated[Floats, 3, 3]


class Prediction(NamedTuple):
    """From the pose before to the next. old: state (6,) before; ahead: what it predicts for the next; their
    covariances (6, 6). crossed: (6, 6), covariance of the next with the one before. gain, half: (6, 6), room.
    """

    old: Floats
    old_covariance: Floats
    ahead: Floats
    ahead_covariance: Floats
    crossed: Floats
    gain: Floats
    half: Floats


@routine
def no_prediction() -> Prediction:
    """Room for a prediction."""
    square = np.zeros((5, STATES, STATES))
    return Prediction(np.zeros(STATES), square[0], np.zeros(STATES), square[1], square[2], square[3], square[4])


@routine
def predict(state: Floats, covariance: Floats, dt: float, density: Floats, out: Prediction) -> None:
    """Fill the prediction. density: (3,) m^2/s^3, m^2/s^3, rad^2/s^3."""
    for i in range(STATES):
        out.old[i] = state[i]
        for j in range(STATES):
            out.old_covariance[i, j] = covariance[i, j]
    for i in range(STATES):
        on = dt if i < 3 else 0.0
        out.ahead[i] = out.old[i] + on * out.old[(i + 3) % STATES]
        for j in range(STATES):
            out.crossed[i, j] = out.old_covariance[i, j] + on * out.old_covariance[(i + 3) % STATES, j]
    for i in range(STATES):
        for j in range(STATES):
            on = dt if j < 3 else 0.0
            out.ahead_covariance[i, j] = out.crossed[i, j] + on * out.crossed[i, (j + 3) % STATES]
    for a in range(3):
        out.ahead_covariance[a, a] += density[a] * dt * dt * dt / 3.0
        out.ahead_covariance[a, a + 3] += density[a] * dt * dt / 2.0
        out.ahead_covariance[a + 3, a] += density[a] * dt * dt / 2.0
        out.ahead_covariance[a + 3, a + 3] += density[a] * dt


@routine
def update(prediction: Prediction, pose: Floats, noise: Floats, x: Floats, P: Floats) -> None:
    """Fill state x and covariance P after a measurement update by a pose (3,) with noise (3, 3), in Joseph's form."""
    known = 2 if np.isnan(pose[2]) or np.isnan(noise[2, 2]) else 3
    ahead, ahead_P, K, A = prediction.ahead, prediction.ahead_covariance, prediction.gain, np.zeros((STATES, STATES))
    S, column = np.zeros((3, 3)), np.zeros(3)
    for a in range(known):
        for b in range(known):
            S[a, b] = ahead_P[a, b] + noise[a, b]
    positive = factor_small(S, known)
    for i in range(STATES):
        for a in range(known):
            column[a] = ahead_P[a, i] if positive else 0.0
        solve_factored(S, column, known)
        x[i] = ahead[i]
        A[i, i] = 1.0
        for a in range(known):
            K[i, a] = column[a]
            A[i, a] -= column[a]
            x[i] += column[a] * (pose[a] - ahead[a])
    carry(A, ahead_P, prediction.half, P)
    for i in range(STATES):
        for b in range(known):
            spread = 0.0
            for a in range(known):
                spread += K[i, a] * noise[a, b]
            for j in range(STATES):
                P[i, j] += spread * K[j, b]
    make_symmetric(P)


@routine
def carry(A: Floats, M: Floats, half: Floats, out: Floats) -> None:
    """Fill out (6, 6) with A M A^T; half: room."""
    for i in range(STATES):
        for j in range(STATES):
            total = 0.0
            for k in range(STATES):
                total += A[i, k] * M[k, j]
            half[i, j] = total
    for i in range(STATES):
        for j in range(STATES):
            total = 0.0
            for k in range(STATES):
                total += half[i, k] * A[j, k]
            out[i, j] = total


@routine
def make_symmetric(P: Floats) -> None:
    """Take the mean of both halves of a matrix (6, 6)."""
    for i in range(STATES):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])


@long_kernel
def run_filter(
    tau: Floats, pose: Floats, noise: Floats, touched: Bools, density: Floats, memory: Records, rows: Records
) -> None:
    """Fill rows (n,) of `Smoothed`, which come in as NaN; rows without a pose stay so.

    tau: (n,) when poses are, s; pose: (n, 3), noise: (n, 3, 3), touched: (n,), in contact. memory: (1,) of `Memory`.
    """
    m: Memory = memory[0]
    prediction = no_prediction()
    for k in range(len(tau)):
        row: Smoothed = rows[k]
        if not touched[k]:
            m.running = False
        if not touched[k] or np.isnan(pose[k, 0]) or np.isnan(noise[k, 0, 0]):
            continue
        row.begins = not m.running
        if row.begins:
            begin(pose[k], noise[k], m.state, m.covariance)
        else:
            row.span_s = tau[k] - m.tau_s
            predict(m.state, m.covariance, row.span_s, density, prediction)
            update(prediction, pose[k], noise[k], m.state, m.covariance)
            step_back(prediction, m.state, m.covariance, row.before, row.before_covariance, row.moved_covariance)
        for i in range(STATES):
            row.state[i] = m.state[i]
            for j in range(STATES):
                row.covariance[i, j] = m.covariance[i, j]
        m.running, m.tau_s = True, tau[k]


@routine
def begin(pose: Floats, noise: Floats, state: Floats, covariance: Floats) -> None:
    """State (6,) and covariance (6, 6) of a track that begins with a pose (3,)."""
    for i in range(STATES):
        state[i] = 0.0
        for j in range(STATES):
            covariance[i, j] = 0.0
    known = 2 if np.isnan(pose[2]) else 3
    for a in range(3):
        covariance[a + 3, a + 3] = _START.velocity_std**2 if a < 2 else _START.spin_std**2
    for a in range(known):
        state[a] = pose[a]
        for b in range(known):
            covariance[a, b] = noise[a, b]
    if known < 3:
        covariance[2, 2] = _START.turn_std**2


@routine
def step_back(
    prediction: Prediction, later: Floats, later_P: Floats, out: Floats, out_P: Floats, moved_P: Floats
) -> None:
    """Fill out (6,), out_P (6, 6): the state before, given all that the later one holds; moved_P: of their difference.

    Where rounding leaves no positive covariance ahead, the later state does not constrain the one before.
    """
    G, more, factor = prediction.gain, np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
    column = np.zeros(STATES)
    for i in range(STATES):
        for j in range(STATES):
            factor[i, j] = prediction.ahead_covariance[i, j]
            more[i, j] = later_P[i, j] - prediction.ahead_covariance[i, j]
    positive = factor_small(factor, STATES)
    for i in range(STATES):
        for j in range(STATES):
            column[j] = prediction.crossed[j, i] if positive else 0.0
        solve_factored(factor, column, STATES)
        out[i] = prediction.old[i]
        for j in range(STATES):
            G[i, j] = column[j]
            out[i] += column[j] * (later[j] - prediction.ahead[j])
    carry(G, more, prediction.half, out_P)
    for i in range(STATES):
        for j in range(STATES):
            out_P[i, j] += prediction.old_covariance[i, j]
    make_symmetric(out_P)
    for a in range(3):
        for b in range(3):
            moved_P[a, b] = later_P[a, b] + out_P[a, b]
            for k in range(STATES):
                moved_P[a, b] -= later_P[a, k] * G[b, k] + later_P[b, k] * G[a, k]


@long_kernel
def run_smoother(tau: Floats, density: Floats, rows: Records) -> None:
    """Turn what `run_filter` gave into the estimates from all poses of each track."""
    prediction = no_prediction()
    next_pose = -1
    for k in range(len(tau) - 1, -1, -1):
        row: Smoothed = rows[k]
        if np.isnan(row.state[0]):
            continue
        if next_pose >= 0 and not rows[next_pose].begins:
            later: Smoothed = rows[next_pose]
            predict(row.state, row.covariance, tau[next_pose] - tau[k], density, prediction)
            step_back(prediction, later.state, later.covariance, row.state, row.covariance, later.moved_covariance)
        next_pose = k
