"""Changes of the contact over time without slip: force, tilt, rolling, deformation, lift-off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.parameters import Load, Motion


@dataclass(frozen=True, slots=True)
class State:
    """State of the contact; each field (...) broadcasts against the points at which the pressure is computed.

    force: multiple of the nominal force, 0 without contact. tilt: relative change of the pressure at the object's edge.
    roll_m: displacement of the pressure on the object, m. deformed: cycles of deformation so far.
    stepped: number of steps of the feet so far, with the fraction of the current one.
    """

    force: Floats
    tilt: Floats
    roll_m: Floats
    deformed: Floats
    stepped: Floats


def state_at(load: Load, motion: Motion, t_s: Floats, deformed: Floats) -> State:
    """The state at times t_s (...); it changes between the two rests of the motion. deformed: (...), see `State`."""
    phase = np.clip((t_s - motion.rest_s) / motion.moving_s, 0.0, 1.0)
    first, second = load.multiples
    if load.kind == "constant":
        force = np.ones_like(t_s)
    elif load.kind == "ramp":
        force = first + (second - first) * phase
    else:
        force = first + (second - first) * (0.5 - 0.5 * np.cos(2 * np.pi * load.cycles * phase))
    if load.lift_s:
        force = np.where((t_s < load.lift_s) | (t_s > motion.duration_s - load.lift_s), 0.0, force)
    return State(force, load.tilt * phase, load.roll_m * phase, deformed, load.steps * phase)
