"""The hand in space at given joint angles, its map, and the field of slip vectors on both."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Joints
from taxelflow.publish.plots.marks import draw_taxels
from taxelflow.publish.plots.names import finger, free_places, write_names
from taxelflow.publish.plots.sizes import ARROWS, FACES, NAMES
from taxelflow.publish.plots.solid import draw_faces, faces, frame, on_paper
from taxelflow.publish.plots.style import GREY, MAGENTA, TINTS, VERMILION, caption, pale, save, styled, wrapped
from taxelflow.sensors.hand import JointsInvalid, joint_angles, ways
from taxelflow.sensors.joint_ranges import notes_beyond_ranges
from taxelflow.sensors.kinematics import PadKinematics, angles_of
from taxelflow.sensors.pad_geometry import geometry_of
from taxelflow.sensors.projection import SphereMap

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

_FORMATS = (".svg", ".png", ".pdf")
_SIDES = ((-60.0, 25.0), (120.0, 25.0))
"""Azimuth and elevation of the two views, deg."""

_log = logging.getLogger("taxelflow")


@dataclass(frozen=True, slots=True, eq=False)
class InSpace:
    """Taxels (taxels, 3), m, with normals in the hand, numbers of their pads (taxels,), names of the pads in space.

    pairs: numbers of neighbouring taxels. faces: corners (corners, 3) of each taxel, m.
    """

    places: Floats
    normals: Floats
    pad: Floats
    names: tuple[str, ...]
    pairs: list[tuple[int, int]]
    faces: list[Floats]


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
        return save(space_figure(in_space(sensor, joints), None, f"{sensor.name}, joints: {joints}"), out)


def in_space(sensor: Sensor, joints: str) -> InSpace:
    """Taxels in space at joint angles; notes of those beyond their ranges are logged.

    Raises JointsInvalid, HandModelInvalid, ExtraMissing.
    """
    named = None if sensor.hand is None else sensor.hand.pose(joints)
    kinematics = PadKinematics(sensor)
    if not kinematics.placed.any():
        raise JointsInvalid(joints, f"no pad of {sensor.name} has a link or a pose", "leave --joints out")
    angles = angles_of(kinematics.joints, joint_angles(named or joints, ways(sensor.hand, table=False)), sensor.name)
    for note in notes_beyond_ranges(Joints(kinematics.joints, np.zeros(1), angles[np.newaxis]), kinematics.model):
        _log.warning("%s", note)
    T = kinematics.poses(angles[np.newaxis])[0]
    places: list[Floats] = []
    normals: list[Floats] = []
    pad: list[Floats] = []
    pairs: list[tuple[int, int]] = []
    corners: list[Floats] = []
    for number in np.flatnonzero(kinematics.placed):
        own = geometry_of(msgspec.structs.replace(sensor.pads[number], pose=None))
        begin = sum(len(part) for part in places)
        places.append(own.place_m @ T[number, :3, :3].T + T[number, :3, 3])
        normals.append(own.normal @ T[number, :3, :3].T)
        corners += list(faces(sensor.layout, int(number), own) @ T[number, :3, :3].T + T[number, :3, 3])
        pad.append(np.full(len(own.xy), number, dtype=np.float64))
        near = sensor.layout.neighbours(int(number))
        pairs += [(int(a) + begin, int(b) + begin) for a, b in near]
    names = tuple(sensor.pads[number].name for number in np.flatnonzero(kinematics.placed))
    return InSpace(np.concatenate(places), np.concatenate(normals), np.concatenate(pad), names, pairs, corners)


def space_figure(hand: InSpace, field: SpaceField | None, title: str) -> Figure:
    """Two panels: the hand in space, and its map; where a map would be too distorted, the hand from a second side."""
    import matplotlib.pyplot as plt
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    projection = SphereMap(hand.places, hand.normals)
    low, high = projection.distortion(hand.places, hand.pairs)
    mapped = low > 1 / FACES.distorted and high < FACES.distorted
    seen = "In space, faces turned away are pale. " + (
        "The map shows the skin as the object sees it (azimuthal equidistant projection around the centre of the "
        f"grasp): distances between neighbouring taxels are {low:.2f} to {high:.2f} times those on the skin."
        if mapped
        else "The right view is from the other side. The skin surrounds the object too far for a map."
    )
    figure = plt.figure(figsize=(11.0, 5.8), layout=ConstrainedLayoutEngine(wspace=0.05))
    views: list[Any] = [figure.add_subplot(1, 2, number, projection="3d") for number in (1, 2)[: 1 if mapped else 2]]
    for view, side in zip(views, _SIDES, strict=False):
        frame(view, np.concatenate(hand.faces), *side)
        draw_faces(view, hand.faces, hand.normals, _tints(hand))
    flat = figure.add_subplot(1, 2, 2) if mapped else None
    if flat is not None:
        _draw_map(flat, hand, projection)
    arrows = _arrows(field, float(np.ptp(hand.places, axis=0).max()))
    for view in views:
        view.quiver(*(1e3 * arrows[0].T), *(1e3 * arrows[1].T), color=VERMILION, linewidth=2.0)
    if flat is not None and len(arrows[0]):
        _draw_arrows(flat, arrows, projection)
    figure.suptitle("\n".join(wrapped(title, 120)), x=0.01, ha="left", fontsize=10, fontweight="bold")
    caption(figure, f"{seen} {'' if field is None else field.words}")
    figure.draw_without_rendering()  # lays it out: now names have a size on the axes
    for view in views:
        _write_names(view, hand, arrows, partial(on_paper, view))
    if flat is not None:
        _write_names(flat, hand, arrows, lambda points: 1e3 * projection.project(points))
    return figure


def _write_names(axis: Axes, hand: InSpace, arrows: tuple[Floats, Floats], drawn: Callable[[Floats], Floats]) -> None:
    """Names of pads beside them. drawn: from places (n, 3) in m to the axis' 2-D data coordinates."""
    pads = [np.flatnonzero(hand.pad == pad) for pad in np.unique(hand.pad)]
    shapes = [drawn(np.concatenate([hand.faces[taxel] for taxel in own])) for own in pads]
    along = np.concatenate([arrows[0] + share * arrows[1] for share in np.linspace(0.0, 1.0, 9)])
    write_names(axis, free_places(axis, shapes, hand.names, NAMES.points, drawn(along)), NAMES.points)


