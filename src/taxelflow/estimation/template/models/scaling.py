"""Contacts that grow with their load: at a border, growth looks like motion.

An object that stays in its place, its contact's size going with the load, is held against what was found without a
size. Which of its points stays is found, too: the one whose place goes least with the size.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.batch.initialization import Tracker
from taxelflow.estimation.template.batch.model_selection import (
    FIRST_ROUGH,
    level,
    roughness,
    start_scan,
    unexplained,
)
from taxelflow.estimation.template.bundle_adjustment import refine
from taxelflow.estimation.template.observability import sights
from taxelflow.numerics.bspline import GAIN, SIZE, THETA

if TYPE_CHECKING:
    from taxelflow.estimation.template.bundle_adjustment import Fit
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats

_LOADS, _DIFFER = (0.05, 0.95), 2.0
"""Quantiles of the load, and how many times the first the other must be for growth to show."""
_FEWEST = 5
_STAYS = 2.0
"""Only a contact that seemed to stay within so many pitches may be one that grew."""
_SUSPECT = 0.3
"""Growth is looked for where so much of the motion's variance goes with the load's logarithm, or where the pattern is
rough."""
_EXPLAINED, _FOLLOWS = 1.03, 0.9
"""Growth must explain the scans so many times better, most of whose readings are not at the border where it shows; and
the size correlate so well with the load's logarithm."""
_POWER, SIZE_STD, _FIRST_GAIN_STD = 1 / 3, 0.3, 1.0
"""Hertz: size and pressure go with the cube root of the force. How far they are from that."""
_SHARES = (0.05, 20.0)
_PLACE, _ELSEWHERE, _SLIDES = 0.02, 1.0, 0.25
"""How well places are known, in pitches; how far off the point that stays may be; and how fast an object usually
slides as it is pressed, in pitches per s."""
_HELD_ROUNDS, _ROUNDS = 15, (8, 8, 4)


def grown(solved: Solved, scanned: Scanned, size: Floats) -> Solved:
    """The contact with a size that goes with the load if that explains its scans clearly better, else as it was.

    size: (2,) of a taxel, in pitches.
    """
    load = scanned.load().sum(axis=1)
    least, most = np.quantile(load, _LOADS)
    if len(scanned) < _FEWEST or most < _DIFFER * max(least, 1e-300):
        return solved
    stays = float(np.ptp(solved.states[:, :2], axis=0).max()) < _STAYS
    if not stays or not (solved.rough > FIRST_ROUGH or _moves_with(solved.states, load)):
        return solved
    growing = _growing(solved, scanned, size, load)
    if _believed(growing, solved, scanned, load):
        return growing
    scanned.bend(solved.states)
    return solved


def _moves_with(states: Floats, load: Floats) -> bool:
    """Whether places in states (scans, 5) go with the load (scans,)."""
    known = load > 0
    places = states[known, :2] - states[known, :2].mean(axis=0)
    level = np.log(load[known]) - np.log(load[known]).mean()
    along = np.outer(level, level @ places) / max(float(level @ level), 1e-300)
    return bool(np.sum(along**2) > _SUSPECT * np.sum(places**2))


def _believed(growing: Solved, solved: Solved, scanned: Scanned, load: Floats) -> bool:
    """Whether the contact grows with the load."""
    rough = min(solved.rough, growing.rough)
    better = unexplained(solved.fit, scanned, rough) > _EXPLAINED * unexplained(growing.fit, scanned, rough)
    loaded = load > 0
    return bool(better and np.corrcoef(growing.states[loaded, SIZE], np.log(load[loaded]))[0, 1] > _FOLLOWS)


def _growing(solved: Solved, scanned: Scanned, size: Floats, load: Floats) -> Solved:
    """The contact as one that grows."""
    start = start_scan(scanned)
    states, pattern, fit, rough, gain_std = in_place(scanned, size, load, start, solved.rough, turns=solved.turns)
    sight = float(sights(pattern, scanned, states, fit.factor, start, rough)[THETA]) * fit.freedom**2
    return replace(
        solved, pattern=pattern, states=states, fit=fit, rough=rough, gain_std=gain_std, sight=sight, grows=True
    )


def in_place(
    scanned: Scanned, size: Floats, load: Floats, start: int, rough: float, *, turns: bool
) -> tuple[Floats, Pattern, Fit, float, float]:
    """States (scans, 5) of an object that stays while its contact grows with the load (scans,), its pattern, their fit,
    the pattern's relative error, and the gains' deviation: first held where it is in scan `start`, then free to move.

    size: (2,) of a taxel, in pitches. rough: error of the pattern to begin with. turns: whether it may turn.
    """
    pattern, states = _held(scanned, size, load, start)
    stiffness = np.array([np.inf, np.inf, np.inf, _FIRST_GAIN_STD**-2, SIZE_STD**-2])
    fit = refine(pattern, scanned, states, rounds=_HELD_ROUNDS, rough=rough, stiffness=stiffness)
    gain_std = _FIRST_GAIN_STD
    for rounds in _ROUNDS:
        gain_std, rough = level(pattern, states, fit), roughness(fit, scanned)
        stiffness = scanned.stiffness(turns=turns, gain_std=gain_std, size=SIZE_STD**-2)
        scanned.bend(states)
        fit = refine(pattern, scanned, states, rounds=rounds, rough=rough, stiffness=stiffness)
        if rounds != _ROUNDS[-1]:
            centre(pattern, scanned, states)
    return states, pattern, fit, roughness(fit, scanned), gain_std


def _held(scanned: Scanned, size: Floats, load: Floats, start: int) -> tuple[Pattern, Floats]:
    """Pattern and states (scans, 5) of an object that stays where it is in scan `start`."""
    tracker = Tracker(scanned, start, size=size, rough=FIRST_ROUGH, stiffness=np.full(5, np.inf))
    share = np.clip(load / max(float(load[start]), 1e-300), *_SHARES)
    tracker.states[:, :2] = tracker.centroid[start]
    tracker.states[:, GAIN] = share**_POWER
    tracker.states[:, SIZE] = _POWER * np.log(share)
    tracker.start = 0
    tracker.forget(len(scanned), len(scanned))
    return tracker.pattern, tracker.states


def centre(pattern: Pattern, scanned: Scanned, states: Floats) -> None:
    """Shift the origin of the object's frame, in place, to the point whose places go least with the size.

    An object that slides steadily as it is pressed has moved; one that went with the load up and down has grown.
    """
    scale, theta = np.exp(states[:, SIZE]), states[:, THETA]
    cos, sin = scale * np.cos(theta), scale * np.sin(theta)
    arms = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)  # (scans, 2, 2)
    since = (scanned.t_s - scanned.t_s.mean())[:, np.newaxis, np.newaxis] * np.eye(2)
    apart = np.concatenate([arms - arms.mean(axis=0), since], axis=2).reshape(-1, 4)
    away = (states[:, :2] - states[:, :2].mean(axis=0)).ravel()
    known = np.diag(np.repeat([_PLACE / _ELSEWHERE, _PLACE / _SLIDES], 2))
    body = -np.linalg.lstsq(np.concatenate([apart, known]), np.append(away, np.zeros(4)), rcond=None)[0][:2]
    states[:, :2] += arms @ body
    pattern.lattice = pattern.lattice - np.array([0.0, *body])
