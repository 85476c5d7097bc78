"""Which explains how a pattern has changed: an object that rests while its load shifts, or one that slides?

A rigid object on an elastic skin presses each taxel in proportion to how deep it lies there. Held at its place, it can
only sink and tilt, which adds a plane to the pressure. Softer skins change in proportion to their pressure, too:

    rest:   y = max(q (g + a . r) + (c + b . r), 0),
    slide:  y = max(g q(R(r - d)) + c, 0).

q is the pattern before, y the one after, r the place of a taxel. Where q is 0, the object may come down by any part of
what the plane has there: new contact up to it is no contradiction. Either hypothesis is judged by the mean square that
it leaves, per degree of freedom: rest has six unknowns and fits taxels in contact, a slide has five and fits those that
were over the pad before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.numerics.slid import UNKNOWNS, Pair, Skin, room_for, slide
from taxelflow.numerics.sunk_and_tilted import find_centre, freedom, squares_at_rest
from taxelflow.runtime.compiling import kernel

LOADED = 0.03
"""Share of the largest reading below which a taxel may be unloaded: cross-talk and offsets reach that far."""
SAME = 0.5
"""Share of the load that must be on taxels that were loaded before, for two patterns to be compared."""
_MOST_TAXELS = 100
"""Taxels that decide, evenly spread over a large contact."""


class Unexplained(NamedTuple):
    """What is left of a pattern if its object rests, and if it slides, RMS per degree of freedom; the norm of what rest
    leaves; and where the slide goes, in pitches.
    """

    rest: float
    slide: float
    norm: float
    x: float
    y: float

    def follows(self, moved: Floats) -> bool:
        """Whether the slide goes at least half of a way (2 or 3,): a change of the load alone is a slide by nothing."""
        return bool(self.x * moved[0] + self.y * moved[1] >= 0.5 * (moved[0] ** 2 + moved[1] ** 2))


def compare(skin: Skin, before: Floats, after: Floats, noise: float, moved: Floats) -> Unexplained:
    """What rest and a slide leave of a pattern (taxels,).

    before: (taxels,), the pattern at its place. noise: standard deviation of their difference. moved: (3,), in
    pitches and rad, where the fit of the slide begins, beside the place before.
    """
    largest = max(float(before.max()), float(after.max()))
    least = max(LOADED * largest, SIGNIFICANT * noise)
    loaded = np.flatnonzero((before > least) | (after > least))
    if not len(loaded):
        return Unexplained(0.0, 0.0, 0.0, 0.0, 0.0)
    if len(loaded) > _MOST_TAXELS:
        loaded = loaded[np.linspace(0, len(loaded) - 1, _MOST_TAXELS).round().astype(np.int64)]
    return Unexplained(*_compare(skin, Pair(skin.fit @ before, np.zeros(2), after, loaded, least), before, moved))


@kernel
def _compare(skin: Skin, pair: Pair, before: Floats, moved: Floats) -> tuple[float, float, float, float, float]:
    """`compare`, on the chosen taxels."""
    find_centre(skin.places, before, pair.centre)
    slid, x, y = np.inf, 0.0, 0.0
    for start in range(2):
        state, fit = np.zeros(3), room_for(len(pair.chosen))
        if start == 0:
            state[:] = moved
        left = slide(skin, pair, state, fit)
        mean = left / freedom(np.count_nonzero(fit.inside), UNKNOWNS)
        if mean < slid:
            slid, x, y = mean, state[0], state[1]
    left, free = squares_at_rest(skin.places, before, pair.after, pair.chosen, pair.least)
    return np.sqrt(left / free), np.sqrt(slid), np.sqrt(left), x, y


def covers(before: Floats, after: Floats) -> bool:
    """Whether all taxels (taxels,) are loaded in both patterns: none is at the end of the contact."""
    return bool(np.minimum(before, after).min() > LOADED * max(before.max(), after.max()))


def shared(before: Floats, after: Floats) -> float:
    """Share of the load of a pattern (taxels,) on taxels that were loaded in the one before."""
    load, was = np.maximum(after, 0.0), before > LOADED * before.max()
    total = float(load.sum())
    return float(load[was].sum()) / total if total > 0.0 else 0.0
