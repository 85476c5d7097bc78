"""Model selection: hypotheses of how an object moves, each fitted from several starts; the likeliest is chosen."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import Fit, refine
from taxelflow.estimation.template.depth import DEPTH_STD, as_heights, take_depth, with_depth
from taxelflow.estimation.template.initialization import FIRST_GAIN_STD, IncrementalMapper, centred, start_scan
from taxelflow.estimation.template.likelihood import FEWEST, cost, learned_error, touched
from taxelflow.estimation.template.map import covering, fill
from taxelflow.estimation.template.observations import COARSE, FINE, REFUTED
from taxelflow.estimation.template.rivals import agreement, any_agrees, apart_by_growth, apart_by_turn, reported
from taxelflow.estimation.template.scaling import SIZE_STD, centre, grown_starts
from taxelflow.estimation.template.solution import Solved, normalize_gains
from taxelflow.estimation.template.turning import (
    UNCONVERGED,
    explains_far_more,
    explains_no_less,
    keeps_its_angle,
    outweighs_faults,
    shows_angle,
    turns_steadily,
    turns_surely,
)
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.robust import CLEARLY

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_FIRST_ROUNDS, _ROUNDS = 4, (3, 3)
"""Rounds of a coarse fit, and of each fit of a refinement. More rounds fit errors of real skins, not the object."""
ENOUGH_SCANS = 8
"""Scans from which the spread of the gains is learned."""
_FAR_WORSE = 20.0
"""Cost per scan above the best beyond which a coarse fit is not refined: about twice the penalty of a free angle."""


def solve(scanned: Scanned, *, sinks: bool = False, known: Floats | None = None) -> Solved:
    """The likeliest of the hypotheses: the object keeps its angle, turns, or stays while its contact grows.

    sinks: whether heights are tried, which may sink in, see `depth`. known: (scans, 5), states of a rigid object that
    were the likeliest of fewer scans. Another start must be clearly better: some scans of an object that looks the same
    after half a turn may converge there.
    """
    turns = [False] if scanned.across.any() else [False, True]
    tried = _coarse_fits(scanned, turns)
    tried += [replace(one.copy(), turns=turn) for one in _grown(scanned, tried[0].states) for turn in turns]
    again = [] if known is None else _from_known(scanned, known, turns)
    kinds = {one.kind for one in again}
    handicaps = [UNCONVERGED * len(scanned) if one.kind in kinds else 0.0 for one in tried] + [0.0] * len(again)
    tried += again
    costs = [cost(one, scanned) + more for one, more in zip(tried, handicaps, strict=True)]
    limit = min(costs) + _FAR_WORSE * len(scanned)
    solved, others = [], []
    for kind in dict.fromkeys(one.kind for one in tried):
        ranked = sorted((price, k) for k, price in enumerate(costs) if tried[k].kind == kind)
        near = [k for price, k in ranked if price <= limit]
        if near:
            solved.append(_cheapest(scanned, [tried[k] for k in near], [handicaps[k] for k in near]))
        else:
            others.append(tried[ranked[0][1]])
    rigid = _rigid(scanned, solved, others)
    return _sunk(scanned, solved, rigid) if sinks else rigid


def _cheapest(scanned: Scanned, starts: list[Solved], handicaps: list[float]) -> Solved:
    """The cheapest of the fits refined from starts, and whether another start agrees with it.

    starts: coarse fits, the cheapest first. handicaps: what is added to the cost of each, see `solve`.
    """
    fits = [refined(scanned, one) for one in (starts if _starts_differ(scanned) else starts[:1])]
    costs = [cost(one, scanned) + more for one, more in zip(fits, handicaps, strict=False)]
    first = costs.index(min(costs))
    others = starts[:first] + starts[first + 1 :]
    if others:
        fits[first].agrees = agreement(fits[first], others[0])
    return fits[first]


def _starts_differ(scanned: Scanned) -> bool:
    """Whether all starts are refined: fits of few scans end in different minima. With an `unseen_error` it does not
    pay: a minimum may be the lowest by what faults of the taxels explain.
    """
    return len(scanned) < ENOUGH_SCANS and not scanned.unseen_error


def _rigid(scanned: Scanned, solved: list[Solved], others: list[Solved]) -> Solved:
    """The likeliest of the refined fits. others: coarse fits that were rejected.

    If all turn and the sensor has faults, the one with a constant angle is refined, too. It is chosen if faults may
    explain the rotation, else it is a rival: a load that friction shifts over a ring looks like a rotation.
    """
    best = likeliest(solved, scanned)
    straight = [one for one in others if one.kind == (False, False) and one.error <= REFUTED]
    if not (scanned.unseen_error and straight and all(one.turns for one in solved)) or keeps_its_angle(best, scanned):
        return best
    held = refined(scanned, straight[0])
    if outweighs_faults(best, held, scanned):
        return _beside(best, [held], scanned)
    return likeliest([*solved, held], scanned)


def _sunk(scanned: Scanned, solved: list[Solved], rigid: Solved) -> Solved:
    """The likeliest of all fits, with patterns of heights, and heights with a depth, where these are far better.

    For this comparison each parameter of a scan is penalised like one of all readings, because depths may fit the noise
    of a short stroke; whether the object turns is then decided by the usual penalty. At a border, a rotation may
    compensate for missing heights. So heights are also fitted from the positions of each fit that turns, with the angle
    held, where these are not those of a fit with a constant angle.
    """
    held = [one for one in solved if one.kind == (False, False)]
    straight = [_straight(scanned, one) for one in solved if one.turns and not any_agrees(one, held, scanned)]
    straight = [one for one in straight if one.error <= REFUTED]
    level = [refined(scanned, one) for one in _as_heights(scanned, [*solved, *straight])]
    deep = _sunk_in(level, scanned)
    clearly = 0.0
    if len(held) < len(solved):  # of more fits, one may be cheaper by chance
        clearly = UNCONVERGED * len(scanned)
        apart = [one for one in deep if not (one.turns or any_agrees(one, level, scanned))]
        level += [refined(scanned, replace(one.copy(), depth=np.zeros(0))) for one in apart]
    prices = [min((cost(one, scanned, strict=True) for one in fits), default=np.inf) for fits in ([rigid], level, deep)]
    if min(prices) >= prices[0] - clearly:
        return rigid
    fits = [*level, *deep] if prices[2] < prices[1] else level
    return likeliest([*solved, *fits], scanned)


def _as_heights(scanned: Scanned, solved: list[Solved]) -> list[Solved]:
    """Initial fits of patterns of heights, from those of pressure."""
    rigid = [one for one in solved if not one.grows] if len(scanned) >= ENOUGH_SCANS else []
    return [replace(one.copy(), pattern=as_heights(one.pattern), heights=True) for one in rigid]


def _sunk_in(level: list[Solved], scanned: Scanned) -> list[Solved]:
    """Fits of heights with a depth of each scan from those without, until one is no better for its depth: then the
    contact does not sink in, whether the object turns or not.
    """
    deep = []
    for one in _minima(level, scanned):
        deep.append(refined(scanned, replace(one.copy(), depth=np.zeros(len(scanned)))))
        if cost(deep[-1], scanned, strict=True) >= cost(one, scanned, strict=True):
            break
    return deep


def _minima(fits: list[Solved], scanned: Scanned) -> list[Solved]:
    """The fits, the cheapest first, without those that have reached the minimum of another one of their hypothesis."""
    kept: list[tuple[float, Solved]] = []
    for price, one in sorted(((cost(one, scanned), one) for one in fits), key=itemgetter(0)):
        if all(other.kind != one.kind or price - least > UNCONVERGED * len(scanned) for least, other in kept):
            kept.append((price, one))
    return [one for _, one in kept]


def _straight(scanned: Scanned, turned: Solved) -> Solved:
    """The coarse fit with a constant angle, from the positions of a fit that turns."""
    states = turned.states.copy()
    states[:, :2] = reported(turned, scanned)
    states_of(states).theta[:] = 0.0
    return coarse(scanned, states, turns=False)


def likeliest(solved: list[Solved], scanned: Scanned) -> Solved:
    """The hypothesis of the lowest cost, with the distance to its rivals.

    One with a free angle is chosen only if its angle is observable: in the pattern of the other, too, if its cost is
    not clearly lower.
    """
    return _beside(_chosen(solved, scanned), solved, scanned)


def _beside(best: Solved, solved: list[Solved], scanned: Scanned) -> Solved:
    """A fit with the distance to its rivals among others that explain nearly as much."""
    near = [one for one in solved if one.error <= CLEARLY * best.error]
    others = [one for one in near if one.turns != best.turns and one.form == best.form]
    if others:
        best = replace(best, rival=apart_by_turn(best, min(others, key=lambda one: one.error)))
    grown = [one for one in near if one.grows != best.grows]
    if grown:
        best = replace(best, growth=apart_by_growth(best, min(grown, key=lambda one: one.error), scanned))
    return best


def _chosen(solved: list[Solved], scanned: Scanned) -> Solved:
    ranked = sorted(solved, key=lambda one: cost(one, scanned))
    best = ranked[0]
    held = [one for one in ranked if not one.turns]
    free = [one for one in ranked if one.turns and one.form == best.form]
    if best.turns and held:
        saved = cost(held[0], scanned) - cost(best, scanned)
        sure = saved > UNCONVERGED * len(scanned) or shows_angle(held[0], best, scanned)
        if not ((sure and turns_surely(best, scanned)) or explains_far_more(best, held[0], scanned)):
            return held[0]
        return replace(best, shown=keeps_its_angle(best, scanned) or outweighs_faults(best, held[0], scanned))
    if best.turns or not free:
        return best
    known = keeps_its_angle(free[0], scanned) and explains_no_less(free[0], best, scanned)
    known = known and shows_angle(best, free[0], scanned)
    return free[0] if known or turns_steadily(free[0], best, scanned) else best


def _coarse_fits(scanned: Scanned, turns: list[bool]) -> list[Solved]:
    """Coarse fits from several starts: states tracked from scan to scan, and with the centroid; of few scans, at a
    steady velocity, too. Where centroids are far worse places than those tracked, as of an object that covers the pad,
    no fit that turns starts from them.
    """
    fits: list[Solved] = []
    for turn in turns:
        mapper = IncrementalMapper(scanned, start_scan(scanned), turns=turn, coarse=True)
        mapper.register_all()
        starts = [mapper.states]
        if not fits or cost(fits[1], scanned) - cost(fits[0], scanned) < _FAR_WORSE * len(scanned):
            starts.append(centred(scanned, mapper.states))
        if _starts_differ(scanned):
            starts.append(mapper.steady())
        fits += [coarse(scanned, states, turns=turn) for states in starts]
    return fits


def _from_known(scanned: Scanned, known: Floats, turns: list[bool]) -> list[Solved]:
    """Coarse fits from states (scans, 5) known before; those that turn do not start a fit with a constant angle."""
    turned = bool(np.ptp(states_of(known).theta) > 0.0)
    return [coarse(scanned, known.copy(), turns=turn) for turn in turns if turn or not turned]


def _grown(scanned: Scanned, rigid: Floats) -> list[Solved]:
    """The coarse fit of an object that stays while its contact grows with the load, where that may be: not if states
    `rigid` (scans, 5) of one that does not grow move far.
    """
    fits = [
        Solved(*start, learned_error(start[2], scanned), FIRST_GAIN_STD, turns=False, grows=True)
        for start in grown_starts(scanned, rigid, start_scan(scanned))
    ]
    return [min(fits, key=lambda one: cost(one, scanned))] if fits else []


def coarse(scanned: Scanned, states: Floats, *, turns: bool, rounds: int = _FIRST_ROUNDS) -> Solved:
    """The fit with the coarse error from given states (scans, 5), which it improves in place."""
    scanned.bend(states)
    pattern = covering(scanned, states)
    fill(pattern, scanned.with_error(COARSE), states)
    precision = scanned.precision(turns=turns, gain_std=FIRST_GAIN_STD)
    fit = refine(pattern, scanned, states, rounds=rounds, error=COARSE, precision=precision)
    return Solved(pattern, states, fit, learned_error(fit, scanned), FIRST_GAIN_STD, turns)


def refined(scanned: Scanned, start: Solved) -> Solved:
    """Refine further from a coarse fit, learning the gains' spread and the error in between.

    A fit may be limited by its smoothing, which grows with the error: an object smaller than a taxel has a sharper
    pattern. So it is also tried with a small error. Up to the coarse error, the sharper fit must leave clearly less and
    have enough readings to show it, because it explains faults of the taxels, too. For the same reason, and for its
    time, it is not tried there if the sensor has an `unseen_error`.
    """
    own = start.copy()
    best = _refined(scanned, start, most_error=np.inf)
    if best.error <= (COARSE if scanned.unseen_error else FINE):
        return best
    sharp = _refined(scanned, own, most_error=FINE)
    tested = np.count_nonzero(touched(scanned)) >= FEWEST * sharp.fit.free
    if best.error <= COARSE and not (tested and CLEARLY * sharp.error <= best.error):
        return best
    sharp.fit = _fit(scanned, sharp, rounds=0, error=sharp.error)  # its information by the error that it leaves
    return min(best, sharp, key=lambda one: cost(one, scanned))


def _fit(scanned: Scanned, start: Solved, *, rounds: int, error: float) -> Fit:
    """`refine` under the hypothesis of a start, which it improves in place."""
    precision = state_precision(start, scanned)
    largest, whole = scanned.amplitude if start.heights else 0.0, with_depth(start.states, start.depth)
    fit = refine(start.pattern, scanned, whole, rounds=rounds, error=error, precision=precision, level=largest)
    take_depth(whole, start.states, start.depth)
    return fit


def state_precision(solved: Solved, scanned: Scanned) -> Floats:
    """(5,), see `Scanned.precision`: the size is free of a contact that grows, or whose heights sink in."""
    size = SIZE_STD**-2 if solved.grows else DEPTH_STD**-2 if solved.sinks else np.inf
    return scanned.precision(turns=solved.turns, gain_std=solved.gain_std, size=size)


def _refined(scanned: Scanned, start: Solved, *, most_error: float) -> Solved:
    """`refined` with the error bounded."""
    own = replace(start, depth=start.depth.copy())
    for most in _ROUNDS:
        learned, error = normalize_gains(own), min(learned_error(own.fit, scanned), most_error)
        own.gain_std = learned if len(scanned) >= ENOUGH_SCANS else own.gain_std
        scanned.bend(own.states)
        own.fit = _fit(scanned, own, rounds=most, error=error)
        if own.grows:
            centre(own.pattern, scanned, own.states)
    own.error = learned_error(own.fit, scanned)
    return own
