"""Motion along a pad that no reading shows: of a rod that reaches across it, along itself; of a smooth plate.

Where the border hides a direction from the centre of pressure, see `numerics.cut`, a map alone shows motion along it.
Slopes of a map do not prove that. Those of a plate may be faults of the taxels. Those of a rod are there between the
lines that taxels have passed along, where nothing but smoothness determines the map. So another motion is held, and all
else fitted again, gains of the taxels included. If hardly more is left, the readings do not determine the motion. If
that is so of rest, the map shows nothing of it, and in batches the centre of pressure decides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.hypotheses import coarse, refined
from taxelflow.estimation.template.likelihood import learned_error
from taxelflow.estimation.template.map import covering, fill
from taxelflow.estimation.template.observations import COARSE, FINE
from taxelflow.estimation.template.scaling import SIZE_STD
from taxelflow.estimation.template.solution import ALL_SHOWN, Hidden
from taxelflow.numerics.bspline import STATE, states_of
from taxelflow.numerics.centroid import LOADED, pressure_centre
from taxelflow.numerics.cut import HIDDEN, find_hidden, open_sides
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.observations import Readings, Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Bools, Floats


class _Test(NamedTuple):
    """When a direction is tested, and the other motions that the readings are fitted with."""

    textured: float = 2.0
    """The map has texture along a direction above this many times what faults of the taxels make of its slopes."""
    same: float = 0.87
    """Cosine of directions that are tested as one."""
    changed: float = 2.0
    """Pitches by which the motion is changed: what one taxel reads, its neighbours must read, too."""
    scaled: tuple[float, float] = (0.5, 1.5)
    shortest: float = 0.5
    """Factors of the motion beside rest, if its range exceeds this many pitches: the curvature of a dome's map depends
    on its path."""
    times: float = 1.2
    """Times the error that the motion leaves as it is, which another leaves at least."""
    faults: float = 0.2
    """What faults of taxels beside their gains leave of the largest reading, as a share of `unseen_error`."""


_TEST = _Test()


class _Fits(NamedTuple):
    """Fits with a motion that is held, and the part of the readings that is fitted."""

    gain: float = 4.0
    most_gain: float = 0.5
    """Largest error of a gain, times `unseen_error`, and at all."""
    fewest: int = 4
    converged: float = 0.97
    """Fits at least, and the ratio of the errors of two fits from which more of them lower it no further."""
    rounds: tuple[int, ...] = 3, *(2,) * 11
    """Rounds of fits at most; gains are estimated after each but the first. With single rounds after the first, bars
    and cloth on 4 x 4 taxels converge less: motions count as determined that are not."""
    scans: tuple[int, int] = (16, 24)
    readings: int = 2000
    """Scans, at least and at most, and readings in them, at least: fewer are repeated, else the smoothing of the map
    outweighs them."""
    window: float = 8.0
    apart: float = 2.0
    """Pitches from the middle to the sides of the square of a large pad that is tested, and between the middles of such
    squares. A fit's time grows with the fourth power of the width, so the square lies along the direction."""


_FITS = _Fits()


def hidden_direction(scanned: Scanned, solved: Solved) -> Hidden:
    """The direction along the pad in which no reading shows a motion, and whether rest explains the readings, too."""
    if not scanned.unseen_error or scanned.across.any() or len(scanned) < 2:
        return ALL_SHOWN
    texture, by_faults = _texture(scanned, solved)
    shown = _shown_by_centre(scanned)
    for direction in _directions(texture, shown):
        if direction @ texture @ direction <= _TEST.textured * by_faults:
            return Hidden(direction, direction)
        is_determined, may_rest = _determined(scanned, solved, direction)
        if not is_determined:
            return Hidden(direction, direction * may_rest)
    return ALL_SHOWN


def _directions(texture: Floats, shown: Floats) -> list[Floats]:
    """Unit vectors (2,) that the centre of pressure does not follow: along which the map changes least, and that which
    it follows least. texture, shown: (2, 2).
    """
    least_shown = np.linalg.svd(shown)[2][1]
    least_textured = np.linalg.eigh(texture)[1][:, 0]
    hidden = [d for d in (least_textured, least_shown) if np.linalg.norm(shown @ d) < HIDDEN]
    return hidden[:1] if abs(least_textured @ least_shown) > _TEST.same else hidden


