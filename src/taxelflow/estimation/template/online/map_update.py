"""Map update of a stream: bundle adjustment of the keyframes, and the hypotheses of a batch."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.bundle_adjustment import linearised
from taxelflow.estimation.template.centre_of_pressure import anchor_of
from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.deforming import ODOMETRY
from taxelflow.estimation.template.extrapolation import extrapolate
from taxelflow.estimation.template.hidden_motion import shown_at_rest
from taxelflow.estimation.template.hypotheses import ENOUGH_SCANS, coarse, refined, state_precision
from taxelflow.estimation.template.initialization import FIRST_GAIN_STD, SCHEDULE, IncrementalMapper, start_scan
from taxelflow.estimation.template.likelihood import cost, touched
from taxelflow.estimation.template.map import covering, fill
from taxelflow.estimation.template.observations import COARSE, FINE, REFUTED
from taxelflow.estimation.template.online.gauge import align_gauge, turn_of_frame
from taxelflow.estimation.template.online.keyframes import Keyframes
from taxelflow.estimation.template.online.local_map import SLACK, LocalMap
from taxelflow.estimation.template.online.track_state import KEYFRAMES
from taxelflow.estimation.template.tilt import shift_by_tilt
from taxelflow.numerics.blas import on_one_core
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.geometry import rotation
from taxelflow.numerics.robust import GATE, gate
from taxelflow.numerics.rounding import LINEAR_RAD

if TYPE_CHECKING:
    from taxelflow.estimation.template.centre_of_pressure import Anchor
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Hidden, Solved
    from taxelflow.messages import Bools, Floats
_STRANGE = 2.0
"""How many times what still fits a keyframe may be from the others."""


def learn(known: LocalMap) -> LocalMap:
    """The map estimated again from its keyframes, with their poses where the object has moved.

    Its frame stays, as far as the keyframes determine it.
    """
    with on_one_core():
        new = _forgetting(known) if known.changing else _learn(known)
    extrapolate(new.pattern, new.keyframes.scanned, new.keyframes.states)
    return new


def _forgetting(known: LocalMap) -> LocalMap:
    """A pattern of the last few keyframes, where they are: it does not stay for long enough to be refined."""
    old, most = known.keyframes, slice(-ODOMETRY.memory, None)
    keyframes = Keyframes(old.scanned.taken(most), old.states[most], old.angled[most])
    new = _filled(known, keyframes)
    slack = np.minimum(known.slack + SLACK.first, SLACK.most)
    return replace(new, error=COARSE, usual=GATE, gain_std=FIRST_GAIN_STD, slack=slack, changing=True)


def _filled(known: LocalMap, keyframes: Keyframes) -> LocalMap:
    """The pattern that explains keyframes where they are."""
    new = replace(known, keyframes=keyframes, turned=0.0)
    pattern = covering(new.scanned, keyframes.states)
    fill(pattern, new.scanned.with_error(COARSE), keyframes.states)
    return replace(new, pattern=pattern, radius=pattern.radius())


def _learn(known: LocalMap) -> LocalMap:
    keyframes = known.keyframes
    count, near = len(keyframes), KEYFRAMES.far if keyframes.grown else KEYFRAMES.near
    moved = keyframes.spread(known.radius) > near or _grown_now(known)
    if count <= 2 or not moved:
        new = _filled(known, keyframes)
        if new.undecided and known.taken & (known.taken - 1) == 0:  # at 1, 2, 4, 8, ...: it takes time
            new.decided = shown_at_rest(new.scanned.taken(slice(-1, None)))
        return new
    best, looked = _best(known)
    gains = best.gains if len(best.gains) else known.gains
    scanned, pattern = replace(known, gains=gains).scanned, best.pattern
    before = (keyframes.angled if best.turns and not known.turns else keyframes.states).copy()
    before[:, :2] += known.origin
    turned, alike = turn_of_frame(before, best, known, newest=int(np.flatnonzero(~_strange(best))[-1]))
    states, origin, off = align_gauge(before, best, scanned, turned, alike)
    slack = np.full(2, SLACK.first) if best.grows and not known.grows else _slack(known, off)
    shown = known.shown if looked == known.looked else best.shown
    rival = known.rival if looked == known.looked else best.rival_variance(turns=known.unseen_error > 0)
    sure = bool(slack[1] < SLACK.reported * SLACK.first and rival[1] < LINEAR_RAD**2)
    new = replace(
        known,
        pattern=pattern,
        keyframes=Keyframes(keyframes.scanned, states, states if best.turns else keyframes.angled.copy()),
        gains=gains,
        radius=pattern.radius(),
        error=max(best.error, FINE * float(np.sqrt(ENOUGH_SCANS / count))),
        usual=float(np.clip(best.fit.reduced / best.fit.freedom, 1.0, GATE)),
        gain_std=best.gain_std if count >= ENOUGH_SCANS else FIRST_GAIN_STD,
        turns=best.turns,
        grows=best.grows,
        shown=shown,
        reports_turn=best.turns and shown and (known.reports_turn or sure),
        turned=turned,
        slack=slack,
        tilt=_tilt(best, scanned, known.unseen_error),
        rival=rival,
        origin=origin,
        hidden=known.hidden if looked == known.looked else best.hidden,
        decided=known.decided or looked != known.looked,
        tested=known.tested if looked == known.looked or _still_known(known) is not None else looked,
        anchor=_anchor(known, gains, replace(best, states=states)),
        looked=looked,
    )
    own = replace(pattern)
    fill(own, scanned.with_error(max(new.error, FINE)), states)
    pattern.doubt = own.doubt
    if count < KEYFRAMES.young:
        return new
    return _forgetting(new) if new.error > REFUTED else _without_strangers(new, best)


def _anchor(known: LocalMap, gains: Floats, best: Solved) -> Anchor | None:
    """See `anchor_of`; None where the centre of pressure is no witness. gains: (taxels,), infinite of dead ones."""
    if best.grows or not known.unseen_error:
        return None
    scanned = known.keyframes.scanned
    read = replace(scanned, variance=np.where(np.isinf(gains), 0.0, scanned.variance))
    return anchor_of(best, read, known.unseen_error, known.anchor)


def _tilt(best: Solved, scanned: Scanned, tilt_std: float) -> Floats:
    """Covariance of a place by a tilt of the load, as xx, xy and yy in pitches^2, where the object is at angle 0: mean
    of the last keyframes.
    """
    last = slice(-ODOMETRY.memory, None)
    states, error, own = best.states[last], max(best.error, tilt_std), scanned.taken(last)
    precision = state_precision(best, own)
    information = linearised(best.pattern, own, states, error, precision).normal.blocks
    shifts, turns = shift_by_tilt(information, best.pattern, own, states, error, tilt_std), rotation(states[:, 2])
    in_body: Floats = (turns.transpose(0, 2, 1) @ shifts @ turns).mean(axis=0)
    return in_body[[0, 0, 1], [0, 1, 1]]


def _without_strangers(new: LocalMap, best: Solved) -> LocalMap:
    """What was learned without the keyframes that fit far worse than most: they were registered at a wrong place."""
    kept = np.flatnonzero(~_strange(best))
    if not 0 < len(best.states) - len(kept) <= len(best.states) / 4:
        return new
    old = new.keyframes
    return replace(new, keyframes=Keyframes(old.scanned.taken(kept), old.states[kept], old.angled[kept]))


def _strange(solved: Solved) -> Bools:
    """(scans,), those that fit far worse than most."""
    share = solved.fit.per_reading
    usual = float(np.median(share))
    most = [_STRANGE * gate(usual, count) for count in solved.fit.counts]
    strange: Bools = share > most
    return strange


def _grown_now(known: LocalMap) -> bool:
    """Whether sizes differ, so that hypotheses are worth comparing though the object has hardly moved."""
    return known.keyframes.grown and known.taken >= KEYFRAMES.more * max(known.looked, 1)


def _best(known: LocalMap) -> tuple[Solved, int]:
    """The likeliest hypothesis on the keyframes, and how many had been taken when they were last compared.

    They are compared as in a batch, on the readings as they are: gains that were learned with a wrong motion hide it.
    """
    keyframes, taken = known.keyframes, known.taken
    if len(keyframes) < KEYFRAMES.compared or taken < KEYFRAMES.more * known.looked:
        present = _again(known, known.scanned, keyframes.states.copy())
        if taken < max(KEYFRAMES.young, _soonest(known.looked)) or not _strange(present).any():
            return present, known.looked
    scanned = replace(keyframes.scanned, variance=keyframes.scanned.variance.copy())
    dead = np.flatnonzero(np.isinf(known.gains)).tolist()
    states, hidden = None if known.grows else keyframes.states, _still_known(known)
    best = solve_contact(scanned, suspects=dead, known=states, hidden=hidden)
    return _with_former_gains(known, scanned, best), taken


def _soonest(looked: int) -> float:
    """How many scans must have been keyframes before hypotheses are compared again where a keyframe does not fit.

    A few more than when they were last compared. Where more have come than a map keeps, a quarter more of these: a
    comparison takes as long, and changes less.
    """
    beyond = max(looked - KEYFRAMES.most, 0)
    return looked + max(ODOMETRY.memory, 0.5 * (KEYFRAMES.more - 1.0) * beyond)


def _still_known(known: LocalMap) -> Hidden | None:
    """The direction in which no reading shows a motion, if any. None where it is to be tested.

    The test takes long, and strange keyframes call for it again and again. A hidden motion is tested when half as many
    keyframes more may show it, a map that shows all at every second comparison: more show no less of it.
    """
    more = KEYFRAMES.more if known.hidden else KEYFRAMES.more**2
    return known.hidden if known.taken < more * known.tested else None


def _with_former_gains(known: LocalMap, scanned: Scanned, best: Solved) -> Solved:
    """A solved contact with a gain of each taxel, which is infinite if it is dead: those known from a contact before
    where these scans determine none, but are likelier with them.
    """
    gains = np.ones(scanned.readings.shape[1])
    gains[best.dead] = np.inf
    if len(best.gains):
        return replace(best, gains=gains * best.gains)
    former = gains * np.where(np.isinf(known.gains), 1.0, known.gains)
    if (former == gains).all():
        return replace(best, gains=gains)
    divided = scanned.divided(former)
    other = refined(divided, best.copy())
    lives = np.isfinite(former)
    readings = np.count_nonzero(touched(divided)[:, lives], axis=0)
    of_readings = cost(other, divided) + 2.0 * float(readings @ np.log(former[lives]))  # densities of the undivided
    return replace(other, gains=former) if of_readings < cost(best, scanned) else replace(best, gains=gains)


def _again(known: LocalMap, scanned: Scanned, states: Floats) -> Solved:
    """The present hypothesis, from where the keyframes are."""
    if len(scanned) < ENOUGH_SCANS:
        starts = [states, _retraced(scanned, turns=known.turns)]
        fits = [coarse(scanned, one, turns=known.turns, rounds=SCHEDULE.refine_rounds) for one in starts]
        return min(fits, key=lambda one: one.error)
    start = coarse(scanned, states, turns=known.turns, rounds=0)
    return refined(scanned, replace(start, grows=known.grows, gain_std=known.gain_std))


def _retraced(scanned: Scanned, *, turns: bool) -> Floats:
    """States (n, 5) of keyframes, one registered after the other as in a batch."""
    own = scanned.taken(np.arange(len(scanned)))
    mapper = IncrementalMapper(own, start_scan(own), turns=turns, coarse=True)
    mapper.register_all()
    return mapper.states


def _slack(known: LocalMap, off: Floats) -> Floats:
    """(2,), see `LocalMap`: from how far the last keyframes were from where they are, off (n, 5)."""
    fresh = off[len(off) - known.fresh :]
    if not len(fresh):
        return known.slack
    wrong = np.array([np.mean(fresh[:, :2] ** 2), np.mean(states_of(fresh).theta ** 2)])
    slack: Floats = np.maximum(wrong, SLACK.forget * known.slack)
    return slack
