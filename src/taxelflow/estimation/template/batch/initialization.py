"""First poses of all scans of a contact: from one scan outwards, each registered to the pattern learned so far."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.levenberg_marquardt import HELD, register
from taxelflow.estimation.template.map import Pattern, Sums
from taxelflow.numerics.bspline import GAIN, STATE, THETA, in_object

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_REFINE_AT = (3, 8, 20, 50)
_YOUNG = 10
"""Scans after which a pattern is no longer raw."""
_RAW_ROUGH = 0.1
_HUBER = 6.0
_ITERATIONS = 30
_SOLVE_EVERY = 3
SPACING = 0.5
"""Of the knots, in pitches."""
MARGIN = 1.5
"""Pitches around the loaded taxels that a pattern covers."""
_MOST_KNOTS = 40_000


class Tracker:
    """Scans of a contact on their way to poses."""

    def __init__(self, scanned: Scanned, start: int, *, size: Floats, rough: float, stiffness: Floats) -> None:
        """stiffness: (5,) of each state, as for `refine`, and from scan to scan; infinite where it is fixed."""
        self.scanned, self.start, self.rough, self.stiffness = scanned, start, rough, stiffness
        self._size = size
        self.loaded, self.centroid, self.amplitude = scanned.loaded(), scanned.centroids(), scanned.amplitude
        self.states = np.zeros((len(scanned), STATE))
        self.states[:, GAIN] = 1.0
        self.done = [start]
        self.states[start, :2] = self.centroid[start]
        places = scanned.places[:, self.loaded[start]].T - self.centroid[start]
        if not len(places):
            places = np.zeros((1, 2))
        self.pattern = self._empty(places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN)
        self._sum_up()

    def _empty(self, low: Floats, high: Floats) -> Pattern:
        return Pattern.empty(low, high, SPACING, 1, self._size, self.amplitude)

    def rough_now(self) -> float:
        """Error of the pattern relative to it, as long as it is raw."""
        return max(self.rough, _RAW_ROUGH) if len(self.done) < _YOUNG else self.rough

    def _sum_up(self) -> None:
        """Sums over all scans done, and the pattern they give."""
        self.sums = Sums(self.pattern)
        self._add(np.array(self.done))
        self.sums.solve(self.pattern)

    def _add(self, which: NDArray[np.int64]) -> None:
        self.sums.add(self.pattern, self.scanned.taken(which), self.states[which], self.rough)

    def run(self, most: int | None = None) -> None:
        """Register every scan, or `most` more."""
        for k in self.order()[:most]:
            self.one(k)
            self.learn(k)

    def order(self) -> list[int]:
        """Scans that are left: forwards from the start, then backwards."""
        return [*range(self.start + 1, len(self.scanned)), *range(self.start - 1, -1, -1)][len(self.done) - 1 :]

    def learn(self, k: int) -> None:
        """Learn from scan k where it was registered."""
        self.done.append(k)
        self._cover(k)
        self._add(np.array([k]))
        count = len(self.done)
        if count < _YOUNG or count % max(_SOLVE_EVERY, count // 10) == 0:
            self.sums.solve(self.pattern)
        if count in _REFINE_AT and count < len(self.scanned):
            self._refine()

    def _refine(self) -> None:
        which = np.array(sorted(self.done))
        states = self.states[which]
        self._bend()
        refine(
            self.pattern,
            self.scanned.taken(which),
            states,
            rounds=6,
            rough=self.rough,
            stiffness=self.stiffness,
        )
        self.states[which] = states
        self._sum_up()

    def _bend(self) -> None:
        """Motion while a scan is read, from the poses known so far."""
        which = np.array(sorted(self.done))
        part = self.scanned.taken(which)
        part.bend(self.states[which])
        self.scanned.bends[which] = part.bends

    def forget(self, k: int, most: int) -> None:
        """Keep only the `most` scans before scan k, and cover what scan k loads if it lies where the last one lies."""
        self.done = list(range(max(self.start, k - most), k))
        reached = [in_object(self.scanned.places[:, self.loaded[j]].T, self.states[j]) for j in self.done]
        if k < len(self.scanned):
            reached.append(in_object(self.scanned.places[:, self.loaded[k]].T, self.states[k - 1]))
        places = np.concatenate(reached)
        if len(places):
            self.pattern = self._empty(places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN)
        self._sum_up()

    def one(self, k: int) -> tuple[Floats, float]:
        """Register scan k from several starts; the cheapest wins. Its information (5, 5), chi-square per reading."""
        forward = 1 if k > self.start else -1
        before, further = k - forward, k - 2 * forward
        last = self.states[before]
        starts = [last.copy()]
        if (further - self.start) * forward >= 0:
            moved = last.copy()
            moved[: THETA + 1] += last[: THETA + 1] - self.states[further, : THETA + 1]
            starts.insert(0, moved)
            if self.scanned.rolling:
                speed = (last - self.states[further])[: THETA + 1] / (
                    self.scanned.t_s[before] - self.scanned.t_s[further]
                )
                self.scanned.bends[k] = speed[:, np.newaxis] * self.scanned.delay_s
        shifted = last.copy()
        shifted[:2] += self.centroid[k] - self.centroid[before]
        starts.append(shifted)
        stiffness = np.minimum(self.stiffness, HELD)
        best, misfit, kept = np.inf, np.inf, np.zeros((STATE, STATE))
        scanned, pattern = self.scanned, self.pattern
        information = np.zeros((STATE, STATE))
        for state in starts:
            prior = last.copy()
            if np.isinf(self.stiffness[THETA]):
                state[THETA] = 0.0
            cost, chi, count = register(
                pattern.coefficients,
                pattern.doubt,
                pattern.lattice,
                scanned.places,
                scanned.bends[k],
                scanned.readings[k],
                scanned.variance[k],
                scanned.ceiling,
                self.rough_now(),
                _HUBER,
                prior,
                stiffness,
                _ITERATIONS,
                state,
                information,
            )
            if cost < best - 1e-3:
                best = cost
                self.states[k] = state
                kept, misfit = information.copy(), chi / max(count, 1)
        return kept, misfit

    def _cover(self, k: int) -> None:
        """Let the pattern grow to where scan k is loaded."""
        places = in_object(self.scanned.places[:, self.loaded[k]].T, self.states[k])
        if not len(places):
            return
        low, high = self.pattern.box
        margin = 0.5
        if (places.min(axis=0) - margin >= low).all() and (places.max(axis=0) + margin <= high).all():
            return
        new_low = np.minimum(low, places.min(axis=0) - MARGIN)
        new_high = np.maximum(high, places.max(axis=0) + MARGIN)
        if np.prod((new_high - new_low) / SPACING + 7) > _MOST_KNOTS:
            return
        smoothing = self.pattern.smoothing
        self.pattern = self._empty(new_low, new_high)
        self.pattern.smoothing = smoothing
        self.done.remove(k)
        self._sum_up()
        self.done.append(k)
