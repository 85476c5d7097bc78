"""The gauge of an adjusted map: which point of the object is reported, which readings do not determine.

First the map is shifted into the frame of the map before (`align_gauge`). Keyframes move when they are adjusted, and no
choice of the reported point puts all of them where they were reported. So of a map that turns it is then put where it
was on average (`hold`), over the time that each keyframe stands for; those reported with a large variance count less.
What is reported next has the error of the map now, not the sum of those of all before: how far keyframes were reported
apart, beyond the variance that each was reported with.

A map without rotation keeps its frame on the centre of pressure, see `witness`: a turn would mislead this mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from taxelflow.estimation.template.online.track_state import KEYFRAMES
from taxelflow.estimation.template.online.witness import reported_places
from taxelflow.estimation.template.pose_output import arm_of
from taxelflow.estimation.template.solution import shown_centre
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import state_of, states_of
from taxelflow.numerics.geometry import turned
from taxelflow.numerics.records import Records, records
from taxelflow.numerics.rounding import BLURRED, LINEAR_RAD

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.online.keyframes import Keyframes
    from taxelflow.estimation.template.online.local_map import LocalMap
    from taxelflow.estimation.template.online.track_state import Track
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools


def turn_of_frame(before: Floats, best: Solved, known: LocalMap, *, newest: int) -> tuple[float, Bools]:
    """By how much theta of a solved contact differs from that before (n, 5), the median, and over which (n,) keyframes.

    An object that looks the same at several angles may be found at another of them in the keyframes of one contact
    only. The frame follows the newest keyframe that fits; keyframes that have turned otherwise do not count. newest:
    its number.
    """
    counts = np.ones(len(before), np.bool_)
    apart = states_of(best.states).theta - states_of(before).theta
    if not best.turns:
        return 0.0, counts
    if not known.turns:
        return float(np.median(apart[: KEYFRAMES.same])), counts  # later ones had turned before it was noticed
    counts = np.abs(apart - apart[newest]) < LINEAR_RAD
    return float(np.median(apart[counts])), counts


def align_gauge(
    before: Floats, best: Solved, scanned: Scanned, turn: float, alike: Bools
) -> tuple[Floats, Floats, Floats]:
    """States (n, 5) of a solved contact in the frame of those before (n, 5), the origin (2,) of a frame that grows, and
    how far the states are from those before (n, 5), x and y at the centre of pressure.

    turn, alike: see `turn_of_frame`.
    """
    away = np.array([0.0, 0.0, turn, 0.0, 0.0])
    if best.grows:
        origin = np.median(before[:, :2] - best.states[:, :2], axis=0)
        off = best.states - before - away
        return best.states, origin, off - np.median(off, axis=0)
    shown = shown_centre(scanned, before)
    middle = np.zeros(2) if shown is None else shown
    arms = arm_of(middle, best.states - away) - arm_of(middle, before)
    states = _fix_gauge(best.states, before[:, :2] - arms, best, alike)
    off = states - before - away
    off[:, :2] += arms
    return states, np.zeros(2), off


def _fix_gauge(states: Floats, before: Floats, best: Solved, alike: Bools) -> Floats:
    """States (n, 5) with the object's frame shifted, and the pattern with it, so that most are where they were, (n, 2).

    It is the median of those that are alike (n,) that stays, weighted by the inverse variance: some may have been wrong
    before. Only the origin moves: a turned lattice would have to be learned again.
    """
    covariance, pattern = best.fit.covariance, best.pattern
    weight = alike / (covariance[:, 0, 0] + covariance[:, 1, 1])
    theta = states_of(states).theta
    gap = turned(before - states[:, :2], -theta)
    body = np.array([_weighted_median(along, weight) for along in gap.T])
    moved = states.copy()
    moved[:, :2] += turned(body, theta)
    pattern.lattice = pattern.lattice - np.array([0.0, *body])
    return moved


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(reached, 0.5 * reached[-1])]])


class _Place:
    """Where a scan was reported, (2,) in pitches, with the variance of x and y together, and how long it stands for."""

    t_s: float
    place: Annotated[Floats, 2]
    variance: float
    span_s: float


class Reported:
    """Where the keyframes of one contact were reported. At 1 kHz hundreds wait to be learned from."""

    def __init__(self) -> None:
        self._room = records(_Place, 64)
        self._count = 0

    @property
    def places(self) -> Records:
        """(n,), oldest first."""
        return self._room[: self._count]

    def add(self, t_s: float, place: Floats, variance: float) -> None:
        """A scan at a place (2,), in pitches, with the variance of x and y together, later than those before.

        It stands for the time until the next.
        """
        count = self._count
        if count == len(self._room):
            self._room = np.concatenate([self._room, records(_Place, count)])
        if count:
            last = self._room[count - 1]
            last["span_s"] = last["span_s"] + t_s - last["t_s"]
        self._room[count] = t_s, place, variance, 0.0
        self._count += 1

    def clear(self) -> None:
        """Begin again: a contact, or a place that no motion led to."""
        self._count = 0

    def thin(self, t_s: Floats) -> None:
        """Keep those that are among the keyframes at t_s (n,), and later ones.

        Others leave the time that they stand for to the nearest.
        """
        places, times = self.places, self.places["t_s"]
        kept = (t_s[_numbers(t_s, times)] == times) | (times > t_s[-1])
        if not kept.any():
            return
        left, gone = places[kept], places[~kept]
        after = np.minimum(np.searchsorted(left["t_s"], gone["t_s"]), len(left) - 1)
        before = np.maximum(after - 1, 0)
        is_before = gone["t_s"] - left["t_s"][before] <= left["t_s"][after] - gone["t_s"]
        np.add.at(left["span_s"], np.where(is_before, before, after), gone["span_s"])
        self._room[: len(left)], self._count = left, len(left)

    def off(self, m: Track, keyframes: Keyframes) -> tuple[Floats, float] | None:
        """(2,), mean of how far keyframes were reported from where the map has them, at angle 0, and by how much its
        variance exceeds that reported, along x and y, mean; None if none was reported.
        """
        places, times = self.places, keyframes.scanned.t_s
        number = _numbers(times, places["t_s"])
        known = np.flatnonzero(times[number] == places["t_s"])
        if not len(known):
            return None
        found, spans = places[known], places["span_s"][known]
        spans[-1] += m.last_t - found["t_s"][-1] if known[-1] == self._count - 1 else 0.0
        weights = spans / (2.0 * BLURRED**2 + found["variance"])  # places that are not blurred count nearly alike
        states = keyframes.states[number[known]]
        angles = states_of(states).theta - m.theta_0
        gaps = turned(found["place"] - reported_places(m, states), -angles)
        shares = weights if weights.sum() > 0.0 else None
        mean: Floats = np.average(gaps, axis=0, weights=shares)
        excess = float(np.average(np.sum((gaps - mean) ** 2, axis=1) - found["variance"], weights=shares))
        return mean, 0.5 * max(excess, 0.0)


def _numbers(times: Floats, t_s: Floats) -> NDArray[np.int64]:
    """(n,), of those times, in order, that t_s (n,) equal if any does."""
    return np.minimum(np.searchsorted(times, t_s), len(times) - 1)


def has_own_frame(m: Track) -> bool:
    """Whether an object was known before this contact: its frame is that of before, and is not held."""
    return bool(np.isinf(m.arm_load))


def hold(m: Track, learned: LocalMap, reported: Reported, pitch_m: float) -> None:
    """Put the reported point of an object that turns where its keyframes were reported on average.

    An object that was known before, or that is seen along a line only, keeps its point, as one that grows does; so does
    one that changes: its few keyframes are where they were tracked, and what was reported of them holds this shift.
    """
    reported.thin(learned.keyframes.scanned.t_s)
    found = reported.off(m, learned.keyframes)
    if found is None or has_own_frame(m):
        return
    off, m.wander = found
    if not learned.turns or learned.grows or learned.changing or np.any(m.across > 0.0):
        m.wander += 0.5 * float(off @ off)
        return
    m.gauge[:] += off
    m.before_centre[:2] += pitch_m * turned(off, float(state_of(m.state).theta) - m.theta_0)
