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

from taxelflow.messages import Floats
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.robust import CLEARLY
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.slid import SAME, UNKNOWNS, Pair, Skin, room_for, slide
from taxelflow.numerics.sunk_and_tilted import find_centre, freedom, squares_at_rest
from taxelflow.runtime.compiling import kernel

_MOST_TAXELS = 100
"""Taxels that decide, evenly spread over a large contact."""


class Unexplained(NamedTuple):
    """Squares that are left of a pattern: if its object slides; if it rests, on the taxels that were over the pad
    before, and on all of them. x, y: where the slide goes, in pitches. free_slide, free_rest: degrees of freedom of the
    slide, and of rest on all taxels, which fits those in contact. known: share of the taxels that were over the pad.
    gain_errors: squares that errors of the gains leave of a slide.
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
    largest = max(float(before.max()), float(after.max()))
    least = max(LOADED.skirt * largest, SIGNIFICANT * noise)
    loaded = np.flatnonzero((before > least) | (after > least))
    if not len(loaded):
        return Unexplained(0.0, 0.0, 0.0)
    if len(loaded) > _MOST_TAXELS:
        loaded = loaded[np.linspace(0, len(loaded) - 1, _MOST_TAXELS).round().astype(np.int64)]
    pair = Pair(skin.fit @ before, np.zeros(2), after, loaded, least, sinks)
    left = Unexplained(*_compare(skin, pair, before, moved))
    errors = gain_error**2 * float((before[loaded] ** 2 + after[loaded] ** 2).sum())
    return left._replace(gain_errors=errors * left.known)


@kernel
def _compare(
    skin: Skin, pair: Pair, before: Floats, moved: Floats
) -> tuple[float, float, float, float, float, float, float, float]:
    """`compare`, on the chosen taxels."""
    find_centre(skin.places, before, pair.centre)
    best, x, y, inside = np.inf, 0.0, 0.0, np.ones(len(pair.chosen), np.bool_)
    for start in range(2):
        state, fit = np.zeros(3), room_for(len(pair.chosen))
        if start == 0:
            for a in range(3):
                state[a] = moved[a]
        left = slide(skin, pair, state, fit)
        if left < best:
            best, x, y, inside = left, state[0], state[1], fit.inside
    rest, _ = squares_at_rest(skin.places, before, pair.after, pair.chosen[inside], pair.least)
    rest_of_all, free = squares_at_rest(skin.places, before, pair.after, pair.chosen, pair.least)
    known = np.count_nonzero(inside)
    return best, rest, rest_of_all, x, y, freedom(known, UNKNOWNS + pair.sinks), free, known / len(inside)


def covers(before: Floats, after: Floats) -> bool:
    """Whether all taxels (taxels,) are loaded in both patterns: none is at the end of the contact."""
    return bool(np.minimum(before, after).min() > LOADED.skirt * max(before.max(), after.max()))


def comparable(before: Floats, after: Floats) -> bool:
    """Whether half of the load of a pattern (taxels,) is on taxels that were loaded in the one before."""
    load, was = np.maximum(after, 0.0), before > LOADED.skirt * before.max()
    total = float(load.sum())
    return total > 0.0 and float(load[was].sum()) >= SAME * total
