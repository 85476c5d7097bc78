"""Bundle adjustment: maximum likelihood of pattern and poses over all scans of a contact.

Gauss-Newton steps; the coefficients' block of the normal matrix is banded and factored, and the poses' Schur complement
solved by conjugate gradients, so that time and memory grow linearly with the number of scans.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from taxelflow.estimation.template.normal_equations import Normal, assemble, to_knots, to_states
from taxelflow.numerics.banded import Factor, add_diagonal, multiply, smoothness
from taxelflow.numerics.bspline import STATE, States, pose_part, states_of
from taxelflow.numerics.rounding import NEGLIGIBLE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Readings, Scanned
    from taxelflow.messages import Bools, Floats

_MOST_STEP = np.array([1.0, 1.0, 0.15, 0.2, 0.05])
"""Largest step of a state in one round; the first two in knots."""
_GAINS, _SIZES = (0.02, 50.0), (-0.7, 0.7)
"""Bounds of gains, and of the logarithm of sizes, against steps that diverge."""


class _Solver(NamedTuple):
    """Rounds of the adjustment, the conjugate gradients of each, and the estimate of a trace."""

    settled: float = 0.05
    """Steps of a pose, in its standard deviations, below which the fit has converged."""
    worse: float = 1.1
    """A round that increases the cost by this factor is undone."""
    iterations: int = 60
    residual: float = 1e-2
    """Conjugate gradients: iterations at most, and their relative residual, which rounds reduce further."""
    probes: int = 16
    work: int = 16_000
    """Trace: random vectors at most, and times knots; its relative error falls with both."""


_SOLVER = _Solver()
LEAST_INFORMATION = 1e-9
"""Added to the information on each component of a state, which may be 0."""


@dataclass(slots=True, eq=False)
class Fit:
    """The result of a bundle adjustment.

    chi, counts: (scans,), robust chi-square and the readings in it. residual, weight, model: (scans, taxels).
    information: (scans, 5, 5) of the states with the pattern held. factor: of the coefficients' block. free: number of
    parameters that the readings determine; freed: components of each scan's state among them. bending: the
    pattern's squared second differences.
    """

    chi: Floats
    counts: NDArray[np.int64]
    residual: Floats
    weight: Floats
    model: Floats
    information: Floats
    factor: Factor
    free: float
    freed: int
    bending: float

    @property
    def covariance(self) -> Floats:
        """(scans, 5, 5), of the states with the pattern held."""
        return covariance_of(self.information)

    @property
    def per_reading(self) -> Floats:
        """(scans,), chi-square per reading."""
        share: Floats = self.chi / np.maximum(self.counts, 1)
        return share

    @property
    def reduced(self) -> float:
        """Chi-square per reading."""
        return float(self.chi.sum() / max(self.counts.sum(), 1))

    @property
    def freedom(self) -> float:
        """Share of the readings that is left to check the fit by."""
        count = max(int(self.counts.sum()), 1)
        return max(1.0 - self.free / count, 0.1)


def covariance_of(information: Floats) -> Floats:
    """(scans, 5, 5), of states, from their information."""
    return np.asarray(np.linalg.inv(information + LEAST_INFORMATION * np.eye(STATE)), np.float64)


def diagonals_of(matrices: Floats) -> States:
    """Diagonals of matrices (scans, 5, 5) over states."""
    return states_of(matrices.diagonal(axis1=1, axis2=2))


class Linear:
    """The problem, linearised at the present pattern and states."""

    def __init__(self, pattern: Pattern, readings: Readings, fixed: Bools, level: float) -> None:
        self.pattern, self.readings, self._free = pattern, readings, np.where(fixed, 0.0, 1.0)
        self._level = level
        scans, taxels = readings.value.shape
        self.normal = Normal.empty(scans, taxels, pattern.coefficients.size)
        self.smooth = smoothness(pattern.shape)
        self.bent = np.empty(pattern.coefficients.size)

    def update(self, states: Floats) -> None:
        """Linearise at states (scans, 5)."""
        assemble(self.pattern.surface, self.readings, states, self._free, self._level, self.normal)
        multiply(self.smooth, self.pattern.shape[1], self.pattern.coefficients.ravel(), self.bent)

    def bending(self) -> float:
        """Sum of squared second differences of the pattern."""
        return float(self.pattern.coefficients.ravel() @ self.bent)

    def regularise(self) -> None:
        """Add the pattern's priors to its equations."""
        pattern = self.pattern
        stencil, right = self.normal.stencil, self.normal.right
        stencil += pattern.smoothing * self.smooth
        add_diagonal(stencil, pattern.prior)
        right -= pattern.smoothing * self.bent + pattern.prior * pattern.coefficients.ravel()

    def add_prior(self, precision: Floats) -> None:
        """Add the prior of the states, see `refine`, to their information; that of a fixed component becomes 1."""
        blocks, diagonal = self.normal.blocks, np.arange(STATE)
        strong = blocks[:, diagonal, diagonal].max(axis=1, keepdims=True)
        prior = np.where(np.isinf(precision), 1.0, precision)
        blocks[:, diagonal, diagonal] += prior + LEAST_INFORMATION + NEGLIGIBLE * strong

    def determined(self, factor: Factor) -> float:
        """Number of coefficients that the readings determine, not their priors: a trace, by random vectors."""
        pattern, knots = self.pattern, len(self.normal.right)
        probes = min(_SOLVER.probes, -(-_SOLVER.work // knots))
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (probes, knots))
        held = np.empty(knots)
        total = 0.0
        for sign, back in zip(signs, factor.solve(signs.T).T, strict=True):
            multiply(self.smooth, pattern.shape[1], sign, held)
            total += knots - float(back @ (pattern.smoothing * held + pattern.prior * sign))
        return total / probes


@dataclass(slots=True, eq=False)
class _Best:
    merit: float
    states: Floats
    coefficients: Floats
    smoothing: float

    def restore(self, pattern: Pattern, states: Floats) -> None:
        states[:], pattern.coefficients, pattern.smoothing = self.states, self.coefficients, self.smoothing


def refine(
    pattern: Pattern,
    scanned: Scanned,
    states: Floats,
    *,
    rounds: int,
    error: float,
    precision: Floats,
    level: float = 0.0,
) -> Fit:
    """Improve the pattern and the states (scans, 5), in place; the pattern's smoothing is learned on the way.

    error: see `Scanned.with_error`. precision: (5,) 1 / variance of each state around 0, of a place around the
    pad's middle, of the gain around 1; infinite where a state is not to move. level: see `assemble`.
    The object's frame, which nothing determines, is that in which the mean of the poses stays.
    """
    fixed = np.isinf(precision)
    usual, pull = np.array([*scanned.middle, 0.0, 1.0, 0.0]), np.where(fixed, 0.0, precision)
    linear = Linear(pattern, scanned.with_error(error), fixed, level)
    normal = linear.normal
    best, damping = _Best(np.inf, states, pattern.coefficients, pattern.smoothing), 0.0
    parts, diagonal = states_of(states), np.arange(STATE)
    for round_ in range(rounds + 1):
        linear.update(states)
        merit = float(normal.chi.sum() + (pull * (states - usual) ** 2).sum() + pattern.smoothing * linear.bending())
        if merit > _SOLVER.worse * best.merit:
            best.restore(pattern, states)
            linear.update(states)
            damping = max(10.0 * damping, 0.1)
        elif merit < best.merit:
            best = _Best(merit, states.copy(), pattern.coefficients, pattern.smoothing)
        if round_:
            pattern.learn_smoothing(linear.bending(), error)
        linear.regularise()
        normal.gradient[:] -= pull * (states - usual)
        normal.gradient[:, fixed] = 0.0
        linear.add_prior(precision)
        factor = Factor(normal.stencil, pattern.shape[1])
        if round_ == rounds:
            break
        step, back = _solve(factor, linear, damping)
        states += step
        np.clip(parts.gain, *_GAINS, out=parts.gain)
        np.clip(parts.size, *_SIZES, out=parts.size)
        pattern.coefficients = pattern.coefficients + back.reshape(pattern.shape)
        relative = pose_part(step) - pose_part(step).mean(axis=0)
        moves = relative**2 * pose_part(normal.blocks[:, diagonal, diagonal])
        if np.sqrt(moves.mean(axis=0).max()) < _SOLVER.settled:
            break
    free = linear.determined(factor) + len(states) * int(np.sum(~fixed))
    return Fit(
        chi=normal.chi,
        counts=normal.counts,
        residual=normal.residual,
        weight=normal.w,
        model=normal.model,
        information=normal.blocks,
        factor=factor,
        free=free,
        freed=int(np.sum(~fixed)),
        bending=linear.bending(),
    )


def linearised(
    pattern: Pattern, scanned: Scanned, states: Floats, error: float, precision: Floats, level: float = 0.0
) -> Linear:
    """The problem at states (scans, 5), with their prior. Arguments as for `refine`.

    Its `normal.blocks` are the information (scans, 5, 5) of scans on their states, the pattern held.
    """
    linear = Linear(pattern, scanned.with_error(error), np.isinf(precision), level)
    linear.update(states)
    linear.add_prior(precision)
    return linear


def _solve(factor: Factor, linear: Linear, damping: float) -> tuple[Floats, Floats]:
    """Steps of the states (scans, 5), none longer than allowed, and of the coefficients (knots,) that go with them."""
    blocks = linear.normal.blocks.copy()
    diagonal = np.arange(STATE)
    blocks[:, diagonal, diagonal] *= 1.0 + damping
    inverse = np.linalg.inv(blocks)
    # Holds the mean step at 0, which pattern and poses leave open.
    frame = pose_part(blocks[:, diagonal, diagonal]).mean(axis=0)
    normal, nx, shape = linear.normal, linear.pattern.shape[1], linear.normal.gradient.shape

    def reduced(vector: Floats) -> Floats:
        step = vector.reshape(shape)
        result = np.einsum("kab,kb->ka", blocks, step) - to_states(factor.solve(to_knots(step, normal, nx)), normal, nx)
        pose_part(result)[:] += frame * pose_part(step).mean(axis=0)
        flat: Floats = result.ravel()
        return flat

    def precondition(vector: Floats) -> Floats:
        result: Floats = np.einsum("kab,kb->ka", inverse, vector.reshape(shape)).ravel()
        return result

    size = normal.gradient.size
    operator = LinearOperator((size, size), matvec=reduced, dtype=np.float64)
    guide = LinearOperator((size, size), matvec=precondition, dtype=np.float64)
    target = (normal.gradient - to_states(factor.solve(normal.right), normal, nx)).ravel()
    solution, _ = cg(operator, target, rtol=_SOLVER.residual, maxiter=_SOLVER.iterations, M=guide)
    most = _MOST_STEP.copy()
    most[:2] *= linear.pattern.lattice[0]
    step = np.clip(solution.reshape(shape), -most, most)
    return step, factor.solve(normal.right - to_knots(step, normal, nx))
