"""Structure of an object's surface, drawn from the seed or laid out by rule: texture and feet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.parameters import Contact

SEED_TEXTURE = 2
_WAVES = 12
_GOLDEN = (np.sqrt(5) - 1) / 2
_UNEVEN = 0.4
"""The lowest foot carries this much less pressure than the highest."""


@dataclass(frozen=True, slots=True)
class Texture:
    """A sum of cosines. wave: (waves, 2) in rad/m. phase: (waves,) in rad. drift: (waves,), rad per deformation cycle.

    length_m: (waves,) wavelengths.
    """

    wave: Floats
    phase: Floats
    drift: Floats
    length_m: Floats

    def terms(self, along: Floats, across: Floats, deformed: Floats | float = 0.0) -> list[Floats]:
        """The cosines one by one, at points in the object's frame, in m, after cycles of deformation."""
        return [
            np.asarray(np.cos(wave[0] * along + wave[1] * across + phase + drift * deformed), dtype=np.float64)
            for wave, phase, drift in zip(self.wave, self.phase, self.drift, strict=True)
        ]

    def factor(self, depth: float, along: Floats, across: Floats, deformed: Floats | float = 0.0) -> Floats:
        """Pressure over that without texture: mean 1, standard deviation `depth`, never negative."""
        waves = sum(self.terms(along, across, deformed), np.zeros(()))
        rough: Floats = np.clip(1.0 + depth * np.sqrt(2 / _WAVES) * waves, 0.0, None)
        return rough


def texture_of(contact: Contact, seed: int) -> Texture:
    """The texture of an object: waves of all directions, of about one length."""
    random = np.random.default_rng([seed, SEED_TEXTURE])
    length = contact.wavelength_m * random.uniform(0.7, 1.5, _WAVES)
    direction = random.uniform(0.0, np.pi, _WAVES)
    wave = 2 * np.pi / length[:, np.newaxis] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    phase, drift = random.uniform(-np.pi, np.pi, (2, _WAVES))
    return Texture(wave, phase, drift, length)


def feet_of(contact: Contact) -> tuple[Floats, Floats]:
    """Places (feet, 2) in the object's frame, in m, and heights (feet,): peak over the highest one's.

    No two feet are equally high, so no turn by a part of a circle maps the pattern onto itself. On a disc they follow
    the sunflower's spiral: evenly dense, without a lattice that a shift could map onto itself.
    """
    number = np.arange(len(contact.feet_at_m) or contact.feet)
    heights: Floats = 1.0 - _UNEVEN * (number * _GOLDEN % 1.0)
    if contact.feet_at_m:
        return np.array(contact.feet_at_m), heights
    if contact.feet_on == "disc":
        radius = contact.ring_m * np.sqrt((number + 0.5) / contact.feet)
        angle = 2 * np.pi * _GOLDEN * number
    else:
        radius = np.full(contact.feet, contact.ring_m)
        angle = 2 * np.pi * number / contact.feet
    places: Floats = radius[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return places, heights
