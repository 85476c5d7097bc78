"""The solution of a contact, with dead taxels masked and the other readings divided by their gains."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.dead_taxels import denied, explained, silent_taxels, unanswering
from taxelflow.estimation.template.hidden_motion import hidden_direction
from taxelflow.estimation.template.hypotheses import solve
from taxelflow.estimation.template.likelihood import as_alive, as_dead, cost
from taxelflow.estimation.template.mirrored import outdoes_its_mirror
from taxelflow.estimation.template.observations import COARSE
from taxelflow.estimation.template.rivals import agreement
from taxelflow.estimation.template.taxel_gains import with_gains
from taxelflow.estimation.template.turning import keeps_its_angle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Hidden, Solved
    from taxelflow.messages import Floats

_MOST_DEAD = 8
"""Dead taxels of a contact at most."""
_MOVED = 0.2
"""Largest change of a position, in pitches, by the taxels' gains; beyond it the fit has reached another minimum."""


def solve_contact(
    scanned: Scanned,
    *,
    sinks: bool = False,
    suspects: Sequence[int] = (),
    known: Floats | None = None,
    hidden: Hidden | None = None,
) -> Solved:
    """Pattern and poses of all scans of a contact; in `scanned` readings of dead taxels are masked, and the others
    divided by their gains. sinks, known: see `solve`. suspects: taxels that fewer scans called dead. hidden: see
    `hidden_direction`, which is not called where it is given.
    """
    solving = partial(solve, scanned, sinks=sinks, known=known)
    solved, dead = _without_silent(scanned, suspects, solving)
    while len(dead) < _MOST_DEAD:
        better = _without(scanned, solved, unanswering(scanned, solved.fit), solving)
        better = better or _without(scanned, solved, denied(scanned, solved), solving)
        if better is None:
            break
        solved = better[0]
        dead.append(better[1])
    gained = with_gains(scanned, solved)
    if gained is not solved:
        still = agreement(gained, solved, most=_MOVED)
        gained.agrees = gained.agrees & still if len(gained.agrees) else still
    gained.dead = np.array(dead, np.int64)
    gained.shown = gained.shown and (not gained.turns or _shows_turn(gained, scanned))
    gained.hidden = hidden_direction(scanned, gained) if hidden is None else hidden
    return gained


def _shows_turn(solved: Solved, scanned: Scanned) -> bool:
    """Whether the scans show which way the object turns, if it does, and if the sensor has an `unseen_error`.

    Without one, the likelihood has decided.
    """
    return not scanned.unseen_error or keeps_its_angle(solved, scanned) or outdoes_its_mirror(solved, scanned)


def _without(
    scanned: Scanned, solved: Solved, taxel: int | None, solving: Callable[[], Solved]
) -> tuple[Solved, int] | None:
    """The solution with a taxel masked, if that is likelier for all readings; its own are then noise."""
    if taxel is None:
        return None
    kept = scanned.variance[:, taxel].copy()
    alive = cost(solved, scanned) + as_alive(scanned, taxel, solved)
    scanned.variance[:, taxel] = 0.0
    without = solving()
    if without.error <= COARSE and cost(without, scanned) + as_dead(scanned, taxel, kept, without.error) < alive:
        return without, taxel
    scanned.variance[:, taxel] = kept
    return None


def _without_silent(
    scanned: Scanned, suspects: Sequence[int], solving: Callable[[], Solved]
) -> tuple[Solved, list[int]]:
    """The solution without silent taxels, and their numbers: those that the pattern says should have a load."""
    dead = np.union1d(silent_taxels(scanned), np.array(suspects, np.int64))
    variance = scanned.variance[:, dead]
    scanned.variance[:, dead] = 0.0
    solved = solving()
    gaps = explained(scanned, variance, solved, dead)
    if gaps.any():
        scanned.variance[:, dead[gaps]] = variance[:, gaps]
        solved = solving()
    return solved, dead[~gaps].tolist()
