"""Pressure of a contact by formula, at any point of the object's frame (long axis first)."""

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
"""Order of the airbag: exp(-r^4), flat in the middle, soft at the edge."""
_SWING = 0.1
"""Share by which a deforming object's width changes."""
_NEAREST = 6
"""Of more feet than these, only the nearest add up at a point: domes end long before the seventh."""


class Pattern(Protocol):
    """Pressure in Pa at points (along, across) in m of the object's frame; shapes broadcast."""

    def __call__(self, along: Floats, across: Floats, state: State) -> Floats:
        """The pressure there, in one state of the contact."""
        ...


class Analytic:
    """Domes, airbags, feet and textures in closed form."""

    def __init__(self, contact: Contact, load: Load, seed: int) -> None:
        self._contact, self._load = contact, load
        self._texture = texture_of(contact, seed) if contact.shape in TEXTURED else None
        self._feet, self._heights = feet_of(contact)
        self._tree = cKDTree(self._feet) if len(self._feet) > _NEAREST else None

    def __call__(self, along: Floats, across: Floats, state: State) -> Floats:
        """Pressure, with all that the state does to it."""
        contact, load = self._contact, self._load
        wide = np.maximum(state.force, 1e-9) ** load.growth if load.growth else np.ones(())
        peak = contact.peak_pa * (state.force / wide**2)
        if contact.deform_1_m:
            wide = wide * (1.0 + _SWING * np.sin(2 * np.pi * state.deformed))
        rolled = roll(load, along, across, state)
        pressure: Floats = peak * self._shape(*rolled, wide, state.stepped)
        if self._texture is not None:  # it stays where it touches while the pressure rolls over it
            pressure *= self._texture.factor(contact.texture, along, across, state.deformed)
        return tilted(contact, load, pressure, rolled, state)

    def _shape(self, along: Floats, across: Floats, wide: Floats, stepped: Floats) -> Floats:
        """Pressure over its peak. wide: radius over the contact's."""
        contact = self._contact
        if contact.shape == "feet":
            return self._domes(along, across, contact.radius_m * wide, stepped)
        r2 = (along / (contact.length_m * wide)) ** 2 + (across / (contact.radius_m * wide)) ** 2
        if contact.shape == "hertz":
            dome: Floats = np.sqrt(np.clip(1.0 - r2, 0.0, None))
            return dome
        return _soft(r2)

    def _domes(self, along: Floats, across: Floats, radius_m: Floats, stepped: Floats) -> Floats:
        if self._tree is None:
            total = np.zeros(np.broadcast_shapes(along.shape, across.shape))
            for number, ((x, y), height) in enumerate(zip(self._feet, self._heights, strict=True)):
                share = height * self._pressed(np.array(number), stepped)
                total += share * _soft(((along - x) ** 2 + (across - y) ** 2) / radius_m**2)
            return total
        points = np.stack(np.broadcast_arrays(along, across), axis=-1)
        distance, foot = self._tree.query(points, k=np.arange(1, _NEAREST + 1))
        height = self._heights[foot] * self._pressed(np.asarray(foot), stepped[..., np.newaxis])
        summed: Floats = np.sum(height * _soft((distance / radius_m[..., np.newaxis]) ** 2), axis=-1)
        return summed

    def _pressed(self, foot: NDArray[Any], stepped: Floats) -> Floats:
        """Share of its height that a foot is pressed in: it lifts, stays up for a quarter of its time, comes down."""
        up = np.floor(stepped) % len(self._feet) == foot
        raised: Floats = np.clip(1.5 - 2.0 * np.abs(2.0 * (stepped % 1.0) - 1.0), 0.0, 1.0)
        return np.where(up & (self._load.steps > 0), 1.0 - raised, 1.0)


def _soft(r2: Floats) -> Floats:
    """The super-Gaussian at squared distances over the radius."""
    bag: Floats = np.exp(-(r2**_SUPER_GAUSSIAN))
    return bag


def roll(load: Load, along: Floats, across: Floats, state: State) -> tuple[Floats, Floats]:
    """Points as seen from the pressure's centre, which rolls over the object."""
    if not load.roll_m:
        return along, across
    return along - state.roll_m * np.cos(load.towards_rad), across - state.roll_m * np.sin(load.towards_rad)


def tilted(contact: Contact, load: Load, pressure: Floats, points: tuple[Floats, Floats], state: State) -> Floats:
    """Pressure skewed to one side: more there, less on the other, never negative."""
    if not load.tilt:
        return pressure
    side = (points[0] * np.cos(load.towards_rad) + points[1] * np.sin(load.towards_rad)) / contact.reach_m
    skewed: Floats = pressure * np.clip(1.0 + state.tilt * side, 0.0, None)
    return skewed