def _tints(hand: InSpace) -> list[str]:
    """Of each taxel, by its finger."""
    fingers = list(dict.fromkeys(finger(name) for name in hand.names))
    of_pad = [TINTS[fingers.index(finger(name)) % len(TINTS)] for name in hand.names]
    return [of_pad[number] for number in np.searchsorted(np.unique(hand.pad), hand.pad)]


def _draw_map(flat: Axes, hand: InSpace, projection: SphereMap) -> None:
    shapes = [1e3 * projection.project(face) for face in hand.faces]
    colours = [pale(tint) for tint in _tints(hand)]
    draw_taxels(flat, shapes, facecolor=colours, edgecolor=GREY, linewidth=0.4)
    flat.autoscale_view()
    flat.margins(0.08)
    flat.set_aspect("equal")
    flat.set_xlabel("x on the map in mm")
    flat.set_ylabel("y on the map in mm")
    flat.set_title("map")


def _arrows(field: SpaceField | None, extent_m: float) -> tuple[Floats, Floats]:
    """Places and vectors (n, 3), m, of the known arrows of a field on a hand of this extent."""
    if field is None:
        return np.empty((0, 3)), np.empty((0, 3))
    known = np.isfinite(field.vectors).all(axis=1)
    vectors = field.vectors[known]
    longest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
    return field.places[known], vectors * (ARROWS.space * extent_m / longest if longest > 0 else 0.0)


def _draw_arrows(flat: Axes, arrows: tuple[Floats, Floats], projection: SphereMap) -> None:
    """Arrows on the map, with their lengths in space."""
    on_map, carried = 1e3 * projection.project(arrows[0]), 1e3 * projection.carry(*arrows)
    look: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.007, "zorder": 5}
    flat.quiver(on_map[:, 0], on_map[:, 1], carried[:, 0], carried[:, 1], color=VERMILION, **look)
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
