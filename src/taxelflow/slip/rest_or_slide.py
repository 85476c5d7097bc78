"""Which explains how a pattern has changed: an object that rests while its load shifts, or one that slides?

A rigid object on an elastic skin presses each taxel in proportion to how deep it lies there. Held at its place, it can
only sink and tilt, which adds a plane to the pressure. Softer skins change in proportion to their pressure, too:

    rest:   y = max(q (g + a . r) + (c + b . r), 0),
    slide:  y = g q(R(r - d)),                           not below 0.

q is the pattern before, y the one after, r the place of a taxel. Where q is 0, the object may come down by any part of
what the plane has there: new contact up to it is no contradiction. The slide reads q between its taxels, where the
smoothest surface through them continues it. What was not over the pad before is left out of both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.rounding import SIGNIFICANT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats

_LOADED = 0.03
"""Share of the largest reading below which a taxel may be unloaded: cross-talk and offsets reach that far."""
_HALF = 0.6
"""Pitches to which a taxel reads around its centre, with a tenth to spare."""
_ROUNDS = 8
"""Rounds that find which taxels are in contact, and steps of the fit of a slide."""
_RIDGE = 1e-6
"""Relative stiffness of what readings do not determine, as both modes of an even pressure."""
_ENOUGH = 1e-3
"""Share of the squares that a step must change to be followed by another."""
_DAMPING = 1e-3
"""Of the first step of the fit of a slide, relative to its information."""
_MOST_TAXELS = 100
"""Taxels that decide, evenly spread over a large contact."""


class Skin:
    """The taxels of a pad: the surface through their readings."""

    def __init__(self, places: Floats) -> None:
        """places: (taxels, 2), in pitches."""
        self._places = places
        count, extent = len(places), np.ptp(places, axis=0)
        self._low, self._high = places.min(axis=0) - _HALF, places.max(axis=0) + _HALF
        self._spans = extent > 0.0  # places on a line determine no slope across it
        plane = np.column_stack([np.ones(count), places[:, self._spans]])
        zero = np.zeros((plane.shape[1], plane.shape[1]))
        whole = np.block([[_distances(places, places) ** 3, plane], [plane.T, zero]])
        self._inverse = np.linalg.pinv(whole, hermitian=True)[:, :count]

    def compare(self, before: Floats, after: Floats, noise: float, moved: Floats) -> tuple[float, float]:
        """Norms of what is left of a pattern (taxels,) if its object rests, and if it slides.

        before: (taxels,), the pattern at its place. noise: standard deviation of their difference. moved: (2,), in
        pitches, where the fit of the slide begins, beside the place before.
        """
        largest = max(float(before.max()), float(after.max()))
        least = max(_LOADED * largest, SIGNIFICANT * noise)
        loaded = np.flatnonzero((before > least) | (after > least))
        if len(loaded) > _MOST_TAXELS:
            loaded = loaded[np.linspace(0, len(loaded) - 1, _MOST_TAXELS).round().astype(np.int64)]
        if not len(loaded):
            return 0.0, 0.0
        slide, inside = self._slide(before, after, loaded, moved)
        chosen = loaded[inside]
        return _rest(before[chosen], after[chosen], self._places[chosen], least), slide

    def _slide(self, before: Floats, after: Floats, chosen: NDArray[np.int64], moved: Floats) -> tuple[float, Bools]:
        """What the best slide leaves, and which of the chosen taxels were over the pad before by it."""
        surface = self._inverse @ before
        centre = np.average(self._places, axis=0, weights=np.maximum(before, 0.0) + _RIDGE * before.max())
        best: tuple[float, Bools] = (np.inf, np.ones(len(chosen), dtype=np.bool_))
        for start in ((*moved, 0.0), (0.0, 0.0, 0.0)):
            state, damping = np.array(start), _DAMPING
            left, slopes, inside = self._left(surface, after, chosen, state, centre)
            for _ in range(_ROUNDS):
                information = slopes.T @ slopes
                information[np.diag_indices(3)] *= 1.0 + damping
                information[np.diag_indices(3)] += _RIDGE * np.trace(information) + np.finfo(float).tiny
                trial = state - np.linalg.solve(information, slopes.T @ left)
                found = self._left(surface, after, chosen, trial, centre)
                damping *= 10.0
                gained = left @ left - found[0] @ found[0]
                if gained > 0.0:
                    state, damping, (left, slopes, inside) = trial, damping / 50.0, found
                if abs(gained) < _ENOUGH * (left @ left):
                    break
            own = float(np.linalg.norm(left))
            if own < best[0]:
                best = own, inside
        return best

    def _left(
        self, surface: Floats, after: Floats, chosen: NDArray[np.int64], state: Floats, centre: Floats
    ) -> tuple[Floats, Floats, Bools]:
        """(chosen,) what a slide (x, y, angle) about a centre leaves, its slopes (chosen, 3), and whether a taxel was
        over the pad.
        """
        cos, sin = np.cos(state[2]), np.sin(state[2])
        off = self._places[chosen] - state[:2] - centre
        turned = np.column_stack([cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]])
        where = turned + centre
        inside: Bools = ((where >= self._low) & (where <= self._high)).all(axis=1)
        distance = _distances(where, self._places)
        weights, plane = surface[: len(self._places)], surface[len(self._places) :]
        value = distance**2 * distance @ weights + plane[0] + where[:, self._spans] @ plane[1:]
        slope = 3.0 * ((distance @ weights)[:, np.newaxis] * where - distance @ (weights[:, np.newaxis] * self._places))
        slope[:, self._spans] += plane[1:]
        seen = inside & (value > 0.0)
        model, reading = np.where(seen, value, 0.0), np.where(inside, after[chosen], 0.0)
        slope[~seen] = 0.0
        gain = float(model @ reading) / max(float(model @ model), np.finfo(float).tiny)
        x, y = slope[:, 0], slope[:, 1]
        by_turn = x * turned[:, 1] - y * turned[:, 0]
        slopes = gain * np.column_stack([cos * x - sin * y, sin * x + cos * y, -by_turn])
        # The gain follows each motion: what it explains of the slopes is none of theirs.
        slopes -= np.outer(model, model @ slopes) / max(float(model @ model), np.finfo(float).tiny)
        return reading - gain * model, slopes, inside


def _distances(places: Floats, others: Floats) -> Floats:
    along, across = (np.subtract.outer(places[:, axis], others[:, axis]) for axis in range(2))
    distance: Floats = np.sqrt(along * along + across * across)
    return distance


def _rest(before: Floats, after: Floats, places: Floats, least: float) -> float:
    """Norm of what is left of a pattern (taxels,) if its object has only sunk and tilted."""
    pressed = np.maximum(before, 0.0)
    was = before > least
    if not was.any():
        return float(np.linalg.norm(after))
    off = places - np.average(places, axis=0, weights=pressed)
    plane = np.column_stack([np.ones(len(off)), off / max(float(np.sqrt((off**2).sum(axis=1).mean())), _RIDGE)])
    modes = np.column_stack([pressed[:, np.newaxis] * plane, plane])
    touches, model = was, np.zeros(len(before))
    for _ in range(_ROUNDS):
        used = modes[touches]
        scale = np.linalg.norm(used, axis=0) + np.finfo(float).tiny
        normal = (used / scale).T @ (used / scale) + _RIDGE * np.eye(modes.shape[1])
        model = modes @ (np.linalg.solve(normal, (used / scale).T @ after[touches]) / scale)
        loaded = after > least
        now = np.where(was, (model > 0.0) | loaded, (after > model) & loaded)
        if (now == touches).all() or not now.any():
            break
        touches = now
    model = np.maximum(model, 0.0)
    left = np.where(was, after - model, np.where(after > least, np.maximum(after - model, 0.0), 0.0))
    return float(np.linalg.norm(left))


def covers(before: Floats, after: Floats) -> bool:
    """Whether all taxels (taxels,) are loaded in both patterns: none is at the end of the contact."""
    return bool(np.minimum(before, after).min() > _LOADED * max(before.max(), after.max()))


def shared(before: Floats, after: Floats) -> float:
    """Share of the load of a pattern (taxels,) on taxels that were loaded in the one before."""
    load, was = np.maximum(after, 0.0), before > _LOADED * before.max()
    total = float(load.sum())
    return float(load[was].sum()) / total if total > 0.0 else 0.0
