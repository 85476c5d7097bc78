"""What happens to the pressure over time without any slip: load, tilt, rolling, deformation, lifting off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.parameters import Load, Motion


@dataclass(frozen=True, slots=True)
class State:
    """State of the contact, each (...) of a shape that broadcasts against the points where pressure is asked for.

    force: over that which gives the contact's peak; 0 while the object is lifted off. tilt: share of the pressure
    that is skewed. roll_m: how far the pressure has moved on the object. deformed: cycles of deformation so far.
    stepped: how many feet have lifted and come down so far.
    """

    force: Floats
    tilt: Floats
    roll_m: Floats
    deformed: Floats
    stepped: Floats


def state_at(load: Load, motion: Motion, t_s: Floats, deformed: Floats) -> State:
    """The state at times of any shape; it changes between the two rests of the motion."""
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
