"""The map (pattern): a B-spline surface with the variance of its coefficients, and its information form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.observations import Readings
from taxelflow.messages import Floats
from taxelflow.numerics.banded import WIDTH, Factor, add_diagonal, add_square, smoothness
from taxelflow.numerics.bspline import KNOTS, STATE, add_around, evaluate, in_object, spread, state_of
from taxelflow.runtime.compiling import long_kernel

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned


class _Lattice(NamedTuple):
    """The lattice of a map."""

    spacing: float = 0.5
    """Distance of the knots, in pitches."""
    coarse_spacing: float = 1.0
    coarse_from: int = 1500
    """The same of a map that scans are first registered to, if at the usual distance it has more knots than this: it is
    solved after every third scan, by a factor whose time grows with the fourth power of the width."""
    margin: float = 1.5
    """Pitches around the loaded taxels that a pattern covers."""
    most_knots: int = 40_000
    """Knots of a surface at most: bounds memory and time, also if registration fails."""


LATTICE = _Lattice()
BEYOND = WIDTH - 1
"""Knots beyond that, which the spline needs."""


class _Smoothing(NamedTuple):
    """How the smoothing of a map is learned."""

    roughness: float = 0.12
    """Expected second difference over half a pitch, relative to the largest pressure."""
    most_step: float = 5.0
    """Largest factor by which the smoothing changes in a round."""
    most: float = 1e3
    """Largest smoothing, over that a priori."""
    error: float = 0.02
    """Error, as a share of the largest reading, above which a pattern is at least as smooth as a priori."""


_SMOOTHING = _Smoothing()


class Surface(NamedTuple):
    """A pattern as kernels read it: coefficients c (ny, nx), their variance doubt (ny, nx) or (0, 0), lattice (3,)."""

    c: Floats
    doubt: Floats
    lattice: Floats


@dataclass(slots=True, eq=False)
class Pattern:
    """Coefficients (ny, nx) of a pattern on a lattice, in the object's frame, lengths in pitches.

    lattice: knot spacing, x and y of knot (0, 0). amplitude: largest reading, same unit as the coefficients. doubt:
    (ny, nx) variance of the pattern near each knot. smoothing: weight of the squared second differences.
    """

    lattice: Floats
    coefficients: Floats
    amplitude: float
    doubt: Floats
    smoothing: float

    @classmethod
    def covering(cls, places: Floats, amplitude: float, spacing: float = LATTICE.spacing) -> Pattern:
        """A pattern of zeros over places (n, 2) that the object loads, and a margin around them.

        spacing: distance of the knots, in pitches.
        """
        places = places if len(places) else np.zeros((1, 2))
        low, high = places.min(axis=0) - LATTICE.margin, places.max(axis=0) + LATTICE.margin
        count = np.ceil((high - low) / spacing).astype(int) + 2 * BEYOND + 1
        shape = (int(count[1]), int(count[0]))
        lattice = np.array([spacing, low[0] - BEYOND * spacing, low[1] - BEYOND * spacing])
        pattern = cls(lattice, np.zeros(shape), amplitude, np.full(shape, amplitude**2), 1.0)
        pattern.smoothing = pattern.usual_smoothing
        return pattern

    @property
    def surface(self) -> Surface:
        """The pattern as kernels read it."""
        return Surface(self.coefficients, self.doubt, self.lattice)

    @property
    def usual_smoothing(self) -> float:
        """Smoothing a priori: second differences grow with the square of the distance of the knots."""
        coarser = (self.lattice[0] / LATTICE.spacing) ** 2
        return float((_SMOOTHING.roughness * coarser * self.amplitude) ** -2)

    def learn_smoothing(self, bending: float, error: float) -> None:
        """As much smoothing as the pattern's own bending suggests, its squared second differences, in bounded steps.

        The evidence of the pattern is largest at the number of coefficients that readings determine, over the bending
        (MacKay, 1992): those that only the smoothness determines do not bend. About half count: 17 to 87 % in five
        contacts. At least the usual where the error is large, as the pattern must not explain what poses do not; less
        as it shrinks.
        """
        wanted = 0.5 * self.coefficients.size / max(bending, 1e-300)
        low, high = self.smoothing / _SMOOTHING.most_step, self.smoothing * _SMOOTHING.most_step
        usual = self.usual_smoothing
        least = usual * min(error / _SMOOTHING.error, 1.0) ** 2
        self.smoothing = float(np.clip(np.clip(wanted, low, high), least, usual * _SMOOTHING.most))

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx)."""
        return self.coefficients.shape[0], self.coefficients.shape[1]

    @property
    def knots(self) -> tuple[Floats, Floats]:
        """x (nx,) and y (ny,) of the lattice's knots."""
        h, left, low = self.lattice
        return left + h * np.arange(self.shape[1]), low + h * np.arange(self.shape[0])

    @property
    def prior(self) -> float:
        """Prior information that keeps unobserved coefficients near 0."""
        return 1.0 / (2.0 * self.amplitude) ** 2

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Corners (2,), (2,) of the area on which the pattern is defined for every taxel."""
        h, left, low = self.lattice
        corner = np.array([left, low])
        size = np.array([self.shape[1], self.shape[0]])
        return corner + h, corner + (size - 3) * h

    def read(self, places: Floats, state: Floats, bend: Floats) -> Floats:
        """(taxels, 5), the pattern and its slopes at places (2, taxels) on the pad; see `bspline.evaluate`."""
        values = np.empty((places.shape[1], STATE))
        evaluate(self.coefficients, self.lattice, places, state, bend, values)
        return values

    def centre(self) -> Floats:
        """(2,) where the pattern's pressure is centred."""
        c = np.maximum(self.coefficients, 0.0)
        total = c.sum() or 1.0
        x, y = self.knots
        return np.array([(c.sum(axis=0) @ x) / total, (c.sum(axis=1) @ y) / total])

    def radius(self) -> float:
        """Of gyration, at least half a pitch."""
        c = np.maximum(self.coefficients, 0.0)
        x, y = self.knots
        centre, total = self.centre(), c.sum() or 1.0
        square = (c.sum(axis=0) @ (x - centre[0]) ** 2 + c.sum(axis=1) @ (y - centre[1]) ** 2) / total
        return float(np.sqrt(max(square, 0.25)))


