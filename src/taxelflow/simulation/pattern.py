"""Pressure of a contact by formula, at any point of the object's frame (x along the long axis)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from scipy.spatial import cKDTree

from taxelflow.simulation.parameters import TEXTURED
from taxelflow.simulation.texture import feet_of, texture_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Floats
    from taxelflow.simulation.load import State
    from taxelflow.simulation.parameters import Contact, Load

_SUPER_GAUSSIAN = 2
"""Exponent of r^2 in the airbag's exp(-r^4): flat in the middle, soft at the edge."""
_DEFORMATION = 0.1
"""Relative amplitude of the width of a deforming object."""
_NEAREST = 6
"""Number of feet that contribute to a point; the pressure of the seventh nearest is negligible."""
_LEAST_FORCE = 1e-9
"""Guards the radius of a growing contact at zero force."""


class Pattern(Protocol):
    """Pressure in Pa at points (along, across) in m of the object's frame; shapes broadcast."""

    def __call__(self, along: Floats, across: Floats, state: State) -> Floats:
        """The pressure in a state of the contact."""
        ...


class Analytic:
    """All shapes of contact in closed form."""

    def __init__(self, contact: Contact, load: Load, seed: int) -> None:
        self._contact, self._load = contact, load
        self._texture = texture_of(contact, seed) if contact.shape in TEXTURED else None
        self._feet, self._peaks = feet_of(contact)
        self._tree = cKDTree(self._feet) if len(self._feet) > _NEAREST else None

    def __call__(self, along: Floats, across: Floats, state: State) -> Floats:
        """See `Pattern`."""
        contact, load = self._contact, self._load
        widening = np.maximum(state.force, _LEAST_FORCE) ** load.growth if load.growth else np.ones(())
        peak = contact.peak_pa * (state.force / widening**2)
        if contact.deform_1_m:
            widening = widening * (1.0 + _DEFORMATION * np.sin(2 * np.pi * state.deformed))
        rolled = roll(load, along, across, state)
        pressure: Floats = peak * self._shape(*rolled, widening, state.stepped)
        if self._texture is not None:  # the texture does not move as the object rolls
            pressure *= self._texture.factor(contact.texture, along, across, state.deformed)
        return tilted(contact, load, pressure, rolled, state)

    def _shape(self, along: Floats, across: Floats, widening: Floats, stepped: Floats) -> Floats:
        """Pressure over its peak. widening: radius over the nominal one."""
        contact = self._contact
        if contact.shape == "feet":
            return self._feet_pressure(along, across, contact.radius_m * widening, stepped)
        r2 = (along / (contact.length_m * widening)) ** 2 + (across / (contact.radius_m * widening)) ** 2
        if contact.shape == "hertz":
            dome: Floats = np.sqrt(np.clip(1.0 - r2, 0.0, None))
            return dome
        return _airbag(r2)

    def _feet_pressure(self, along: Floats, across: Floats, radius_m: Floats, stepped: Floats) -> Floats:
        """Sum of the feet's pressures over the highest peak. radius_m: of a foot. stepped: see `State`."""
        if self._tree is None:
            total = np.zeros(np.broadcast_shapes(along.shape, across.shape))
            for number, ((x, y), peak) in enumerate(zip(self._feet, self._peaks, strict=True)):
                share = peak * self._in_contact(np.array(number), stepped)
                total += share * _airbag(((along - x) ** 2 + (across - y) ** 2) / radius_m**2)
            return total
        points = np.stack(np.broadcast_arrays(along, across), axis=-1)
        distance, foot = self._tree.query(points, k=np.arange(1, _NEAREST + 1))
        peak = self._peaks[foot] * self._in_contact(np.asarray(foot), stepped[..., np.newaxis])
        summed: Floats = np.sum(peak * _airbag((distance / radius_m[..., np.newaxis]) ** 2), axis=-1)
        return summed

    def _in_contact(self, foot: NDArray[Any], stepped: Floats) -> Floats:
        """Share of its peak that a foot exerts: in its step it lifts, stays up for a quarter of it, and lands."""
        steps_now = np.floor(stepped) % len(self._feet) == foot
        lifted: Floats = np.clip(1.5 - 2.0 * np.abs(2.0 * (stepped % 1.0) - 1.0), 0.0, 1.0)
        return np.where(steps_now & (self._load.steps > 0), 1.0 - lifted, 1.0)


def _airbag(r2: Floats) -> Floats:
    """The super-Gaussian at squared distances over the radius."""
    pressure: Floats = np.exp(-(r2**_SUPER_GAUSSIAN))
    return pressure


def roll(load: Load, along: Floats, across: Floats, state: State) -> tuple[Floats, Floats]:
    """Points (along, across) relative to the pressure's centre, which moves over the rolling object."""
    if not load.roll_m:
        return along, across
    return along - state.roll_m * np.cos(load.towards_rad), across - state.roll_m * np.sin(load.towards_rad)


def tilted(contact: Contact, load: Load, pressure: Floats, points: tuple[Floats, Floats], state: State) -> Floats:
    """Pressure raised on one side of the object and reduced on the other, not below 0. points: along, across."""
    if not load.tilt:
        return pressure
    side = (points[0] * np.cos(load.towards_rad) + points[1] * np.sin(load.towards_rad)) / contact.reach_m
    skewed: Floats = pressure * np.clip(1.0 + state.tilt * side, 0.0, None)
    return skewed