def shown_at_rest(scanned: Scanned) -> bool:
    """Whether one scan of an object shows that it would be seen to move: it is as if it had not moved for some time."""
    if scanned.across.any() or np.linalg.svd(_shown_by_centre(scanned), compute_uv=False)[1] >= HIDDEN:
        return True
    again, _ = _repeated(scanned, np.zeros((1, STATE)))
    states = np.zeros((len(again), STATE))
    states[:, :2], states_of(states).gain[:] = scanned.centroids()[0], 1.0
    return not hidden_direction(again, refined(again, coarse(again, states, turns=False)))


def _shown_by_centre(scanned: Scanned) -> Floats:
    """(2, 2), the matrix by which the centre of pressure follows a motion, mean of the scans; see `numerics.cut`."""
    hidden = np.empty((len(scanned), 4))
    _hidden(scanned.with_error(0.0), scanned.edge, open_sides(scanned.places), hidden)
    load = scanned.load().sum(axis=1)
    mean: Floats = np.eye(2) - np.average(hidden, axis=0, weights=load if load.any() else None).reshape(2, 2)
    return mean


@kernel
def _hidden(scans: Readings, edge: Bools, sides: Floats, out: Floats) -> None:
    """Fill out (scans, 4), see `find_hidden`."""
    middle = np.empty(5)
    for k in range(len(scans.value)):
        reading, variance = scans.value[k], scans.variance[k]
        pressure_centre(reading, variance, scans.places, edge, middle)
        find_hidden(reading, variance, scans.places, sides, middle, out[k])


def _texture(scanned: Scanned, solved: Solved) -> tuple[Floats, float]:
    """(2, 2), the map's squared slopes where scans read it, and what faults of single taxels make of them."""
    some = _spread(len(scanned))
    pressure, slopes = _evaluated(scanned.taken(some), replace(solved, states=solved.states[some]))
    by_faults = 2.0 * scanned.unseen_error**2 * float(np.sum(pressure**2))  # neighbours differ by two faults
    texture: Floats = np.tensordot(slopes, slopes, axes=([0, 1], [0, 1]))
    return texture, by_faults


def _evaluated(scanned: Scanned, solved: Solved) -> tuple[Floats, Floats]:
    """The map where each scan reads it, (scans, taxels), and its slopes (scans, taxels, 2); 0 where it does not."""
    parts = zip(solved.states, scanned.bends, strict=True)
    values = np.stack([solved.pattern.read(scanned.places, state, bend) for state, bend in parts])
    values[(scanned.variance == 0) | np.isnan(values[:, :, 0])] = 0.0
    return np.maximum(values[:, :, 0], 0.0), values[:, :, 1:3]


def _spread(count: int) -> NDArray[np.int64]:
    """Numbers of at most `_FITS.scans[1]` of `count` scans, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, _FITS.scans[1])).round().astype(np.int64))


def _determined(scanned: Scanned, solved: Solved, direction: Floats) -> tuple[bool, bool]:
    """Whether every other motion along a direction leaves clearly more of the scans, and whether rest may explain them:
    it leaves hardly more, or the motion is too short to be compared with it.
    """
    some = _spread(len(scanned))
    scans, states = _repeated(scanned.taken(some), solved.states[some])
    own, at = replace(solved, states=states), states[:, :2] @ direction
    scans = scans.on(_most_textured(scans, own, direction))
    left = min(_left_along(scans, own, direction, at, start) for start in _starts(own))
    ramp, middle = _TEST.changed * np.linspace(-0.5, 0.5, len(scans)), at.mean()

    def explains(other: Floats, most: float) -> bool:
        return any(_left_along(scans, own, direction, other, start, most=most) <= most for start in _starts(own))

    moves = np.ptp(at) > _TEST.shortest
    if moves and explains(np.full_like(at, middle), _TEST.times * left):
        return False, True
    changed = [(other, max(_TEST.times * left, _TEST.faults * scans.unseen_error)) for other in (at + ramp, at - ramp)]
    if moves:
        changed += [(middle + factor * (at - middle), _TEST.times * left) for factor in _TEST.scaled]
    return not any(explains(other, most) for other, most in changed), not moves


def _most_textured(scanned: Scanned, solved: Solved, direction: Floats) -> Bools:
    """(taxels,), those of the square along a direction in which the map's slopes along it are largest."""
    _, slopes = _evaluated(scanned, solved)
    squared, places = np.sum((slopes @ direction) ** 2, axis=0), _frame(direction) @ scanned.places
    middles = _FITS.apart * np.unique((places / _FITS.apart).round(), axis=1)
    within = np.abs(places[:, :, np.newaxis] - middles[:, np.newaxis]).max(axis=0) <= _FITS.window
    most: Bools = within[:, np.argmax(squared @ within)]
    return most


