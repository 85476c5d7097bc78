"""Kalman filter and Rauch-Tung-Striebel smoother of a constant velocity with white acceleration.

State (x, y, theta and their velocities); over dt, per axis, with q the spectral density of the acceleration,
F = [[1, dt], [0, 1]],  Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]
(Bar-Shalom, Li & Kirubarajan 2001, 6.2.2; smoother 8.6).
A pose without theta measures x and y alone.
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import kernel, routine

STATES = 6
State: TypeAlias = Annotated[Floats, 6]
Matrix: TypeAlias = Annotated[Floats, 6, 6]
_VELOCITY_STD, _SPIN_STD = 1.0, 100.0
"""Standard deviations of a velocity at a track's start, m/s and rad/s: above what a hand can do."""
_UNKNOWN_TURN_STD = 10.0
"""Standard deviation of an unknown turn at a track's start, rad: more than a full turn."""


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


@routine
def transition(dt: float, density: Floats, F: Floats, Q: Floats) -> None:
    """Fill F and Q (6, 6). density: (3,) m^2/s^3, m^2/s^3, rad^2/s^3."""
    F[:], Q[:] = 0.0, 0.0
    for a in range(3):
        F[a, a] = F[a + 3, a + 3] = 1.0
        F[a, a + 3] = dt
        Q[a, a] = density[a] * dt * dt * dt / 3.0
        Q[a, a + 3] = Q[a + 3, a] = density[a] * dt * dt / 2.0
        Q[a + 3, a + 3] = density[a] * dt


@routine
def update(x: Floats, P: Floats, pose: Floats, noise: Floats) -> None:
    """Measurement update by a pose (3,) with noise (3, 3), in Joseph's form."""
    known = 2 if np.isnan(pose[2]) or np.isnan(noise[2, 2]) else 3
    S = P[:known, :known] + noise[:known, :known]
    K = np.linalg.solve(S, np.ascontiguousarray(P[:known])).T
    x += K @ (pose[:known] - x[:known])
    A = np.eye(STATES)
    A[:, :known] -= K
    P[:] = A @ P @ A.T + K @ np.ascontiguousarray(noise[:known, :known]) @ K.T
    P[:] = 0.5 * (P + P.T)


@kernel
def run_filter(
    tau: Floats, pose: Floats, noise: Floats, touched: Bools, density: Floats, memory: Records, rows: Records
) -> None:
    """Fill rows (n,) of `Smoothed`, which come in as NaN; rows without a pose stay so.

    tau: (n,) when poses are, s; pose: (n, 3), noise: (n, 3, 3), touched: (n,), in contact. memory: (1,) of `Memory`.
    """
    m: Memory = memory[0]
    F, Q = np.empty((STATES, STATES)), np.empty((STATES, STATES))
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
            transition(row.span_s, density, F, Q)
            old, old_P = m.state.copy(), m.covariance.copy()
            ahead, ahead_P = F @ old, F @ old_P @ F.T + Q
            m.state[:], m.covariance[:, :] = ahead, ahead_P
            update(m.state, m.covariance, pose[k], noise[k])
            predicted = (old, old_P, F, ahead, ahead_P)
            step_back(predicted, m.state, m.covariance, row.before, row.before_covariance, row.moved_covariance)
        row.state[:], row.covariance[:, :] = m.state, m.covariance
        m.running, m.tau_s = True, tau[k]


@routine
def begin(pose: Floats, noise: Floats, state: Floats, covariance: Floats) -> None:
    """State (6,) and covariance (6, 6) of a track that begins with a pose (3,)."""
    state[:], covariance[:, :] = 0.0, 0.0
    known = 2 if np.isnan(pose[2]) else 3
    for a in range(3):
        covariance[a + 3, a + 3] = _VELOCITY_STD**2 if a < 2 else _SPIN_STD**2
    for a in range(known):
        state[a] = pose[a]
        for b in range(known):
            covariance[a, b] = noise[a, b]
    if known < 3:
        covariance[2, 2] = _UNKNOWN_TURN_STD**2


@routine
def step_back(
    predicted: tuple[Floats, Floats, Floats, Floats, Floats],
    later: Floats,
    later_P: Floats,
    out: Floats,
    out_P: Floats,
    moved_P: Floats,
) -> None:
    """Fill out (6,), out_P (6, 6): the state before, given all that the later one holds; moved_P: of their difference.

    predicted: the state before by itself and its covariance, F, and what they predict for the later time.
    """
    old, old_P, F, ahead, ahead_P = predicted
    G = np.linalg.solve(ahead_P, F @ old_P).T
    out[:] = old + G @ (later - ahead)
    P = old_P + G @ (later_P - ahead_P) @ G.T
    out_P[:] = 0.5 * (P + P.T)
    cross = later_P @ G.T
    for a in range(3):
        for b in range(3):
            moved_P[a, b] = later_P[a, b] + out_P[a, b] - cross[a, b] - cross[b, a]


@kernel
def run_smoother(tau: Floats, density: Floats, rows: Records) -> None:
    """Turn what `run_filter` gave into the estimates from all poses of each track."""
    F, Q = np.empty((STATES, STATES)), np.empty((STATES, STATES))
    next_pose = -1
    for k in range(len(tau) - 1, -1, -1):
        row: Smoothed = rows[k]
        if np.isnan(row.state[0]):
            continue
        if next_pose >= 0 and not rows[next_pose].begins:
            later: Smoothed = rows[next_pose]
            transition(tau[next_pose] - tau[k], density, F, Q)
            old, old_P = row.state.copy(), row.covariance.copy()
            predicted = (old, old_P, F, F @ old, F @ old_P @ F.T + Q)
            step_back(predicted, later.state, later.covariance, row.state, row.covariance, later.moved_covariance)
        next_pose = k
