"""Objects for the gripper: shapes in MJCF, drawn at random within their kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import NameUnknown

if TYPE_CHECKING:
    from collections.abc import Callable

_PAINT = 'rgba="0.9 0.55 0.2 1"'


@dataclass(frozen=True)
class Shape:
    """What is held. The frame's origin lies between the pads, x along the closing axis, z up."""

    geoms: str
    """MJCF of the geoms."""
    half_m: float
    """Half of the width between the pads."""
    back_m: float = 0.0
    """How far it reaches from the origin against world y, towards the palm of a hand."""
    mesh: str = ""
    """MJCF of the mesh `object`, where a geom uses it."""


def ball(_random: np.random.Generator) -> Shape:
    """A sphere of 60 mm."""
    return Shape(f'<geom type="sphere" size="0.03" {_PAINT}/>', 0.03)


def rod(_random: np.random.Generator) -> Shape:
    """A lying cylinder of 30 mm, longer than the pads are wide."""
    return Shape(f'<geom type="cylinder" size="0.015 0.035" zaxis="0 1 0" {_PAINT}/>', 0.015)


def box(_random: np.random.Generator) -> Shape:
    """A block whose faces are a little narrower than the pads, and higher."""
    return Shape(f'<geom type="box" size="0.025 0.0155 0.0205" {_PAINT}/>', 0.025)


def plate(_random: np.random.Generator) -> Shape:
    """A block with flat faces larger than the pads: nothing to feel."""
    return Shape(f'<geom type="box" size="0.02 0.05 0.06" {_PAINT}/>', 0.02)


def bumpy(random: np.random.Generator) -> Shape:
    """A block with round bumps of random size and place on both faces."""
    parts = [f'<geom type="box" size="0.024 0.03 0.045" {_PAINT}/>']
    for side in (-1, 1):
        for y, z in np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-3, 4)), axis=-1).reshape(-1, 2) * 0.012:
            dy, dz = random.uniform(-0.003, 0.003, 2)
            radius, height = random.uniform(0.006, 0.012), random.uniform(0.0010, 0.0016)
            at = f"{side * (0.024 + height - radius):.5f} {y + dy:.5f} {z + dz:.5f}"
            parts.append(f'<geom type="sphere" size="{radius:.5f}" pos="{at}" rgba="0.85 0.4 0.15 1"/>')
    return Shape("".join(parts), 0.0253)


def bottle(random: np.random.Generator) -> Shape:
    """A round body with ribs at random heights, a shoulder, a neck and a cap."""
    parts = ['<geom type="cylinder" size="0.0285 0.055" rgba="0.45 0.7 0.9 0.6"/>']
    heights = np.linspace(-0.045, 0.045, 7) + random.uniform(-0.002, 0.002, 7)
    rib = 'type="ellipsoid" size="0.03 0.03 0.006" rgba="0.35 0.6 0.85 0.8"'
    parts += [f'<geom {rib} pos="0 0 {z:.5f}"/>' for z in heights]
    seen = 'contype="0" conaffinity="0"'  # above the pads: to look at
    parts.append(f'<geom type="ellipsoid" size="0.0285 0.0285 0.02" pos="0 0 0.055" rgba="0.45 0.7 0.9 0.6" {seen}/>')
    parts.append(f'<geom type="cylinder" size="0.012 0.012" pos="0 0 0.083" rgba="0.9 0.3 0.3 1" {seen}/>')
    return Shape("".join(parts), 0.03)


def can(_random: np.random.Generator) -> Shape:
    """An upright cylinder of 78 mm for the hand: nothing to feel along its axis."""
    return Shape(f'<geom type="cylinder" size="0.039 0.08" {_PAINT}/>', 0.039, back_m=0.039)


def jar(random: np.random.Generator) -> Shape:
    """An upright cylinder of 75 mm for the hand, with ribs at random heights."""
    heights = np.linspace(-0.075, 0.075, 11) + random.uniform(-0.002, 0.002, 11)
    rib = 'type="ellipsoid" size="0.039 0.039 0.006" rgba="0.85 0.4 0.15 1"'
    ribs = "".join(f'<geom {rib} pos="0 0 {z:.5f}"/>' for z in heights)
    return Shape(f'<geom type="cylinder" size="0.0375 0.08" {_PAINT}/>{ribs}', 0.039, back_m=0.039)


def case(_random: np.random.Generator) -> Shape:
    """A box of 78 mm for the hand, so low that its edges lie on two of three pads."""
    return Shape(f'<geom type="box" size="0.039 0.03 0.028" {_PAINT}/>', 0.039, back_m=0.039)


def convex(random: np.random.Generator) -> Shape:
    """The convex hull of 24 random places on an ellipsoid."""
    places = random.normal(size=(24, 3))
    places *= random.uniform(0.022, 0.034, 3) / np.linalg.norm(places, axis=1, keepdims=True)
    places -= (places.max(axis=0) + places.min(axis=0)) / 2
    vertices = " ".join(f"{number:.6f}" for number in places.ravel())
    mesh = f'<mesh name="object" vertex="{vertices}" inertia="convex"/>'
    return Shape(f'<geom type="mesh" mesh="object" {_PAINT}/>', float(places[:, 0].max()), mesh=mesh)


OBJECTS: dict[str, Callable[[np.random.Generator], Shape]] = {
    "ball": ball,
    "rod": rod,
    "box": box,
    "bottle": bottle,
    "bumpy": bumpy,
    "plate": plate,
    "convex": convex,
    "jar": jar,
    "case": case,
    "can": can,
}
"""Kinds of objects by name. The first five are those of the standard trials."""
STANDARD_OBJECTS = tuple(OBJECTS)[:5]
PALM_OBJECTS = ("jar", "case", "can")
"""Kinds that fit the palm of a hand: the bottle and the box as wide as it needs, and one without ribs."""
FEATURELESS = ("plate", "can")
"""Kinds that cover the pads and have nothing to feel along their slip: it cannot be distinguished from rest."""


def shape(name: str, random: np.random.Generator) -> Shape:
    """A shape of that kind. Raises NameUnknown."""
    if name not in OBJECTS:
        raise NameUnknown("object", name, OBJECTS)
    return OBJECTS[name](random)