def covering(scanned: Scanned, states: Floats) -> Pattern:
    """A pattern of zeros over all that the scans load at states (scans, 5)."""
    reached = [in_object(scanned.places[:, own].T, state) for own, state in zip(scanned.loaded(), states, strict=True)]
    return Pattern.covering(np.concatenate(reached), scanned.amplitude)


class MapInformation:
    """Normal equations of a pattern whose scans' states are known."""

    def __init__(self, pattern: Pattern) -> None:
        knots = pattern.coefficients.size
        self.stencil = np.zeros((knots, WIDTH, 2 * WIDTH - 1))
        self.right = np.zeros(knots)
        self.support = np.zeros(knots)
        self._smooth = smoothness(pattern.shape)

    def add(self, pattern: Pattern, readings: Readings, states: Floats) -> None:
        """Add scans at states (scans, 5)."""
        add_scans(pattern.surface, readings, states, self.stencil, self.right, self.support)

    def solve(self, pattern: Pattern) -> Factor:
        """Put the best coefficients, and roughly how sure they are, into the pattern."""
        stencil = self.stencil + pattern.smoothing * self._smooth
        add_diagonal(stencil, pattern.prior)
        factor = Factor(stencil, pattern.shape[1])
        pattern.coefficients = factor.solve(self.right).reshape(pattern.shape)
        pattern.doubt = (1.0 / (self.support + pattern.amplitude**-2)).reshape(pattern.shape)
        return factor


def fill(pattern: Pattern, readings: Readings, states: Floats) -> Factor:
    """Make pattern what explains the scans at these states (n, 5) best."""
    information = MapInformation(pattern)
    information.add(pattern, readings, states)
    return information.solve(pattern)


@long_kernel
def add_scans(
    surface: Surface, readings: Readings, states: Floats, stencil: Floats, right: Floats, support: Floats
) -> None:
    """Add scans to stencil (knots, WIDTH, 2 WIDTH - 1), right and support (knots,); see `MapInformation.add`.

    A saturated reading counts as it reads: the pattern is learned from the scans in which the place is not so.
    """
    shape = surface.c.shape
    taxels = readings.places.shape[1]
    first = np.empty(taxels, np.int64)
    weight = np.empty((taxels, KNOTS))
    value = np.empty((taxels, 5))
    for k in range(len(states)):
        spread(shape, surface.lattice, readings.places, states[k], readings.bends[k], first, weight)
        evaluate(surface.c, surface.lattice, readings.places, states[k], readings.bends[k], value)
        gain = state_of(states[k]).gain
        for i in range(taxels):
            variance, reading = readings.variance[k, i], readings.value[k, i]
            if first[i] < 0 or variance == 0.0:
                continue
            if reading >= readings.ceiling[i] and gain * value[i, 0] > reading:
                continue
            w = gain / variance
            add_square(first[i], weight[i], w * gain, reading / gain, shape[1], stencil, right)
            add_around(w * gain, weight[i], first[i], shape[1], support)
