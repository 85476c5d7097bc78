"""Patterns of smooth contacts, fitted to a scan of a pad.

With q a polynomial of degree 2 in x and y, a smooth contact presses one of
    p = q           elastic foundation (Winkler),
    p = q^(1/2)     half-space (Hertz),
    p = q^2         either one under a soft cover,
    p = exp(q)      a spread point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.small_linalg import factor_small, solve_factored
from taxelflow.runtime.compiling import routine

TERMS = 6
"""Coefficients of q."""
_LAWS = (1.0, 2.0, 0.5, 0.0)
"""Exponents e of p^e = q; 0: log p = q."""


class Scratch(NamedTuple):
    """Room for the taxels of a pad. rest, left, shares, least: (taxels,). terms: (taxels, TERMS). normal: (TERMS,
    TERMS). right: (TERMS,).
    """

    rest: Floats
    left: Floats
    shares: Floats
    least: Floats
    terms: Floats
    normal: Floats
    right: Floats


def room_for(taxels: int) -> Scratch:
    """Scratch for pads of at most this many taxels."""
    rest, left, shares, least = np.zeros((4, taxels))
    return Scratch(rest, left, shares, least, np.zeros((taxels, TERMS)), np.zeros((TERMS, TERMS)), np.zeros(TERMS))


@routine
def fit_smooth(p: Floats, noise: Floats, x: Floats, y: Floats, scratch: Scratch) -> int:
    """Fill `Scratch.rest` with what the best law of smooth contact leaves of the loaded taxels; how many they are."""
    rest, left, terms = scratch.rest, scratch.left, scratch.terms
    loaded, peak, reach = 0, 0.0, 0.0
    for k in range(len(p)):
        rest[k] = 0.0
        if p[k] > LOADED.sigmas * noise[k]:
            loaded += 1
            peak = max(peak, p[k])
        reach = max(reach, abs(x[k] - x[0]), abs(y[k] - y[0]))
    if loaded <= TERMS:
        return loaded
    least = np.inf
    for k in range(len(p)):
        u, v = (x[k] - x[0]) / reach, (y[k] - y[0]) / reach
        terms[k, 0], terms[k, 1], terms[k, 2] = 1.0, u, v
        terms[k, 3], terms[k, 4], terms[k, 5] = u * u, u * v, v * v
    for k in range(len(p)):
        scratch.shares[k], scratch.least[k] = p[k] / peak, LOADED.sigmas * noise[k] / peak
    for law in _LAWS:
        energy = fit_law(law, len(p), scratch)
        if energy < least:
            least = energy
            for k in range(len(p)):
                rest[k] = peak * left[k]
    return loaded


@routine
def fit_law(law: float, taxels: int, scratch: Scratch) -> float:
    """Fit p^law = q by weighted least squares; fill `Scratch.left` with p less the fit, and return its energy.

    p: `Scratch.shares`. The weights make residuals of q those of p, to first order. A loaded taxel has more than
    `Scratch.least`.
    """
    p, least, terms, left, A, b = (
        scratch.shares,
        scratch.least,
        scratch.terms,
        scratch.left,
        scratch.normal,
        scratch.right,
    )
    for i in range(TERMS):
        b[i] = 0.0
        for j in range(TERMS):
            A[i, j] = 0.0
    for k in range(taxels):
        if p[k] > least[k]:
            slope = p[k] if law == 0.0 else p[k] ** (1.0 - law) / law
            target = np.log(p[k]) if law == 0.0 else p[k] ** law
            add_row(slope * slope, terms[k], target, A, b)
    for i in range(TERMS):
        A[i, i] += 1e-9 * A[0, 0]  # taxels in one row leave some terms open
    if not factor_small(A, TERMS):
        return np.inf
    solve_factored(A, b, TERMS)
    energy = 0.0
    for k in range(taxels):
        left[k] = 0.0
        if p[k] > least[k]:
            q = 0.0
            for i in range(TERMS):
                q += terms[k, i] * b[i]
            left[k] = p[k] - (np.exp(min(q, 1.0)) if law == 0.0 else max(q, 0.0) ** (1.0 / law))
            energy += left[k] ** 2
    return energy


@routine
def add_row(weight: float, terms: Floats, target: float, A: Floats, b: Floats) -> None:
    """Add an equation, terms (n,) times the unknowns = target, to the normal equations A (n, n), b (n,)."""
    for i in range(len(terms)):
        b[i] += weight * terms[i] * target
        for j in range(len(terms)):
            A[i, j] += weight * terms[i] * terms[j]
