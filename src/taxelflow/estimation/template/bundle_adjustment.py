"""Pattern and poses together: maximum likelihood over all scans of a contact.

Gauss-Newton; the coefficients' block of the normal matrix is banded and factored, and the poses' Schur complement
solved by conjugate gradients, so that time and memory grow linearly with the number of scans.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from taxelflow.compiling import kernel
from taxelflow.numerics.banded import Factor, add_square, multiply, smoothness
from taxelflow.numerics.bspline import GAIN, SIZE, STATE, THETA, evaluate, spread
from taxelflow.numerics.robust import OUTLIER

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Bools, Floats

_HUBER = 4.0
_MOST_STEP = np.array([1.0, 1.0, 0.15, 0.2, 0.05])
"""Largest step of a state in one round; the first two in knots."""
_SETTLED = 0.05
"""Steps of a pose, in its standard deviations, below which nothing more is gained."""
_MOST_SMOOTHING_STEP = 5.0
_SMOOTHINGS = 1e3
"""Smoothing stays within this factor of the usual."""
_MOST_CG, _CG_ERROR = 60, 1e-2
_GAINS, _SIZES = (0.02, 50.0), (-0.7, 0.7)
_WORSE = 1.1
"""A round that makes the fit so many times worse is taken back."""
_PROBES = 16
_RIDGE = 1e-12
"""Of what a scan tells most of, for a scan of one taxel tells nothing of the rest."""


@dataclass(slots=True, eq=False)
class Fit:
    """What a joint refinement leaves behind.

    chi, counts: (scans,), robust chi-square and the readings in it. residual, weight, model: (scans, taxels).
    information: (scans, 5, 5) of the states with the pattern held. factor: of the coefficients' block. free: how many
    parameters the readings determine, states and coefficients. bending: the pattern's squared second differences.
    """

    chi: Floats
    counts: NDArray[np.int64]
    residual: Floats
    weight: Floats
    model: Floats
    information: Floats
    factor: Factor
    free: float
    bending: float

    @property
    def reduced(self) -> float:
        """Chi-square per reading."""
        return float(self.chi.sum() / max(self.counts.sum(), 1))

    @property
    def freedom(self) -> float:
        """Share of the readings that is left to check the fit by."""
        count = max(int(self.counts.sum()), 1)
        return max(1.0 - self.free / count, 0.1)


class _Linear:
    """The problem, linearised at the present pattern and states; arrays as `assemble` fills them."""

    def __init__(self, pattern: Pattern, scanned: Scanned, fixed: Bools) -> None:
        self.pattern, self.scanned, self.fixed = pattern, scanned, fixed
        scans, taxels, width = len(scanned), scanned.places.shape[1], pattern.width
        self.first = np.empty((scans, taxels), np.int64)
        self.weight = np.empty((scans, taxels, width * width))
        self.slope = np.empty((scans, taxels, STATE))
        self.w, self.residual, self.model = (np.empty((scans, taxels)) for _ in range(3))
        self.chi, self.counts = np.empty(scans), np.empty(scans, np.int64)
        self.smooth = smoothness(pattern.shape, width)
        self.bent = np.empty(pattern.coefficients.size)

    def update(self, states: Floats, rough: float) -> None:
        """Fill all arrays."""
        pattern, scanned = self.pattern, self.scanned
        knots, width = pattern.coefficients.size, pattern.width
        self.stencil, self.right = np.zeros((knots, width, 2 * width - 1)), np.zeros(knots)
        self.blocks, self.gradient = np.zeros((len(states), STATE, STATE)), np.zeros((len(states), STATE))
        assemble(
            pattern.coefficients,
            pattern.lattice,
            scanned.places,
            states,
            pattern.points,
            scanned.bends,
            scanned.readings,
            scanned.variance,
            scanned.ceiling,
            rough,
            _HUBER,
            self.fixed,
            self.first,
            self.weight,
            self.slope,
            self.w,
            self.residual,
            self.model,
            self.stencil,
            self.right,
            self.blocks,
            self.gradient,
            self.chi,
            self.counts,
        )
        multiply(self.smooth, pattern.shape[1], pattern.coefficients.ravel(), self.bent)

    def bending(self) -> float:
        """Sum of squared second differences of the pattern."""
        return float(self.pattern.coefficients.ravel() @ self.bent)

    def regularise(self) -> None:
        """Add the pattern's priors to its equations."""
        pattern = self.pattern
        self.stencil += pattern.smoothing * self.smooth
        self.stencil[:, 0, pattern.width - 1] += pattern.prior
        self.right -= pattern.smoothing * self.bent + pattern.prior * pattern.coefficients.ravel()

    def determined(self, factor: Factor) -> float:
        """How many coefficients the readings determine: those whose priors do not, a trace, from random vectors."""
        pattern, knots = self.pattern, len(self.right)
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (_PROBES, knots))
        held = np.empty(knots)
        total = 0.0
        for sign, back in zip(signs, factor.solve(signs.T).T, strict=True):
            multiply(self.smooth, pattern.shape[1], sign, held)
            total += knots - float(back @ (pattern.smoothing * held + pattern.prior * sign))
        return total / _PROBES

    def to_knots(self, step: Floats) -> Floats:
        """(knots,), what steps of the states (scans, 5) do to the coefficients' equations."""
        out = np.zeros(len(self.right))
        to_knots(step, self.first, self.weight, self.slope, self.w, self.pattern.shape[1], out)
        return out

    def to_states(self, knots: Floats) -> Floats:
        """(scans, 5), what steps of the coefficients (knots,) do to the states' equations."""
        out = np.zeros(self.gradient.shape)
        to_states(knots, self.first, self.weight, self.slope, self.w, self.pattern.shape[1], out)
        return out


