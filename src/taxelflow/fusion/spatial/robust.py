"""Which contact is wrong: leave-one-out on top of the weighted solution.

If chi-square is too large, each contact is left out in turn. It is blamed if that explains the contradiction and
leaving out any other explains it significantly worse, by the scatter of those that are left; else nobody is, as with
three contacts, where leaving out any one explains everything. Fewer than a third of the contacts can be blamed: if
more contradict, all covariances are doubted instead. What remains of the contradiction is for the covariance
(`Verdict`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.fusion.spatial.solve import Contacts, Solution, solve
from taxelflow.runtime.compiling import lean_kernel, routine

_SIGMAS = 3.09
"""Normal deviate of 99.9 %: the quantile of chi-square beyond which contacts contradict each other."""
_CLEARLY = 10.8
"""Difference of chi-square between the two best contacts to leave out: 99.9 % point of one degree of freedom."""


class Verdict(NamedTuple):
    """rank: number of observable directions. chi2, freedom: misfit of the contacts used and its degrees of freedom.
    contradicted: whether a contradiction is left that no contact could be blamed for.
    """

    rank: int
    chi2: float
    freedom: float
    contradicted: bool


@lean_kernel
def most_chi2(freedom: float) -> float:
    """The 99.9 % quantile of chi-square, by the cube-root approximation of Wilson & Hilferty (1931)."""
    spread = 2.0 / (9.0 * freedom)
    root: float = 1.0 - spread + _SIGMAS * np.sqrt(spread)
    return freedom * root * root * root


@routine
def solve_robustly(contacts: Contacts, limit: float, out: Solution) -> Verdict:
    """Fill the solution without the contacts that are blamed, whose use becomes -1."""
    rank = solve(contacts, limit, out)
    chi2, freedom = misfit(contacts, rank, out)
    count = 0
    for pad in range(len(contacts.use)):
        count += contacts.use[pad] > 0.0
    left = (count - 1) // 3
    while freedom > 0.0 and chi2 > most_chi2(freedom):
        worst = most_to_blame(contacts, limit, rank, out) if left > 0 else -1
        left -= 1
        if worst < 0:
            rank = solve(contacts, limit, out)
            return Verdict(rank, chi2, freedom, True)
        contacts.use[worst] = -1.0
        rank = solve(contacts, limit, out)
        chi2, freedom = misfit(contacts, rank, out)
    return Verdict(rank, chi2, freedom, False)


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
def most_to_blame(contacts: Contacts, limit: float, rank: int, out: Solution) -> int:
    """The contact without which the others agree, far better than without any other; -1 if there is none."""
    worst, best, second, scatter = -1, np.inf, np.inf, 1.0
    for pad in range(len(contacts.use)):
        if contacts.use[pad] > 0.0:
            contacts.use[pad] = 0.0
            seen = solve(contacts, limit, out)
            chi2, freedom = misfit(contacts, seen, out)
            contacts.use[pad] = 1.0
            if seen < rank or freedom <= 0.0:
                chi2 = 0.0  # nothing is left to contradict: this one may be to blame as well as any
            if chi2 < best:
                worst, best, second = pad, chi2, best
                scatter = max(1.0, chi2 / freedom) if freedom > 0.0 else 1.0
            else:
                second = min(second, chi2)
    return worst if second - best > _CLEARLY * scatter else -1
