"""A pattern: its lattice, its coefficients, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.numerics.banded import Factor, add_square, smoothness
from taxelflow.numerics.bspline import GAIN, evaluate, spread

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_ROUGH_PRIOR = 0.12
"""Expected second difference over half a pitch, relative to the largest pressure."""


@dataclass(slots=True, eq=False)
class Pattern:
    """Coefficients (ny, nx) of a pattern on a lattice, in the object's frame, lengths in pitches.

    lattice: knot spacing, x and y of knot (0, 0). points: (m * m, 2) quadrature over a taxel. amplitude: largest
    reading, same unit as the coefficients. doubt: (ny, nx) variance of the pattern near each knot. smoothing: weight of
    the squared second differences.
    """

    lattice: Floats
    coefficients: Floats
    points: Floats
    amplitude: float
    doubt: Floats
    smoothing: float

    @classmethod
    def empty(
        cls, low: Floats, high: Floats, spacing: float, quadrature: int, size: Floats, amplitude: float
    ) -> Pattern:
        """A pattern of zeros that covers the box from low (2,) to high (2,). size: (2,) of a taxel."""
        reach = 3
        count = np.ceil((high - low) / spacing).astype(int) + 2 * reach + 1
        steps = (np.arange(quadrature) - (quadrature - 1) / 2) / quadrature
        points = np.stack([axis.ravel() for axis in np.meshgrid(steps * size[0], steps * size[1])], axis=1)
        shape = (int(count[1]), int(count[0]))
        pattern = cls(
            lattice=np.array([spacing, low[0] - reach * spacing, low[1] - reach * spacing]),
            coefficients=np.zeros(shape),
            points=points,
            amplitude=amplitude,
            doubt=np.full(shape, amplitude**2),
            smoothing=1.0,
        )
        pattern.smoothing = pattern.usual_smoothing
        return pattern

    @property
    def usual_smoothing(self) -> float:
        """Smoothing before anything is known of the pattern."""
        return float((_ROUGH_PRIOR * self.amplitude * (self.lattice[0] / 0.5) ** 2) ** -2)

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
    def width(self) -> int:
        """How many knots a taxel reaches along each axis."""
        farthest = float(np.hypot(*self.points.T).max())
        return 4 + 2 * int(np.ceil(farthest / self.lattice[0]))

    @property
    def prior(self) -> float:
        """Weight that keeps unseen coefficients near 0."""
        return 1.0 / (2.0 * self.amplitude) ** 2

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Corners (2,), (2,) of the area on which the pattern is defined for every taxel."""
        h, left, low = self.lattice
        margin = (self.width - 4) // 2 + 1
        corner = np.array([left, low])
        size = np.array([self.shape[1], self.shape[0]])
        return corner + margin * h, corner + (size - 2 - margin) * h

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


class Sums:
    """Normal equations of a pattern whose scans' states are known."""

    def __init__(self, pattern: Pattern) -> None:
        knots, width = pattern.coefficients.size, pattern.width
        self.stencil = np.zeros((knots, width, 2 * width - 1))
        self.right = np.zeros(knots)
        self.support = np.zeros(knots)
        self._smooth = smoothness(pattern.shape, width)

    def add(self, pattern: Pattern, scanned: Scanned, states: Floats, rough: float) -> None:
        """Add scans at states (scans, 5). rough: error of the pattern relative to it."""
        add_scans(
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
            pattern.width,
            self.stencil,
            self.right,
            self.support,
        )

    def solve(self, pattern: Pattern) -> Factor:
        """Put the best coefficients, and roughly how sure they are, into the pattern."""
        stencil = self.stencil + pattern.smoothing * self._smooth
        stencil[:, 0, pattern.width - 1] += pattern.prior
        factor = Factor(stencil, pattern.shape[1])
        pattern.coefficients = factor.solve(self.right).reshape(pattern.shape)
        pattern.doubt = (1.0 / (self.support + pattern.amplitude**-2)).reshape(pattern.shape)
        return factor


@kernel
def add_scans(
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
    width: int,
    stencil: Floats,
    right: Floats,
    support: Floats,
) -> None:
    """Add scans to stencil (knots, width, 2 width - 1), right and support (knots,); see `Sums.add`.

    A saturated reading counts as what it says: the pattern is learned from the scans in which the place is not so.
    """
    shape = c.shape
    first = np.empty(places.shape[1], np.int64)
    weight = np.empty((places.shape[1], width * width))
    value = np.empty((places.shape[1], 5))
    for k in range(len(states)):
        spread(shape, lattice, places, states[k], points, bends[k], width, first, weight)
        evaluate(c, lattice, places, states[k], points, bends[k], value)
        gain = states[k, GAIN]
        for i in range(places.shape[1]):
            if first[i] < 0 or variance[k, i] == 0.0:
                continue
            model = gain * value[i, 0]
            reading = readings[k, i]
            if reading >= ceiling[i] and model > reading:
                continue
            level = max(0.0, model, reading)
            w = gain / (variance[k, i] + (rough * level) ** 2)
            add_square(first[i], weight[i], w * gain, reading / gain, shape[1], width, stencil, right)
            for a in range(width):
                for b in range(width):
                    support[first[i] + a * shape[1] + b] += w * gain * weight[i, a * width + b]