@dataclass(slots=True, eq=False)
class _Best:
    merit: float
    states: Floats
    coefficients: Floats
    smoothing: float

    def restore(self, pattern: Pattern, states: Floats) -> None:
        states[:], pattern.coefficients, pattern.smoothing = self.states, self.coefficients, self.smoothing


def refine(pattern: Pattern, scanned: Scanned, states: Floats, *, rounds: int, rough: float, stiffness: Floats) -> Fit:
    """Improve the pattern and the states (scans, 5), in place; the pattern's smoothing is learned on the way.

    stiffness: (5,) 1 / variance of each state around 0, of a place around the pad's middle, of the gain around 1;
    infinite where a state is not to move.
    The object's frame, which nothing determines, is that in which the mean of the poses stays.
    """
    fixed, usual = np.isinf(stiffness), np.array([*scanned.middle, 0.0, 1.0, 0.0])
    pull = np.where(fixed, 0.0, stiffness)
    linear = _Linear(pattern, scanned, fixed)
    best, damping = _Best(np.inf, states, pattern.coefficients, pattern.smoothing), 0.0
    diagonal, moved = np.arange(STATE), np.arange(THETA + 1)
    for round_ in range(rounds + 1):
        linear.update(states, rough)
        merit = float(linear.chi.sum() + (pull * (states - usual) ** 2).sum() + pattern.smoothing * linear.bending())
        if merit > _WORSE * best.merit:
            best.restore(pattern, states)
            linear.update(states, rough)
            damping = max(10.0 * damping, 0.1)
        elif merit < best.merit:
            best = _Best(merit, states.copy(), pattern.coefficients, pattern.smoothing)
        if round_:
            _learn_smoothing(pattern, linear.bending())
        linear.regularise()
        linear.gradient -= pull * (states - usual)
        linear.gradient[:, fixed] = 0.0
        strong = linear.blocks[:, diagonal, diagonal].max(axis=1, keepdims=True)
        linear.blocks[:, diagonal, diagonal] += np.where(fixed, 1.0, pull) + 1e-9 + _RIDGE * strong
        factor = Factor(linear.stencil, pattern.shape[1])
        if round_ == rounds:
            break
        step, back = _solve(factor, linear, damping)
        states += step
        states[:, GAIN] = np.clip(states[:, GAIN], *_GAINS)
        states[:, SIZE] = np.clip(states[:, SIZE], *_SIZES)
        pattern.coefficients = pattern.coefficients + back.reshape(pattern.shape)
        relative = step[:, : THETA + 1] - step[:, : THETA + 1].mean(axis=0)
        moves = relative**2 * linear.blocks[:, moved, moved]
        if np.sqrt(moves.mean(axis=0).max()) < _SETTLED:
            break
    free = linear.determined(factor) + len(states) * int(np.sum(~fixed))
    return Fit(
        chi=linear.chi,
        counts=linear.counts,
        residual=linear.residual,
        weight=linear.w,
        model=linear.model,
        information=linear.blocks,
        factor=factor,
        free=free,
        bending=linear.bending(),
    )


def _learn_smoothing(pattern: Pattern, bending: float) -> None:
    """As much smoothing as the pattern's own bending suggests, in bounded steps."""
    wanted = 0.5 * pattern.coefficients.size / max(bending, 1e-300)
    low, high = pattern.smoothing / _MOST_SMOOTHING_STEP, pattern.smoothing * _MOST_SMOOTHING_STEP
    usual = pattern.usual_smoothing
    pattern.smoothing = float(np.clip(np.clip(wanted, low, high), usual / _SMOOTHINGS, usual * _SMOOTHINGS))


def _solve(factor: Factor, linear: _Linear, damping: float) -> tuple[Floats, Floats]:
    """Steps of the states (scans, 5), none longer than allowed, and of the coefficients (knots,) that go with them."""
    blocks = linear.blocks.copy()
    diagonal, moved = np.arange(STATE), np.arange(THETA + 1)
    blocks[:, diagonal, diagonal] *= 1.0 + damping
    inverse = np.linalg.inv(blocks)
    frame = blocks[:, moved, moved].mean(axis=0)  # holds the mean step at 0, which pattern and poses leave open
    shape = linear.gradient.shape

    def reduced(vector: Floats) -> Floats:
        step = vector.reshape(shape)
        result = np.einsum("kab,kb->ka", blocks, step) - linear.to_states(factor.solve(linear.to_knots(step)))
        result[:, : THETA + 1] += frame * step[:, : THETA + 1].mean(axis=0)
        flat: Floats = result.ravel()
        return flat

    def precondition(vector: Floats) -> Floats:
        result: Floats = np.einsum("kab,kb->ka", inverse, vector.reshape(shape)).ravel()
        return result

    size = linear.gradient.size
    operator = LinearOperator((size, size), matvec=reduced, dtype=np.float64)
    guide = LinearOperator((size, size), matvec=precondition, dtype=np.float64)
    target = (linear.gradient - linear.to_states(factor.solve(linear.right))).ravel()
    solution, _ = cg(operator, target, rtol=_CG_ERROR, maxiter=_MOST_CG, M=guide)
    most = _MOST_STEP.copy()
    most[:2] *= linear.pattern.lattice[0]
    step = np.clip(solution.reshape(shape), -most, most)
    return step, factor.solve(linear.right - linear.to_knots(step))


