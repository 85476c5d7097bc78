"""Kalman filter and Rauch-Tung-Striebel smoother of a constant velocity with white acceleration.

State (x, y, theta and their velocities); over dt, per axis, with q the spectral density of the acceleration,
F = [[1, dt], [0, 1]],  Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]
(Bar-Shalom, Li & Kirubarajan 2001, 6.2.2; smoother 8.6).
A pose without theta measures x and y alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats

STATES = 6
RUN, TAU, STATE, COVARIANCE, MEMORY = 0, 1, 2, 8, 44
"""Memory of a track: whether it runs, the time of its last pose, state and covariance."""
_SPEED, _SPIN, _ANY_TURN = 1.0, 100.0, 10.0
"""Standard deviations at a track's start: velocity in m/s and rad/s, and a turn that is not known."""


@kernel
def transition(dt: float, density: Floats, F: Floats, Q: Floats) -> None:
    """Fill F and Q (6, 6). density: (3,) m^2/s^3, m^2/s^3, rad^2/s^3."""
    F[:], Q[:] = 0.0, 0.0
    for a in range(3):
        F[a, a] = F[a + 3, a + 3] = 1.0
        F[a, a + 3] = dt
        Q[a, a] = density[a] * dt * dt * dt / 3.0
        Q[a, a + 3] = Q[a + 3, a] = density[a] * dt * dt / 2.0
        Q[a + 3, a + 3] = density[a] * dt


@kernel
def update(x: Floats, P: Floats, pose: Floats, noise: Floats) -> None:
    """Take in a pose (3,) with noise (3, 3), in Joseph's form."""
    seen = 2 if np.isnan(pose[2]) or np.isnan(noise[2, 2]) else 3
    S = P[:seen, :seen] + noise[:seen, :seen]
    K = np.linalg.solve(S, np.ascontiguousarray(P[:seen])).T
    x += K @ (pose[:seen] - x[:seen])
    A = np.eye(STATES)
    A[:, :seen] -= K
    P[:] = A @ P @ A.T + K @ np.ascontiguousarray(noise[:seen, :seen]) @ K.T
    P[:] = 0.5 * (P + P.T)


@kernel
def run_filter(
    tau: Floats,
    pose: Floats,
    noise: Floats,
    touched: Bools,
    density: Floats,
    memory: Floats,
    x: Floats,
    P: Floats,
    begins: Bools,
    back: Floats,
    back_P: Floats,
    moved_P: Floats,
    span: Floats,
) -> None:
    """Fill x (n, 6), P (n, 6, 6) after each pose, where a track begins, and what it says of the pose before: back (n,
    6), back_P (n, 6, 6); moved_P (n, 3, 3) of the displacement; span (n,) since then. Rows without a pose stay NaN.

    tau: (n,) when poses are, pose (n, 3), noise (n, 3, 3), touched (n,): in contact. memory: (MEMORY,).
    """
    m, F, Q = memory, np.empty((STATES, STATES)), np.empty((STATES, STATES))
    for k in range(len(tau)):
        if not touched[k]:
            m[RUN] = 0.0
        if not touched[k] or np.isnan(pose[k, 0]) or np.isnan(noise[k, 0, 0]):
            continue
        state, cov = m[STATE:COVARIANCE].copy(), m[COVARIANCE:].copy().reshape((STATES, STATES))
        begins[k] = m[RUN] == 0.0
        if begins[k]:
            state[:], cov[:] = 0.0, 0.0
            known = not np.isnan(pose[k, 2])
            for a in range(3):
                state[a] = pose[k, a] if a < 2 or known else 0.0
                for b in range(3):
                    if known or (a < 2 and b < 2):
                        cov[a, b] = noise[k, a, b]
                cov[a + 3, a + 3] = _SPEED**2 if a < 2 else _SPIN**2
            if not known:
                cov[2, 2] = _ANY_TURN**2
        else:
            span[k] = tau[k] - m[TAU]
            transition(span[k], density, F, Q)
            old, old_P = state.copy(), cov.copy()
            ahead, ahead_P = F @ state, F @ cov @ F.T + Q
            state[:], cov[:] = ahead, ahead_P
            update(state, cov, pose[k], noise[k])
            step_back(old, old_P, F, ahead, ahead_P, state, cov, back[k], back_P[k], moved_P[k])
        x[k], P[k] = state, cov
        m[RUN], m[TAU] = 1.0, tau[k]
        m[STATE:COVARIANCE] = state
        m[COVARIANCE:] = cov.ravel()


@kernel
def step_back(
    old: Floats,
    old_P: Floats,
    F: Floats,
    ahead: Floats,
    ahead_P: Floats,
    later: Floats,
    later_P: Floats,
    out: Floats,
    out_P: Floats,
    moved_P: Floats,
) -> None:
    """Fill out (6,), out_P (6, 6): the state before, given all that the later one knows; moved_P: of their difference.

    old: the state before by itself; ahead: what it predicts for the later time.
    """
    G = np.linalg.solve(ahead_P, F @ old_P).T
    out[:] = old + G @ (later - ahead)
    P = old_P + G @ (later_P - ahead_P) @ G.T
    out_P[:] = 0.5 * (P + P.T)
    cross = later_P @ G.T
    for a in range(3):
        for b in range(3):
            moved_P[a, b] = later_P[a, b] + out_P[a, b] - cross[a, b] - cross[b, a]


@kernel
def run_smoother(tau: Floats, density: Floats, x: Floats, P: Floats, begins: Bools, moved_P: Floats) -> None:
    """Turn what `run_filter` gave into what all poses of each track say together."""
    F, Q = np.empty((STATES, STATES)), np.empty((STATES, STATES))
    out, out_P = np.empty(STATES), np.empty((STATES, STATES))
    later = -1
    for k in range(len(tau) - 1, -1, -1):
        if np.isnan(x[k, 0]):
            continue
        if later >= 0 and not begins[later]:
            transition(tau[later] - tau[k], density, F, Q)
            old, old_P = x[k].copy(), P[k].copy()
            ahead, ahead_P = F @ old, F @ old_P @ F.T + Q
            step_back(old, old_P, F, ahead, ahead_P, x[later], P[later], out, out_P, moved_P[later])
            x[k], P[k] = out, out_P
        later = k
