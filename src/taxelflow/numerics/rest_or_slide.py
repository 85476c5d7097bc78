"""Which explains how a pattern has changed: an object that rests while its load shifts, or one that slides?

A rigid object on an elastic skin presses each taxel in proportion to how deep it lies there. Held at its place, it can
only sink and tilt, which adds a plane to the pressure. Softer skins change in proportion to their pressure, too:

    rest:   y = max(q (g + a . r) + (c + b . r), 0),
    slide:  y = max(g q(R(r - d)) + c, 0),               c = 0 unless it may sink.

q is the pattern before, y the one after, r the place of a taxel. Where q is 0, the object may come down by any part of
what the plane has there: new contact up to it is no contradiction. A slide knows only what was over the pad before.

Errors of the taxels' gains stay with the taxels. At rest they cancel; a slide takes those in q along.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.robust import CLEARLY
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.slid import SAME, UNKNOWNS, Pair, Skin, fit_surface, room_for, slide
from taxelflow.numerics.sunk_and_tilted import find_centre, freedom, squares_at_rest
from taxelflow.runtime.compiling import kernel, lean_kernel, routine
from taxelflow.runtime.settled import Settled

_MOST_TAXELS = 100
"""Taxels that decide, evenly spread over a large contact."""


class Unexplained(NamedTuple):
    """Squares that are left of a pattern: if its object slides; if it rests, on the taxels that were over the pad
    before, and on all of them. x, y: where the slide goes, in pitches. free_slide, free_rest: degrees of freedom of the
    slide, and of rest on all taxels, which fits those in contact. known: share of the taxels that were over the pad.
    gain_errors: squares that errors of the gains leave of a slide. pressed, free_pressed: squares that the pattern
    before leaves with one gain, and their degrees of freedom.
    """

    slide: float
    rest: float
    rest_of_all: float
    x: float = 0.0
    y: float = 0.0
    free_slide: float = 1.0
    free_rest: float = 1.0
    known: float = 1.0
    gain_errors: float = 0.0
    pressed: float = 0.0
    free_pressed: float = 1.0

    def slides(self) -> bool:
        """Whether a slide leaves clearly less than rest where its object was; never where it fits all readings."""
        return self.free_slide >= 1.0 and self.rest > CLEARLY**2 * self.slide

    def shifts(self, noise: float) -> bool:
        """Whether a slide leaves clearly less than the pattern before, pressed harder or less hard at its place.

        noise: as for `compare`.
        """
        slide = CLEARLY**2 * self.slide * self.free_pressed / self.free_slide
        return self.pressed > slide + (SIGNIFICANT * noise) ** 2

    def moves(self, way: Floats) -> bool:
        """Whether a slide leaves no more than rest a degree of freedom, and goes at least half of a way (2,), pitches.

        A change of the load alone is a slide by nothing.
        """
        goes = self.x * way[0] + self.y * way[1] >= 0.5 * (way[0] ** 2 + way[1] ** 2)
        return bool(goes and self.slide / self.free_slide <= self.rest_of_all / self.free_rest)

    def log_ratio(self) -> float:
        """Logarithm of what a slide leaves, beyond errors of the gains, over what rest leaves, roots of squares a
        degree of freedom; NaN where rest fits all readings.
        """
        if self.free_rest < 1.0 or self.slide == 0.0 or self.rest_of_all == 0.0:
            return np.nan
        return 0.5 * float(np.log(self._beyond_gains() * self.free_rest / self.rest_of_all))

    def rests(self) -> bool:
        """Whether rest leaves clearly less than a slide a degree of freedom, beyond errors of the gains; never where it
        fits all readings.
        """
        return self.free_rest >= 1.0 and CLEARLY**2 * self.rest_of_all / self.free_rest <= self._beyond_gains()

    def _beyond_gains(self) -> float:
        """Squares a degree of freedom that a slide leaves beyond errors of the gains.

        These doubt that the object rests; they do not show that it slides, so no less than rest leaves.
        """
        slide, rest = self.slide / self.free_slide, self.rest_of_all / self.free_rest
        return max(slide - self.gain_errors / self.free_slide, min(slide, rest))


def compare(
    skin: Skin,
    before: Floats,
    after: Floats,
    noise: float,
    moved: Floats,
    *,
    sinks: bool = False,
    gain_error: float = 0.0,
) -> Unexplained:
    """What rest and a slide leave of a pattern (taxels,).

    before: (taxels,), the pattern at its place. noise: standard deviation of their difference. moved: (3,), in
    pitches and rad, where the fit of the slide begins, beside the place before. sinks: whether a slide may sink.
    gain_error: standard deviation of the taxels' gains, relative.
    """
    return Unexplained(*_settled_compare(skin, before, after, noise, moved, sinks, gain_error))


@kernel
def _compare(
    skin: Skin, before: Floats, after: Floats, noise: float, moved: Floats, sinks: bool, gain_error: float
) -> tuple[float, float, float, float, float, float, float, float, float, float, float]:
    """The fields of `Unexplained`. Arguments as for `compare`."""
    largest = max(_largest(before), _largest(after))
    least = max(LOADED.skirt * largest, SIGNIFICANT * noise)
    chosen = _deciding(before, after, least)
    if len(chosen) == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0
    pair = Pair(np.empty(len(skin.fit)), np.zeros(2), after, chosen, least, sinks)
    fit_surface(skin, before, pair.surface)
    find_centre(skin.places, before, pair.centre)
    best, x, y, inside = np.inf, 0.0, 0.0, np.ones(len(chosen), np.bool_)
    for start in range(2):
        state, fit = np.zeros(3), room_for(len(chosen))
        if start == 0:
            for a in range(3):
                state[a] = moved[a]
        left = slide(skin, pair, state, fit)
        if left < best:
            best, x, y, inside = left, state[0], state[1], fit.inside
    rest, _ = squares_at_rest(skin.places, before, after, chosen[inside], least)
    rest_of_all, free = squares_at_rest(skin.places, before, after, chosen, least)
    known, power = np.count_nonzero(inside), 0.0
    for i in chosen:
        power += before[i] ** 2 + after[i] ** 2
    share = known / len(chosen)
    errors = gain_error**2 * power * share
    pressed = _pressed(before, after, chosen)
    free_pressed = freedom(len(chosen), 1)
    return best, rest, rest_of_all, x, y, freedom(known, UNKNOWNS + sinks), free, share, errors, pressed, free_pressed


_settled_compare = Settled(_compare)


@lean_kernel
def _pressed(before: Floats, after: Floats, chosen: NDArray[np.int64]) -> float:
    """Squares that one gain leaves of a pattern (taxels,)."""
    own = both = 0.0
    for i in chosen:
        own += before[i] * before[i]
        both += before[i] * after[i]
    gain, left = max(both, 0.0) / max(own, 1e-300), 0.0
    for i in chosen:
        left += (after[i] - gain * before[i]) ** 2
    return left


@lean_kernel
def _largest(pattern: Floats) -> float:
    largest = -np.inf
    for i in range(len(pattern)):
        largest = max(largest, pattern[i])
    return largest


@routine
def _deciding(before: Floats, after: Floats, least: float) -> NDArray[np.int64]:
    """Taxels that are loaded in one of two patterns (taxels,), or as many of them as decide."""
    loaded, count = np.empty(len(before), np.int64), 0
    for i in range(len(before)):
        if before[i] > least or after[i] > least:
            loaded[count] = i
            count += 1
    if count <= _MOST_TAXELS:
        return loaded[:count]
    step = (count - 1) / (_MOST_TAXELS - 1)
    for k in range(_MOST_TAXELS):
        loaded[k] = loaded[int(np.rint(k * step))]
    return loaded[:_MOST_TAXELS]


class Overlap(NamedTuple):
    """Of two patterns. covers: all taxels are loaded in both, so that none is at the end of the contact. comparable:
    half of the load of the one after is on taxels that were loaded before. x, y: way of the centre of pressure.
    """

    covers: bool
    comparable: bool
    x: float
    y: float


def overlap(skin: Skin, before: Floats, after: Floats) -> Overlap:
    """Of patterns (taxels,); the way is in pitches, NaN without load."""
    return Overlap(*_settled_overlap(skin, before, after))


@kernel
def _overlap(skin: Skin, before: Floats, after: Floats) -> tuple[bool, bool, float, float]:
    """The fields of `Overlap`."""
    was, now = _largest(before), _largest(after)
    smallest, held = np.inf, 0.0
    load, x, y, old_load, old_x, old_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(before)):
        smallest = min(smallest, before[i], after[i])
        old, new = max(before[i], 0.0), max(after[i], 0.0)
        held += new if before[i] > LOADED.skirt * was else 0.0
        load, x, y = load + new, x + new * skin.places[0, i], y + new * skin.places[1, i]
        old_load, old_x, old_y = old_load + old, old_x + old * skin.places[0, i], old_y + old * skin.places[1, i]
    covers, comparable = smallest > LOADED.skirt * max(was, now), load > 0.0 and held >= SAME * load
    return covers, comparable, x / load - old_x / old_load, y / load - old_y / old_load


_settled_overlap = Settled(_overlap)
