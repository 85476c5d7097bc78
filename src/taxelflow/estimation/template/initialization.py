"""Incremental initialisation: from one scan outwards, each scan of a contact is registered to the pattern so far."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.levenberg_marquardt import HELD, Prior, register
from taxelflow.estimation.template.linearization import pack_scan
from taxelflow.estimation.template.map import BEYOND, LATTICE, MapInformation, Pattern
from taxelflow.estimation.template.observations import COARSE
from taxelflow.numerics.bspline import STATE, in_object, pose_part, state_of, states_of
from taxelflow.numerics.robust import CHEAPER

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats


class _Schedule(NamedTuple):
    """Which scan is the first, when the pattern is solved again, and how a scan is registered to it."""

    loaded: float = 0.5
    """The first scan fitted has at least this share of the largest load."""
    refine_at: tuple[int, int, int, int] = (3, 8, 20, 50)
    """Numbers of scans at which pattern and poses are refined together."""
    refine_rounds: int = 6
    young: int = 10
    solve_every: int = 3
    """The pattern is solved again after every scan up to the first number, then after every `solve_every` scans."""
    huber: float = 6.0
    """Standard deviations above which a reading weighs less."""
    iterations: int = 30
    near_border: float = 0.5
    """Pitches from a loaded taxel to the border of the pattern below which the pattern grows."""


SCHEDULE = _Schedule()
FIRST_GAIN_STD = 0.3
"""Prior standard deviation of the gains in a coarse fit."""


class IncrementalMapper:
    """Incremental estimate of the poses of a contact's scans, and of its pattern.

    precision: (5,), see `Scanned.precision`, of each state, and from scan to scan. coarse: a large map, see `LATTICE`,
    is coarse, as its states are those from which a fit begins.
    """

    def __init__(self, scanned: Scanned, start: int, *, turns: bool, coarse: bool = False) -> None:
        self.scanned, self.start = scanned, start
        self.precision = scanned.precision(turns=turns, gain_std=FIRST_GAIN_STD)
        self._readings = scanned.with_error(COARSE)
        self._error = COARSE * scanned.amplitude
        self._loaded, self._centroid = scanned.loaded(), scanned.centroids()
        self.states = np.zeros((len(scanned), STATE))
        states_of(self.states).gain[:] = 1.0
        self.done = [start]
        self.states[start, :2] = self._centroid[start]
        places = scanned.places[:, self._loaded[start]].T - self._centroid[start]
        self._spacing, self.pattern = LATTICE.spacing, Pattern.covering(places, scanned.amplitude)
        if coarse and self.pattern.coefficients.size > LATTICE.coarse_from:
            self._spacing = LATTICE.coarse_spacing
            self.pattern = Pattern.covering(places, scanned.amplitude, self._spacing)
        self._sum_up()

    def _sum_up(self) -> None:
        """The information of all scans done, and the pattern that it gives."""
        self.information = MapInformation(self.pattern)
        self._add(np.array(self.done))
        self.information.solve(self.pattern)

    def _add(self, which: NDArray[np.int64]) -> None:
        self.information.add(self.pattern, self._readings.taken(which), self.states[which])

    def register_all(self) -> None:
        """Register every scan, forwards from the start, then backwards."""
        for k in [*range(self.start + 1, len(self.scanned)), *range(self.start - 1, -1, -1)]:
            self.register(k)
            self._add_scan(k)

    def steady(self) -> Floats:
        """States (scans, 5) at the velocity between the start and its neighbour of more load, which is known best.

        Where an object slides in over the border, its first scans have hardly any load, and are registered badly.
        """
        own, start, count = self.states.copy(), self.start, len(self.scanned)
        states_of(own).gain[:] = 1.0
        beside = [k for k in (start - 1, start + 1) if 0 <= k < count]
        if beside:
            load = self.scanned.load().sum(axis=1)
            other, t_s = max(beside, key=lambda k: load[k]), self.scanned.t_s
            step = pose_part(self.states[other] - self.states[start]) / (t_s[other] - t_s[start])
            pose_part(own)[:] = pose_part(self.states[start]) + step * (t_s - t_s[start])[:, np.newaxis]
        return own

    def _add_scan(self, k: int) -> None:
        """Add registered scan k to the pattern, which is solved or refined from time to time."""
        self.done.append(k)
        self._cover(k)
        self._add(np.array([k]))
        count = len(self.done)
        if count < SCHEDULE.young or count % max(SCHEDULE.solve_every, count // 10) == 0:
            self.information.solve(self.pattern)
        if count in SCHEDULE.refine_at and count < len(self.scanned):
            self._refine()

    def _refine(self) -> None:
        which = np.array(sorted(self.done))
        states, part = self.states[which], self.scanned.taken(which)
        part.bend(states)
        self.scanned.bends[which] = part.bends
        refine(self.pattern, part, states, rounds=SCHEDULE.refine_rounds, error=COARSE, precision=self.precision)
        self.states[which] = states
        self._sum_up()

    def keep_last(self, k: int, most: int) -> None:
        """Keep only the `most` scans before scan k, and cover what scan k loads if it lies where the last one lies."""
        self.done = list(range(max(self.start, k - most), k))
        reached = [in_object(self.scanned.places[:, self._loaded[j]].T, self.states[j]) for j in self.done]
        if k < len(self.scanned):
            reached.append(in_object(self.scanned.places[:, self._loaded[k]].T, self.states[k - 1]))
        self.pattern = Pattern.covering(np.concatenate(reached), self.scanned.amplitude, self._spacing)
        self._sum_up()

    def register(self, k: int) -> tuple[Floats, float]:
        """Register scan k from several starts; the cheapest wins. Its information (5, 5), chi-square per reading."""
        forward = 1 if k > self.start else -1
        scanned, last = self.scanned, self.states[k - forward]
        starts = np.stack(self._starts(k, forward))
        if np.isinf(state_of(self.precision).theta):
            states_of(starts).theta[:] = 0.0
        prior = Prior(last.copy(), np.minimum(self.precision, HELD))
        taxels = pack_scan(
            scanned.places, scanned.bends[k], scanned.readings[k], scanned.variance[k], scanned.ceiling, self._error
        )
        best, chi_per_reading, kept = np.inf, np.inf, np.zeros((STATE, STATE))
        information = np.zeros((STATE, STATE))
        for state in starts:
            cost, chi, count = register(
                self.pattern.surface, taxels, prior, SCHEDULE.huber, SCHEDULE.iterations, state, information
            )
            if cost < best - CHEAPER:
                best = cost
                self.states[k] = state
                kept, chi_per_reading = information.copy(), chi / max(count, 1)
        return kept, chi_per_reading

    def _starts(self, k: int, forward: int) -> list[Floats]:
        """Initial states (5,): constant velocity, no motion, or the motion of the centroid."""
        scanned, states = self.scanned, self.states
        before, further = k - forward, k - 2 * forward
        last = states[before]
        starts = [last.copy()]
        if (further - self.start) * forward >= 0:
            step, moved = pose_part(last - states[further]), last.copy()
            pose_part(moved)[:] += step
            starts.insert(0, moved)
            if scanned.rolling:
                speed = step / (scanned.t_s[before] - scanned.t_s[further])
                scanned.bends[k] = speed[:, np.newaxis] * scanned.delay_s
        shifted = last.copy()
        shifted[:2] += self._centroid[k] - self._centroid[before]
        return [*starts, shifted]

    def _cover(self, k: int) -> None:
        """Let the pattern grow to where scan k is loaded."""
        places = in_object(self.scanned.places[:, self._loaded[k]].T, self.states[k])
        if not len(places):
            return
        low, high = self.pattern.box
        near = SCHEDULE.near_border
        if (places.min(axis=0) - near >= low).all() and (places.max(axis=0) + near <= high).all():
            return
        covered = np.vstack([low + LATTICE.margin, high - LATTICE.margin, places])
        knots = (np.ptp(covered, axis=0) + 2 * LATTICE.margin) / self._spacing + 2 * BEYOND + 1
        if np.prod(knots) > LATTICE.most_knots:
            return
        smoothing = self.pattern.smoothing
        self.pattern = Pattern.covering(covered, self.scanned.amplitude, self._spacing)
        self.pattern.smoothing = smoothing
        self.done.remove(k)
        self._sum_up()
        self.done.append(k)


def start_scan(scanned: Scanned) -> int:
    """The first scan to fit: well loaded, its contact nearest to the pad's centre."""
    load = scanned.load().sum(axis=1)
    away = np.hypot(*(scanned.centroids() - scanned.middle).T)
    return int(np.argmin(np.where(load >= SCHEDULE.loaded * load.max(), away, np.inf)))


def centred(scanned: Scanned, states: Floats) -> Floats:
    """States (scans, 5) with the object where the contact's centroid is, and its angle kept."""
    own, along = states.copy(), ~scanned.across
    own[:, :2][:, along] = scanned.centroids()[:, along]
    states_of(own).theta[:] = 0.0
    return own
