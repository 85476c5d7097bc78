"""The object's twist in space from the slips of pads, one scan: a weighted, robust solution."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from taxelflow.fusion.misfit import MISFIT
from taxelflow.fusion.spatial.robust import Verdict, solve_robustly
from taxelflow.fusion.spatial.solve import Contacts, Solution
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2
from taxelflow.numerics.se3 import multiply, planar_rows, product_of
from taxelflow.runtime.compiling import lean_kernel, routine


class Limits(NamedTuple):
    """twist_m_s, pose_m: standard deviations beyond which a direction is not observable. length_m: scale of turns."""

    twist_m_s: float
    pose_m: float
    length_m: float


class Sixfold:
    """Six components of one scan, in the hand frame, its point at the hand's origin; fields as in `SpatialMotions`."""

    value: Annotated[Floats, 6]
    covariance: Annotated[Floats, 6, 6]
    blind: Annotated[Floats, 6, 6]
    rank: float


class Misfit:
    """Chi-square and degrees of freedom over the last scans."""

    chi2: float
    freedom: float


@routine
def fuse_twist(
    seen: Floats,
    covariance: Floats,
    known: Bools,
    usual: float,
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
) -> Verdict:
    """Solve for the twist of one scan, scaled and at the mean of the contacts; `unscale` takes it back.

    seen: (pads, 3), velocity in the hand of the object's point at a contact, along x and y of its frame, m/s, and rate
    about its z, NaN if unknown. covariance: (pads, 3, 3). known: (pads,). usual: `usual_misfit`. Rows and
    joints of the contacts are filled in.
    """
    for pad in range(len(known)):
        contacts.use[pad] = 1.0 if known[pad] else 0.0
        fill_information(covariance[pad], known[pad], contacts.W[pad])
        for a in range(3):
            contacts.y[pad, a] = seen[pad, a] if contacts.W[pad, a, a] > 0.0 else 0.0
    doubt_all(contacts, usual)
    return solve_robustly(contacts, limits.twist_m_s, usual, solution)


@routine
def centre_of(frames: Floats, known: Bools) -> Floats:
    """(3,): mean place of the contacts."""
    centre, count = np.zeros(3), 0
    for pad in range(len(known)):
        if known[pad]:
            count += 1
            for i in range(3):
                centre[i] += frames[pad, i, 3]
    for i in range(3):
        centre[i] /= max(count, 1)
    return centre


@routine
def fill_rows(frames: Floats, centre: Floats, length_m: float, rows: Floats) -> None:
    """Fill rows (pads, 3, 6): what each contact sees of a twist at the centre, scaled."""
    for pad in range(len(frames)):
        planar_rows(frames[pad], centre, rows[pad])
        for a in range(3):
            for i in range(3, 6):
                rows[pad, a, i] /= length_m


@routine
def fill_joints(J: Floats, std: float, centre: Floats, length_m: float, contacts: Contacts) -> None:
    """Fill G: what each contact sees of errors of the joints, and their information. J: (pads, 6, joints), twists of
    the pads at the hand's origin per rate of each joint. std: of a joint's error.
    """
    for j in range(len(contacts.sure)):
        contacts.sure[j] = 1.0 / (std * std)
        for pad in range(len(J)):
            for a in range(3):
                contacts.G[pad, a, j] = seen_of(contacts.rows[pad, a], J[pad, :, j], centre, length_m)


@lean_kernel
def seen_of(row: Floats, twist: Floats, centre: Floats, length_m: float) -> float:
    """What a scaled row (6,) about the centre sees of a twist (6,) at the hand's origin."""
    total = 0.0
    for i in range(3):
        n, m = (i + 1) % 3, (i + 2) % 3
        total += row[i] * (twist[i] + twist[3 + n] * centre[m] - twist[3 + m] * centre[n])
        total += row[3 + i] * length_m * twist[3 + i]
    return total


