"""Detection of a wrong contact: leave-one-out on the weighted solution.

If chi-square is too large, or one contact has far more of it than the scatter of the others explains, each contact is
left out in turn. It is blamed if the others then agree, and agree significantly less without any other contact, by
their scatter. Otherwise none is blamed, as with three contacts, of which any two agree. Fewer than a third of the
contacts can be blamed: if more contradict each other, all covariances are increased. What remains of the contradiction
increases the covariance, too (`Verdict`).

The scatter is that of this scan, not of the last ones. These contain the misfit of a wrong contact that could not be
blamed yet, as while the window of the velocities fills; with that scatter it would never be blamed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri

from taxelflow.fusion.spatial.solve import Contacts, Solution, solve
from taxelflow.messages import Floats
from taxelflow.numerics.se3 import carried
from taxelflow.numerics.small_linalg import factor_small, solve_factored
from taxelflow.runtime.compiling import lean_kernel, routine

_AGREE = 0.999
"""Probability with which contacts that agree stay below the limits of chi-square and of F."""
_SIGMAS = float(ndtri(_AGREE))
"""Its normal deviate, of which both limits are made."""
_CLEARLY = float(chdtri(1.0, 1.0 - _AGREE))
"""Difference of chi-square, of one degree of freedom, between the two best contacts to leave out."""


class Verdict(NamedTuple):
    """rank: number of observable directions. chi2, freedom: misfit of the contacts used and its degrees of freedom.
    contradicted: whether a contradiction is left that no contact could be blamed for. blamed: how many were.
    """

    rank: int
    chi2: float
    freedom: float
    contradicted: bool
    blamed: int


@lean_kernel
def most_chi2(freedom: float) -> float:
    """The quantile of chi-square for `_AGREE`, by the cube-root approximation of Wilson & Hilferty (1931)."""
    spread = 2.0 / (9.0 * freedom)
    root: float = 1.0 - spread + _SIGMAS * np.sqrt(spread)
    return freedom * root * root * root


@lean_kernel
def excess(numerator: float, freedom: float) -> float:
    """Normal deviate of an F of 3 and `freedom` degrees of freedom, by the approximation of Paulson (1942)."""
    root, own, others = numerator ** (1.0 / 3.0), 2.0 / 27.0, 2.0 / (9.0 * freedom)
    deviate: float = ((1.0 - others) * root - (1.0 - own)) / np.sqrt(others * root * root + own)
    return deviate


@routine
def solve_robustly(contacts: Contacts, limit: float, usual: float, out: Solution) -> Verdict:
    """Fill the solution without the contacts that are blamed, whose use becomes -1.

    usual: see `usual_misfit`, by which the information of the contacts has been divided.
    """
    rank = solve(contacts, limit, out)
    chi2, freedom = misfit(contacts, rank, out)
    count = 0
    for pad in range(len(contacts.use)):
        count += contacts.use[pad] > 0.0
    left, blamed = (count - 1) // 3, 0
    while freedom > 0.0:
        too_large = chi2 > most_chi2(freedom)
        if not (too_large or (left > 0 and one_stands_out(contacts, chi2, freedom, usual, out))):
            break
        worst = most_to_blame(contacts, limit, usual, rank, out) if left > 0 else -1
        left -= 1
        if worst < 0:
            rank = solve(contacts, limit, out)
            return Verdict(rank, chi2, freedom, too_large, blamed)
        contacts.use[worst] = -1.0
        blamed += 1
        rank = solve(contacts, limit, out)
        chi2, freedom = misfit(contacts, rank, out)
    return Verdict(rank, chi2, freedom, False, blamed)


@routine
def misfit(contacts: Contacts, rank: int, out: Solution) -> tuple[float, float]:
    """Chi-square of the contacts used, the joints' errors included, and its degrees of freedom."""
    chi2, measured = 0.0, 0
    for pad in range(len(contacts.use)):
        if contacts.use[pad] > 0.0:
            chi2 += out.chi2[pad]
            for a in range(3):
                measured += contacts.W[pad, a, a] > 0.0
    for j in range(len(out.joints)):
        chi2 += contacts.sure[j] * out.joints[j] ** 2
    return chi2, float(measured - rank)


@routine
def one_stands_out(contacts: Contacts, chi2: float, freedom: float, usual: float, out: Solution) -> bool:
    """Whether one contact has far more of chi-square than the scatter of the others explains, by an F test; where
    their covariances explain all, none has.
    """
    if chi2 * usual <= most_chi2(freedom):
        return False
    half, M, weighted = np.empty((3, 6)), np.empty((3, 3)), np.empty(3)
    for pad in range(len(contacts.use)):
        parts = 3 if contacts.W[pad, 2, 2] > 0.0 else 2
        their_freedom = freedom - parts
        if not (contacts.use[pad] > 0.0 and their_freedom > 0.0):
            continue
        less = share_of(contacts, pad, parts, out, half, M, weighted)
        scatter = max(max(chi2 - less, 0.0) / their_freedom, 1.0 / usual)
        if excess(less / (parts * scatter), their_freedom) > _SIGMAS:
            return True
    return False


@lean_kernel
def share_of(
    contacts: Contacts, pad: int, parts: int, out: Solution, half: Floats, M: Floats, weighted: Floats
) -> float:
    """By how much chi-square falls without a contact: w^T (W - W H C H^T W)^-1 w with w = W r, of its residual r.

    half (3, 6), M (3, 3), weighted (3,): work. Joints' errors are taken as they are. Source: Cook & Weisberg 1982,
    Residuals and influence in regression, section 2.2.
    """
    W, H = contacts.W[pad], contacts.rows[pad]
    for a in range(parts):
        total = 0.0
        for b in range(parts):
            total += W[a, b] * out.residual[pad, b]
        weighted[a] = total
        for i in range(6):
            half[a, i] = 0.0
            for b in range(parts):
                half[a, i] += W[a, b] * H[b, i]
    for a in range(parts):
        for b in range(a + 1):
            M[a, b] = W[a, b] - carried(half[a], out.covariance, half[b])
    if not factor_small(M, parts):
        return 0.0
    total, was = 0.0, (weighted[0], weighted[1], weighted[2])
    solve_factored(M, weighted, parts)
    for a in range(parts):
        total += was[a] * weighted[a]
    return total


@routine
def most_to_blame(contacts: Contacts, limit: float, usual: float, rank: int, out: Solution) -> int:
    """The contact without which the others agree significantly better than without any other; -1 if there is none."""
    worst, best, second, scatter = -1, np.inf, np.inf, 1.0 / usual
    for pad in range(len(contacts.use)):
        if contacts.use[pad] > 0.0:
            contacts.use[pad] = 0.0
            seen = solve(contacts, limit, out)
            chi2, freedom = misfit(contacts, seen, out)
            contacts.use[pad] = 1.0
            if seen < rank or freedom <= 0.0:
                chi2 = 0.0  # no redundancy is left: this contact may be the wrong one as well as any
            if chi2 < best:
                worst, best, second = pad, chi2, best
                scatter = max(1.0 / usual, chi2 / freedom) if freedom > 0.0 else 1.0 / usual
            else:
                second = min(second, chi2)
    return worst if second - best > _CLEARLY * scatter else -1