def _frame(direction: Floats) -> Floats:
    """(2, 2), the rotation that makes a direction (2,) the x axis."""
    cos, sin = direction
    return np.array([[cos, sin], [-sin, cos]])


def _starts(solved: Solved) -> tuple[float, float]:
    """Errors from which fits begin: a coarse one finds its way; a fine one keeps what small differences determine."""
    return COARSE, max(solved.error, FINE)


def _repeated(scanned: Scanned, states: Floats) -> tuple[Scanned, Floats]:
    """Scans and their states (scans, 5), each as often, one after the other, as makes them enough."""
    count, taxels = scanned.readings.shape
    times = -(-max(_FITS.scans[0], -(-_FITS.readings // taxels)) // count)
    if times <= 1:
        return scanned, states
    which = np.repeat(np.arange(count), times)
    return replace(scanned.taken(which), t_s=np.arange(float(len(which)))), states[which]


def _left_along(
    scanned: Scanned, solved: Solved, direction: Floats, at: Floats, error: float, *, most: float = 0.0
) -> float:
    """The error that a fit leaves whose places along a direction, (scans,) in pitches, are held.

    Gains of the taxels are free within bounds, as a plate slides over them; so is the size: of a map that tapers,
    motion stands for a contact that widens with its load. most: an error of which only the side matters; the fit ends
    once it is below, or so far above that neither gains nor the rounds left can bring it there.
    """
    turned = _frame(direction)
    along = replace(scanned, places=turned @ scanned.places)
    states = solved.states.copy()
    states[:, :2] = states[:, :2] @ turned.T
    states_of(states).x[:] = at
    pattern = covering(along, states)
    fill(pattern, along.with_error(error), states)
    precision = along.precision(turns=solved.turns, gain_std=solved.gain_std, size=SIZE_STD**-2)
    precision[0] = np.inf
    off, gains = min(_FITS.gain * scanned.unseen_error, _FITS.most_gain), np.ones(scanned.readings.shape[1])
    now = along
    for k, rounds in enumerate(_FITS.rounds):
        before = error
        fit = refine(pattern, now, states, rounds=rounds, error=error, precision=precision)
        error = learned_error(fit, now)
        if error <= most or (k == 0 and error - off * _rms(along) > most > 0.0):
            break
        at_last = error - (before - error) * (len(_FITS.rounds) - 1 - k)  # at the present pace, which slows down
        if k + 1 >= _FITS.fewest and (error > _FITS.converged * before or at_last > most > 0.0):
            break
        if k > 0:
            gains = np.clip(gains * _gains(now, fit), 1.0 - off, 1.0 + off)
            now = along.divided(gains)
    return error


def _rms(scanned: Scanned) -> float:
    """Root mean square of the loaded readings, as a share of the largest."""
    squared = scanned.load() ** 2
    return float(np.sqrt(squared.sum() / max(np.count_nonzero(squared), 1))) / scanned.amplitude


def _gains(scanned: Scanned, fit: Fit) -> Floats:
    """(taxels,), by which the readings of each are larger than the fit's."""
    seen = (fit.weight > 0) & (fit.model > LOADED.skirt * scanned.amplitude)
    model = np.where(seen, fit.model, 0.0)
    squares = np.sum(model**2, axis=0)
    off = np.sum(model * (scanned.readings - fit.model), axis=0) / np.where(squares > 0, squares, 1.0)
    gains: Floats = 1.0 + off
    return gains