@lean_kernel
def fill_information(covariance: Floats, known: bool, W: Floats) -> None:
    """Fill W (3, 3) with the inverse of a covariance whose last axis may be unknown (NaN): it then has none.

    By L D L^T, written out: it needs no arrays, which `factor_small` and `solve_factored` do.
    """
    for a in range(3):
        for b in range(3):
            W[a, b] = 0.0
    d0 = covariance[0, 0] + LEAST_VARIANCE_M2
    if not (known and d0 > 0.0):
        return
    l10 = covariance[1, 0] / d0
    d1 = covariance[1, 1] + LEAST_VARIANCE_M2 - l10 * l10 * d0
    if not d1 > 0.0:
        return
    l20 = l21 = of_last = 0.0
    if covariance[2, 2] > 0.0:
        l20 = covariance[2, 0] / d0
        l21 = (covariance[2, 1] - l20 * l10 * d0) / d1
        d2 = covariance[2, 2] + LEAST_VARIANCE_M2 - l20 * l20 * d0 - l21 * l21 * d1
        if not d2 > 0.0:
            return
        of_last = 1.0 / d2
    back = l21 * l10 - l20
    W[2, 2] = of_last
    W[1, 2] = W[2, 1] = -l21 * of_last
    W[0, 2] = W[2, 0] = back * of_last
    W[1, 1] = 1.0 / d1 + l21 * l21 * of_last
    W[0, 1] = W[1, 0] = -l10 / d1 - l21 * back * of_last
    W[0, 0] = 1.0 / d0 + l10 * l10 / d1 + back * back * of_last


@routine
def to_origin(centre: Floats, length_m: float) -> Floats:
    """(6, 6), the adjoint of the shift from the centre to the hand's origin, times the scale."""
    A = np.zeros((6, 6))
    for i in range(3):
        n, m = (i + 1) % 3, (i + 2) % 3
        A[i, i] = 1.0
        A[3 + i, 3 + i] = 1.0 / length_m
        A[i, 3 + m] = centre[n] / length_m  # v at the origin: v + centre x omega
        A[i, 3 + n] = -centre[m] / length_m
    return A


@routine
def unscale(solution: Solution, verdict: Verdict, centre: Floats, length_m: float, limit: float, out: Sixfold) -> None:
    """Fill value, covariance, blind directions and rank: from the centre, scaled, to the hand's origin, in rad."""
    A, carried, blind = to_origin(centre, length_m), np.empty((6, 6)), 0
    multiply(A, solution.covariance, carried)
    multiply(carried, A.T, out.covariance)
    for i in range(6):
        out.value[i] = product_of(A[i], solution.xi)
    for d in range(6):
        if not solution.values[d] * limit * limit > 1.0:
            for i in range(6):
                out.blind[blind, i] = product_of(A[i], solution.vectors[:, d])
            blind += 1
    out.rank = verdict.rank


@lean_kernel
def usual_misfit(past: Misfit) -> float:
    """Reduced chi-square of the last scans, at least 1: by how much the contacts' covariances are too small."""
    return max(1.0, past.chi2 / past.freedom) if past.freedom > MISFIT.least_freedom else 1.0


@lean_kernel
def doubt_all(contacts: Contacts, usual: float) -> None:
    """Divide the information of all contacts by the usual misfit."""
    for pad in range(len(contacts.use)):
        for a in range(3):
            for b in range(3):
                contacts.W[pad, a, b] /= usual


@lean_kernel
def widen(past: Misfit, usual: float, verdict: Verdict, out: Sixfold) -> float:
    """Remember a scan's misfit, whose covariance allows for the usual one, and widen by what has come to it since; by
    what factor.
    """
    if verdict.freedom > 0.0:
        past.chi2 = MISFIT.memory * past.chi2 + usual * verdict.chi2
        past.freedom = MISFIT.memory * past.freedom + verdict.freedom
    factor = max(usual_misfit(past) / usual, 1.0)
    if verdict.contradicted:
        factor = max(factor, verdict.chi2 / verdict.freedom)
    for i in range(6):
        for j in range(6):
            out.covariance[i, j] *= factor
    return factor
