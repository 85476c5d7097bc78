"""The hand in space at given joint angles, its map, and the field of slip vectors on both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.publish.plots.style import BLUE, GREY, INK, MAGENTA, VERMILION, caption, save, styled
from taxelflow.sensors.hand import JointsInvalid, joint_angles
from taxelflow.sensors.kinematics import PadKinematics, angles_of
from taxelflow.sensors.pad_geometry import geometry_of
from taxelflow.sensors.projection import SphereMap

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

_FORMATS = (".svg", ".png", ".pdf")
_LONGEST = 0.15
"""The longest slip vector is drawn as this share of the hand's extent."""


@dataclass(frozen=True, slots=True, eq=False)
class InSpace:
    """Taxels (taxels, 3) with normals in the hand, numbers of their pads (taxels,), names of the pads in space."""

    places: Floats
    normals: Floats
    pad: Floats
    names: tuple[str, ...]
    pairs: list[tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class SpaceField:
    """Slip vectors (n, 3) in m/s at places (n, 3) in the hand, and in words what they amount to."""

    places: Floats
    vectors: Floats
    words: str


def draw_space(sensor: Sensor, joints: str, out: Path) -> Path:
    """Draw the hand at joint angles. Raises ParameterInvalid, JointsInvalid, HandModelInvalid, ExtraMissing.

    joints: pairs such as `spread=60deg f1=1.2`, or a named pose of the sensor's hand.
    """
    if out.suffix not in _FORMATS:
        raise ParameterInvalid("plot", str(out), f"be a file that ends in {' or '.join(_FORMATS)}")
    with styled():
        return save(space_figure(in_space(sensor, joints), None, f"{sensor.name} at {joints}"), out)


def in_space(sensor: Sensor, joints: str) -> InSpace:
    """Taxels in space at joint angles. Raises JointsInvalid, HandModelInvalid, ExtraMissing."""
    named = None if sensor.hand is None else sensor.hand.pose(joints)
    kinematics = PadKinematics(sensor)
    if not kinematics.placed.any():
        raise JointsInvalid(joints, f"no pad of {sensor.name} has a link or a pose")
    angles = angles_of(kinematics.joints, joint_angles(named or joints), sensor.name)
    T = kinematics.poses(angles[np.newaxis])[0]
    places: list[Floats] = []
    normals: list[Floats] = []
    pad: list[Floats] = []
    pairs: list[tuple[int, int]] = []
    for number in np.flatnonzero(kinematics.placed):
        own = geometry_of(msgspec.structs.replace(sensor.pads[number], pose=None))
        begin = sum(len(part) for part in places)
        places.append(own.place_m @ T[number, :3, :3].T + T[number, :3, 3])
        normals.append(own.normal @ T[number, :3, :3].T)
        pad.append(np.full(len(own.xy), number, dtype=np.float64))
        near = sensor.layout.neighbours(int(number))
        pairs += [(int(a) + begin, int(b) + begin) for a, b in near]
    names = tuple(sensor.pads[number].name for number in np.flatnonzero(kinematics.placed))
    return InSpace(np.concatenate(places), np.concatenate(normals), np.concatenate(pad), names, pairs)


def space_figure(hand: InSpace, field: SpaceField | None, title: str) -> Figure:
    """Two panels: the hand in space, and its map with the distortion."""
    import matplotlib.pyplot as plt

    projection = SphereMap(hand.places, hand.normals)
    figure = plt.figure(figsize=(11.0, 5.6), layout="constrained")
    space: Any = figure.add_subplot(1, 2, 1, projection="3d")
    flat = figure.add_subplot(1, 2, 2)
    _draw_taxels(space, flat, hand, projection)
    low, high = projection.distortion(hand.places, hand.pairs)
    seen = (
        "Left: taxels in space with their normals. Right: azimuthal equidistant projection around the point where the "
        f"normals meet, pole at the palm, seen from the object; distances between neighbouring taxels are {low:.2f} to "
        f"{high:.2f} times those on the skin."
    )
    if field is not None:
        _draw_field(space, flat, field, projection, float(np.ptp(hand.places, axis=0).max()))
        seen += " " + field.words
    space.set_title(title)
    flat.set_title("map")
    caption(figure, seen, 150)
    return figure


def _draw_taxels(space: Any, flat: Axes, hand: InSpace, projection: SphereMap) -> None:
    at, on_map = 1e3 * hand.places, 1e3 * projection.project(hand.places)
    space.scatter(*at.T, s=8, color=BLUE, depthshade=False)
    space.quiver(*at.T, *(6.0 * hand.normals.T), color=GREY, linewidth=0.5, arrow_length_ratio=0.3)
    flat.scatter(on_map[:, 0], on_map[:, 1], s=14, marker="s", color="#c9d7e6", edgecolor=GREY, linewidth=0.4)
    for number, name in zip(np.unique(hand.pad), hand.names, strict=True):
        own = hand.pad == number
        top = on_map[own].mean(axis=0)
        flat.annotate(name, top, ha="center", va="center", fontsize=7, color=INK, zorder=6)
        space.text(*(at[own].mean(axis=0) - 14.0 * hand.normals[own].mean(axis=0)), name, fontsize=6, color=INK)
    for axis, name in ((space.set_xlabel, "x"), (space.set_ylabel, "y"), (space.set_zlabel, "z")):
        axis(f"{name} in mm")
    space.set_aspect("equal")
    space.view_init(elev=25, azim=-60)
    flat.set_aspect("equal")
    flat.set_xlabel("mm")
    flat.set_ylabel("mm")


def _draw_field(space: Any, flat: Axes, field: SpaceField, projection: SphereMap, extent_m: float) -> None:
    known = np.isfinite(field.vectors).all(axis=1)
    places, vectors = field.places[known], field.vectors[known]
    if not len(places):
        return
    scale = _LONGEST * extent_m / float(np.linalg.norm(vectors, axis=1).max())
    space.quiver(*(1e3 * places.T), *(1e3 * scale * vectors.T), color=VERMILION, linewidth=2.0)
    on_map, carried = 1e3 * projection.project(places), 1e3 * scale * projection.carry(places, vectors)
    arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
    flat.quiver(
        on_map[:, 0], on_map[:, 1], carried[:, 0], carried[:, 1], color=VERMILION, width=0.007, zorder=5, **arrows
    )
    flat.update_datalim(on_map + carried)  # which leaves out arrows by itself
    flat.autoscale_view()
    flat.plot([0], [0], marker="+", color=MAGENTA, markersize=9)


def rotor_on_map(hand: InSpace, field: SpaceField) -> float:
    """The paper's rotor dSy/dx - dSx/dy, 1/s, of the best affine field on the map; NaN below three vectors."""
    known = np.isfinite(field.vectors).all(axis=1)
    if known.sum() < 3:
        return float("nan")
    projection = SphereMap(hand.places, hand.normals)
    at = projection.project(field.places[known])
    S = projection.carry(field.places[known], field.vectors[known])
    slope, *_ = np.linalg.lstsq(np.column_stack([np.ones(len(at)), at]), S, rcond=None)
    return float(slope[1, 1] - slope[2, 0])
