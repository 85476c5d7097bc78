"""What happens to an object that is held: it is lifted, then its load changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import NameUnknown
from taxelflow.numerics.gravity import G_M_S2
from taxelflow.simulation.mujoco.plants import TRIAL

if TYPE_CHECKING:
    from taxelflow.messages import Floats


EVENTS = {
    "pour": "the mass grows to a multiple",
    "pull": "a force of a multiple of the weight pulls, mostly down",
    "shake": "the gripper shakes up and down",
    "weak": "the first grip is below the least that holds",
    "none": "nothing changes after the lift",
    "double": "the mass doubles at once",
}
"""Events by name. The first four are those of the standard trials."""
STANDARD_EVENTS = tuple(EVENTS)[:4]


@dataclass(frozen=True)
class Load:
    """What acts on the object at a time. gravity, pull: (3,), m/s^2 and N, in the world's frame (z up)."""

    mass_kg: float
    gravity: Floats
    pull: Floats

    def tangential_n(self) -> float:
        """Size of the force along the pads, which friction has to carry."""
        return float(np.linalg.norm((self.mass_kg * self.gravity + self.pull)[1:]))


@dataclass(frozen=True)
class Happening:
    """An event with its numbers, drawn at random."""

    event: str
    mass_kg: float
    """Mass before the event."""
    times: float
    """pour, pull: load at the end over the weight before."""
    ramp_s: float
    """pour, pull: duration of the change."""
    angle_rad: float
    """pull: direction against straight down."""
    shake_hz: float
    shake_g: float
    """shake: amplitude of the acceleration over that of gravity."""

    @classmethod
    def drawn(cls, event: str, mass_kg: float, random: np.random.Generator) -> Happening:
        """Random numbers for an event. Raises NameUnknown."""
        if event not in EVENTS:
            raise NameUnknown("event", event, EVENTS)
        return cls(
            event,
            mass_kg,
            times=random.uniform(1.8, 3.0),
            ramp_s=random.uniform(0.8, 2.0),
            angle_rad=random.uniform(-0.6, 0.6),
            shake_hz=random.uniform(1.5, 4.0),
            shake_g=random.uniform(0.4, 1.2),
        )

    def load(self, t_s: float) -> Load:
        """What acts at a time of the trial. The gripper's own acceleration is part of gravity, which it feels alike."""
        gravity, pull, mass = np.zeros(3), np.zeros(3), self.mass_kg
        gravity[2] = -G_M_S2 * np.clip((t_s - TRIAL.lift_s) / (TRIAL.lifted_s - TRIAL.lift_s), 0.0, 1.0)
        since_s = max(t_s - TRIAL.event_s, 0.0)
        more = min(since_s / self.ramp_s, 1.0) * (self.times - 1.0)
        if self.event == "pour":
            mass *= 1.0 + more
        elif self.event == "double" and t_s > TRIAL.event_s - 1e-9:
            mass *= 2.0
        elif self.event == "pull":
            pull[1:] = more * mass * G_M_S2 * np.array([np.sin(self.angle_rad), -np.cos(self.angle_rad)])
        elif self.event == "shake":
            grown = min(since_s / 0.5, 1.0) * self.shake_g
            gravity[2] -= grown * G_M_S2 * np.sin(2.0 * np.pi * self.shake_hz * since_s)
        return Load(mass, gravity, pull)

    def lasting_n(self, t_s: float) -> float:
        """The tangential force that a grip at this time has to carry; of a shake its peak."""
        if self.event == "shake" and t_s > TRIAL.event_s:
            return self.mass_kg * G_M_S2 * (1.0 + self.shake_g)
        return self.load(t_s).tangential_n()
