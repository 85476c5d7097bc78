"""A pattern in a stream, what goes with it, and how it is fitted to its keyframes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.batch.initialization import MARGIN, SPACING
from taxelflow.estimation.template.batch.model_selection import FIRST_GAIN_STD, FIRST_ROUGH, level, roughness
from taxelflow.estimation.template.bundle_adjustment import Fit, refine
from taxelflow.estimation.template.map import Pattern, Sums
from taxelflow.estimation.template.models.scaling import SIZE_STD
from taxelflow.estimation.template.observations import strength
from taxelflow.numerics.bspline import in_object

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.online.keyframes import Keyframes
    from taxelflow.messages import Floats
    from taxelflow.numerics.banded import Factor

YOUNG = 8
"""With fewer keyframes, gains and roughness are not learned."""
RAW_ROUGH, CHANGING_ROUGH = 0.1, 0.05
"""Error of a pattern relative to it, before anything is known of it, and of one that changes."""
FIRST_SLACK = (0.0025, 0.0025)
"""Before anything is known of how good a pattern is: pitches^2, rad^2."""
MOST_USUAL = 2.0
"""Chi-square per reading up to which scans are explained."""
_NOTHING, _CLEARLY = 10.0, 3.0
"""Scans of less strength may be noise; one that is so many times stronger is not."""
_MATURE, _SETTLED = 10, 0.05
"""Keyframes, and variance in pitches^2, from and up to which a pattern is known well."""


@dataclass(slots=True, eq=False)
class Learned:
    """A pattern and what goes with it.

    keyframes: it was learned from, their states in its frame. usual: chi-square per reading of a scan that fits.
    slack: (2,) how wrong poses on the pattern before have been, variance of x and y (pitches^2) and of theta (rad^2).
    fresh: how many of the last keyframes were registered on the pattern before.
    placed: whether the contact grows with the load about a point that was found; looked: for it, at so many keyframes.
    turned: by how much its theta differs from that of the pattern before.
    gain_std: from scan to scan. turns: whether it may turn; proved: whether its scans are explained by turning, and not
    without; seen: whether the pattern shows a turn; told: whether fits have agreed well enough to tell of it. sight:
    how well, and sight_of_place how well where it is, see `sights`. changing: it does not stay the same, and only the
    last keyframes count.
    """

    pattern: Pattern
    keyframes: Keyframes
    radius: float
    rough: float = RAW_ROUGH
    usual: float = 1.0
    gain_std: float = FIRST_GAIN_STD
    turns: bool = False
    proved: bool = False
    seen: bool = False
    told: bool = False
    changing: bool = False
    sight: float = 2.0
    sight_of_place: float = np.inf
    turned: float = 0.0
    slack: Floats = field(default_factory=lambda: np.array(FIRST_SLACK))
    fresh: int = 0
    placed: bool = False
    looked: int = 0

    @property
    def mature(self) -> bool:
        """Whether the pattern is known well enough to look for it elsewhere."""
        known = len(self.keyframes) >= _MATURE and self.slack[0] < _SETTLED
        return not self.changing and known and self.rough <= CHANGING_ROUGH

    def is_noise_beside(self, reading: Floats, variance: Floats) -> bool:
        """Whether it was learned from hardly more than noise, and a scan (taxels,) is clearly more."""
        before = strength(self.keyframes.scanned.readings, variance).max()  # noise may have been known badly then
        now = strength(reading, variance)
        return bool(before < min(_NOTHING, now / _CLEARLY))


def covering(scanned: Scanned, states: Floats, known: Pattern | None) -> Pattern:
    """A pattern of zeros over all that the scans load, on the lattice of the known one."""
    loaded = scanned.loaded()
    reached = np.concatenate([in_object(scanned.places[:, own].T, at) for own, at in zip(loaded, states, strict=True)])
    reached = reached if len(reached) else np.zeros((1, 2))
    low, high = reached.min(axis=0) - MARGIN, reached.max(axis=0) + MARGIN
    pattern = Pattern.empty(low, high, SPACING, 1, np.ones(2), scanned.amplitude)
    if known is not None:
        pattern.smoothing = known.smoothing * (known.amplitude / pattern.amplitude) ** 2
    return pattern


def fill(pattern: Pattern, scanned: Scanned, states: Floats, rough: float = FIRST_ROUGH) -> Factor:
    """Make pattern what explains the scans at these states (n, 5) best."""
    sums = Sums(pattern)
    sums.add(pattern, scanned, states, rough)
    return sums.solve(pattern)


def refined(new: Learned, pattern: Pattern, scanned: Scanned, states: Floats) -> Fit:
    """Refine pattern and states (n, 5) jointly, in place; what that says of gains and roughness goes into `new`."""
    young = len(states) < YOUNG
    gain_std = FIRST_GAIN_STD if young else new.gain_std
    size = SIZE_STD**-2 if new.placed else np.inf
    stiffness = scanned.stiffness(turns=new.turns, gain_std=gain_std, size=size)
    rounds, rough = (6, FIRST_ROUGH) if young else (3, min(new.rough, FIRST_ROUGH))
    fit = refine(pattern, scanned, states, rounds=rounds, rough=rough, stiffness=stiffness)
    if not young:
        new.gain_std = level(pattern, states, fit)
        new.rough = max(roughness(fit, scanned), FIRST_ROUGH * np.sqrt(YOUNG / len(states)))
    return fit


def usual_of(fit: Fit) -> float:
    """Chi-square per reading of a scan that fits."""
    return float(np.clip(fit.reduced / fit.freedom, 1.0, MOST_USUAL))