@kernel
def assemble(
    c: Floats,
    lattice: Floats,
    places: Floats,
    states: Floats,
    points: Floats,
    bends: Floats,
    readings: Floats,
    variance: Floats,
    ceiling: Floats,
    rough: float,
    huber: float,
    fixed: Bools,
    first: NDArray[np.int64],
    weight: Floats,
    slope: Floats,
    w: Floats,
    residual: Floats,
    model: Floats,
    stencil: Floats,
    right: Floats,
    blocks: Floats,
    gradient: Floats,
    chi: Floats,
    counts: NDArray[np.int64],
) -> None:
    """Fill the linearised problem: per reading its knots, weights, slopes by the state, w; and the sums of the blocks.

    weight (scans, taxels, width^2) is by coefficient, slope (scans, taxels, 5) by state, both with the gain in.
    """
    shape = c.shape
    width = int(np.sqrt(weight.shape[2]))
    value = np.empty((places.shape[1], 5))
    for k in range(len(states)):
        spread(shape, lattice, places, states[k], points, bends[k], width, first[k], weight[k])
        evaluate(c, lattice, places, states[k], points, bends[k], value)
        gain = states[k, GAIN]
        chi[k] = 0.0
        counts[k] = 0
        for i in range(places.shape[1]):
            w[k, i] = 0.0
            residual[k, i] = 0.0
            model[k, i] = 0.0
            if first[k, i] < 0 or variance[k, i] == 0.0 or np.isnan(value[i, 0]):
                continue
            expected = gain * value[i, 0]
            difference = readings[k, i] - expected
            model[k, i] = expected
            residual[k, i] = difference
            if readings[k, i] == 0.0 and expected <= 0.0:  # the sensor clips there
                continue
            if readings[k, i] >= ceiling[i] and difference < 0.0:
                continue
            own = rough * max(expected, 0.0)
            factor = 1.0 / (variance[k, i] + own * own)
            z = abs(difference) * np.sqrt(factor)
            chi[k] += min(z * z, OUTLIER)
            counts[k] += 1
            if z > huber:
                factor *= huber / z
            w[k, i] = factor
            slope[k, i, 0] = gain * value[i, 1]
            slope[k, i, 1] = gain * value[i, 2]
            slope[k, i, 2] = gain * value[i, 3]
            slope[k, i, 3] = value[i, 0]
            slope[k, i, 4] = gain * value[i, 4]
            for a in range(5):
                if fixed[a]:
                    slope[k, i, a] = 0.0
            for a in range(width * width):
                weight[k, i, a] *= gain
            add_square(first[k, i], weight[k, i], factor, difference, shape[1], width, stencil, right)
            for a in range(5):
                gradient[k, a] += factor * slope[k, i, a] * difference
                for b in range(5):
                    blocks[k, a, b] += factor * slope[k, i, a] * slope[k, i, b]


@kernel
def to_knots(
    step: Floats, first: NDArray[np.int64], weight: Floats, slope: Floats, w: Floats, nx: int, out: Floats
) -> None:
    """Add to out (knots,) what steps of the states (scans, 5) do to the coefficients' equations."""
    width = int(np.sqrt(weight.shape[2]))
    for k in range(first.shape[0]):
        for i in range(first.shape[1]):
            if w[k, i] == 0.0:
                continue
            pull = 0.0
            for a in range(5):
                pull += slope[k, i, a] * step[k, a]
            pull *= w[k, i]
            for a in range(width):
                for b in range(width):
                    out[first[k, i] + a * nx + b] += pull * weight[k, i, a * width + b]


@kernel
def to_states(
    knots: Floats, first: NDArray[np.int64], weight: Floats, slope: Floats, w: Floats, nx: int, out: Floats
) -> None:
    """Add to out (scans, 5) what steps of the coefficients (knots,) do to the states' equations."""
    width = int(np.sqrt(weight.shape[2]))
    for k in range(first.shape[0]):
        for i in range(first.shape[1]):
            if w[k, i] == 0.0:
                continue
            pull = 0.0
            for a in range(width):
                for b in range(width):
                    pull += knots[first[k, i] + a * nx + b] * weight[k, i, a * width + b]
            pull *= w[k, i]
            for a in range(5):
                out[k, a] += pull * slope[k, i, a]
