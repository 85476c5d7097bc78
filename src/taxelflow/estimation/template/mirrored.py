"""Whether the scans show which way an object turns: its turn against the mirror image of it.

Where taxels differ by more than is known of them, what stays on the skin holds the pattern back. An object that turns
on the spot, and looks much the same at many angles (a nut, a gear, a ball), then seems to turn by a part of its turn.
This fit is likelier than without a turn, but hardly more so than one that turns the other way: the pattern gives way to
either. A pattern that shows the angle leads a fit that starts with the mirror image back, or explains far less by it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.hypotheses import coarse
from taxelflow.estimation.template.observations import REFUTED
from taxelflow.estimation.template.pose_output import arm_of
from taxelflow.estimation.template.rivals import reported
from taxelflow.numerics.bspline import states_of
from taxelflow.numerics.robust import CLEARLY

if TYPE_CHECKING:
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats


def outdoes_its_mirror(free: Solved, scanned: Scanned) -> bool:
    """Whether no turn the other way that explains the scans explains nearly as much as the turn of a fit.

    Both are fitted alike, and coarsely: further rounds sharpen the pattern until any turn explains the scans.
    """
    turned, mirrored = (_from_turn(free, scanned, times) for times in (1.0, -1.0))
    leads_back = float(_angles(turned) @ _angles(mirrored)) > 0.0
    return leads_back or mirrored.error > min(CLEARLY * turned.error, REFUTED)


def _from_turn(free: Solved, scanned: Scanned, times: float) -> Solved:
    """The coarse fit from the turn of a fit times a factor, with the reported point where it is."""
    states, middle = free.states.copy(), free.middle(scanned)
    states_of(states).theta[:] *= times
    states[:, :2] = reported(free, scanned) - arm_of(middle, states)
    return coarse(scanned, states, turns=True)


def _angles(solved: Solved) -> Floats:
    """(scans,), less their mean: the object's own angle is arbitrary."""
    theta = np.unwrap(states_of(solved.states).theta)
    apart: Floats = theta - theta.mean()
    return apart
