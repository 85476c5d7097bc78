"""Structure of an object's surface: random texture and arrangement of feet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.simulation.seeds import TEXTURE

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.parameters import Contact


@dataclass(frozen=True, slots=True)
class _Waves:
    """A random texture, and feet."""

    count: int = 12
    """Cosines in a texture: enough for an irregular pattern in every direction."""
    lengths: tuple[float, float] = (0.7, 1.5)
    """Range of their wavelengths over `contact.wavelength_m`."""
    uneven: float = 0.4
    """Largest difference of the feet's peaks over the highest one."""


_WAVES = _Waves()
_GOLDEN = (np.sqrt(5) - 1) / 2
"""Golden ratio: its multiples modulo 1 are evenly spread and never repeat."""


@dataclass(frozen=True, slots=True)
class Texture:
    """A sum of cosines.

    wave: (waves, 2), wave vectors in rad/m. phase: (waves,) in rad. drift: (waves,), rad per cycle of deformation.
    length_m: (waves,), wavelengths.
    """

    wave: Floats
    phase: Floats
    drift: Floats
    length_m: Floats

    def terms(self, along: Floats, across: Floats, deformed: Floats | float = 0.0) -> list[Floats]:
        """Each cosine at points (...) of the object's frame, in m, after cycles of deformation (...)."""
        return [
            np.asarray(np.cos(wave[0] * along + wave[1] * across + phase + drift * deformed), dtype=np.float64)
            for wave, phase, drift in zip(self.wave, self.phase, self.drift, strict=True)
        ]

    def factor(self, depth: float, along: Floats, across: Floats, deformed: Floats) -> Floats:
        """Factor (...) on the pressure: mean 1, standard deviation `depth`, not below 0."""
        waves = sum(self.terms(along, across, deformed), np.zeros(()))
        factor: Floats = np.clip(1.0 + depth * np.sqrt(2 / _WAVES.count) * waves, 0.0, None)
        return factor


def texture_of(contact: Contact, seed: int) -> Texture:
    """Texture of an object: waves in all directions, of similar wavelengths."""
    random = np.random.default_rng([seed, TEXTURE])
    length = contact.wavelength_m * random.uniform(*_WAVES.lengths, _WAVES.count)
    direction = random.uniform(0.0, np.pi, _WAVES.count)
    wave = 2 * np.pi / length[:, np.newaxis] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    phase, drift = random.uniform(-np.pi, np.pi, (2, _WAVES.count))
    return Texture(wave, phase, drift, length)


def feet_of(contact: Contact) -> tuple[Floats, Floats]:
    """Positions (feet, 2) in the object's frame, in m, and peaks (feet,) over the highest one.

    No two peaks are equal, so that no rotation maps the pattern onto itself. On a disc the feet lie on Vogel's spiral:
    of uniform density, without a lattice that a translation could map onto itself.
    """
    number = np.arange(len(contact.feet_at_m) or contact.feet)
    peaks: Floats = 1.0 - _WAVES.uneven * (number * _GOLDEN % 1.0)
    if contact.feet_at_m:
        return np.array(contact.feet_at_m), peaks
    if contact.feet_on == "disc":
        radius = contact.ring_m * np.sqrt((number + 0.5) / contact.feet)
        angle = 2 * np.pi * _GOLDEN * number
    else:
        radius = np.full(contact.feet, contact.ring_m)
        angle = 2 * np.pi * number / contact.feet
    positions: Floats = radius[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return positions, peaks
