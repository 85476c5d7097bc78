"""Positions of the taxels in the scene: in space, on the hand laid flat, or beside it.

If all pads have a pose in space, they are drawn there (`articulation` moves those on links); otherwise on the hand laid
flat. A pad with neither is drawn below the others, upright and labelled: pads of one finger, by their names, above one
another, or all in rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.numerics.geometry import rotation, transform
from taxelflow.publish.view.look import CAMERA, ROOM

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import Axes
    from taxelflow.sensors.layout import Layout

IN_SPACE, LAID_FLAT, IN_A_ROW, ON_LINKS = range(4)
WORDS = ("with a pose in space", "laid flat", "set out: their places are not known", "on the links of the hand's model")
"""How the view describes the place of a pad."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Pads (without groups and contacts) in the scene, m.

    place, normal: (taxels, 3). tangent: (taxels, 3, 2), maps a small motion in the pad's frame at a taxel to the
    scene. how: (pads,), index in WORDS. box: (2, 3), corners of all taxels.
    """

    place: Floats
    normal: Floats
    tangent: Floats
    how: tuple[int, ...]
    box: Floats

    @property
    def flat(self) -> bool:
        """Whether all pads have a place on the hand laid flat, so that the object's motion over it can be drawn."""
        return all(how == LAID_FLAT for how in self.how)

    @property
    def spatial(self) -> bool:
        """Whether the pads stand in space, in any direction."""
        return self.how[0] in (IN_SPACE, ON_LINKS)

    @property
    def closed(self) -> bool:
        """Whether the pads face all directions, as around an object."""
        return self.how[0] == IN_SPACE and bool(np.linalg.norm(self.normal.mean(axis=0)) < CAMERA.front_mean_normal)

    @property
    def size_m(self) -> float:
        """Largest extent of the hand."""
        return float(np.ptp(self.box, axis=0).max())


def placed(layout: Layout) -> Placement:
    """Positions of the pads of a layout."""
    count, taxels = layout.pad_count, layout.taxels
    pads = [layout.of_pad(pad) for pad in range(count)]
    xy = np.stack([layout.x_m[:taxels], layout.y_m[:taxels]], axis=1)
    place, normal = layout.place_m[:taxels].copy(), layout.normal[:taxels].copy()
    plane = count == 1 and not layout.tables[0]
    if not plane and np.isfinite(place).all():
        tangent = np.concatenate([tangents(xy[own], place[own], layout.pitch_m[pad]) for pad, own in enumerate(pads)])
        return Placement(place, normal, tangent, (IN_SPACE,) * count, corners_of(place, layout))
    T_scene_pad = layout.T_hand[:count].copy()
    how = tuple(LAID_FLAT if np.isfinite(T).all() else IN_A_ROW for T in T_scene_pad)
    _set_out(T_scene_pad, layout.pads, [xy[own] for own in pads], layout.pitch_m[:count])
    each = np.repeat(T_scene_pad, [own.stop - own.start for own in pads], axis=0)
    place[:, :2], place[:, 2] = transform(each, xy), 0.0
    normal[:] = 0.0, 0.0, 1.0
    tangent = np.zeros((taxels, 3, 2))
    tangent[:, :2] = rotation(each[:, 2])
    return Placement(place, normal, tangent, how, corners_of(place, layout))


def spots_of(layout: Layout, placement: Placement, radius_m: float) -> tuple[Floats, list[str]]:
    """(pads, 3), where a mark of this radius stands beside each pad laid flat, and how its name is anchored there.

    Below the pad, or to its right if another pad is below.
    """
    pads = [placement.place[layout.of_pad(pad)] for pad in range(layout.pad_count)]
    low, high = np.array([own.min(axis=0) for own in pads]), np.array([own.max(axis=0) for own in pads])
    away = 0.75 * layout.pitch_m[: layout.pad_count].max(axis=1) + 1.6 * radius_m
    spots, anchors = (low + high) / 2, []
    wide, tall = 0.5 * ROOM.name[0] * placement.size_m, ROOM.name[1] * placement.size_m
    for pad, here in enumerate(spots):
        left, right = here[0] - wide, here[0] + wide
        bottom, top = low[pad, 1] - away[pad] - tall, low[pad, 1] - away[pad]
        covered = (low[:, 0] < right) & (high[:, 0] > left) & (low[:, 1] < top) & (high[:, 1] > bottom)
        covered[pad] = False
        if covered.any():
            here[0] = high[pad, 0] + away[pad]
            anchors.append("center-left")
        else:
            here[1] = low[pad, 1] - away[pad]
            anchors.append("top-center")
    return spots, anchors


def spots_in_space(layout: Layout, placement: Placement, radius_m: float, axes: Axes) -> tuple[Floats, list[str]]:
    """As `spots_of`, of pads in space: in their planes, beyond the edge that is lowest in a picture with these axes, so
    that they lie beside the taxels for every view of the skin; two in one place beside each other.
    """
    frame = np.stack(axes, axis=1)
    spots = np.array([_below(layout, placement, pad, radius_m, axes) @ frame for pad in range(layout.pad_count)])
    anchors = ["top-center"] * layout.pad_count
    room = 0.65 * np.array(ROOM.name) * placement.size_m  # nearer marks would cover each other
    for pad, here in enumerate(spots):
        near = np.flatnonzero((np.abs(spots[:pad, :2] - here[:2]) < room).all(axis=1))
        if len(near):
            here[:2] = spots[near[0], :2]
            spots[near[0], 0] -= 1.5 * radius_m
            here[0] += 1.5 * radius_m
            anchors[near[0]], anchors[pad] = "center-right", "center-left"
    return spots @ frame.T, anchors


def _below(layout: Layout, placement: Placement, pad: int, radius_m: float, axes: Axes) -> Floats:
    """(3,), in a pad's plane, beyond its edge that is lowest in the picture."""
    own = layout.of_pad(pad)
    place = placement.place[own]
    middle = (place.min(axis=0) + place.max(axis=0)) / 2
    across = placement.tangent[own].mean(axis=0).T
    ways = np.concatenate([across, -across]) / np.linalg.norm(np.tile(across, (2, 1)), axis=1, keepdims=True)
    far = ((place - middle) @ ways.T).max(axis=0) + 0.75 * float(layout.pitch_m[pad].max()) + 2.5 * radius_m
    spots = middle + far[:, np.newaxis] * ways
    found: Floats = spots[int(np.argmin(spots @ axes.up))]
    return found


def _set_out(T_scene_pad: Floats, names: tuple[str, ...], pads: list[Floats], pitch_m: Floats) -> None:
    """Fill in the pads without a pose (NaN): in stacks below the others, from left to right."""
    missing = [int(pad) for pad in np.flatnonzero(~np.isfinite(T_scene_pad).all(axis=1))]
    if not missing:
        return
    gap, between = ROOM.gap * float(pitch_m.max()), ROOM.between * float(pitch_m.max())
    known = [transform(T, pads[pad]) for pad, T in enumerate(T_scene_pad) if np.isfinite(T).all()]
    left = float(np.concatenate(known)[:, 0].min()) if known else 0.0
    top = float(np.concatenate(known)[:, 1].min()) - between if known else 0.0
    sizes = {pad: np.ptp(pads[pad], axis=0) + pitch_m[pad] for pad in missing}
    stacks = _stacks(names, missing)
    wide = [max(sizes[pad][0] for pad in stack) + gap for stack in stacks]
    high = [sum(sizes[pad][1] + between for pad in stack) for stack in stacks]
    width = max(np.sqrt(ROOM.wide * sum(wide) * max(high)), *wide)
    right, tallest = left, 0.0
    for number, stack in enumerate(stacks):
        if right > left and right + wide[number] - left > width:
            right, top, tallest = left, top - tallest, 0.0
        below = top
        for pad in stack:
            corner = pads[pad].min(axis=0) - pitch_m[pad] / 2
            spare = (wide[number] - gap - sizes[pad][0]) / 2
            T_scene_pad[pad] = right + spare - corner[0], below - sizes[pad][1] - corner[1], 0.0
            below -= sizes[pad][1] + between
        right, tallest = right + wide[number] + gap, max(tallest, high[number])


def _stacks(names: tuple[str, ...], pads: list[int]) -> list[list[int]]:
    """Pads that are shown above one another: those whose names begin alike (thumb_tip, thumb_palm), if most do."""
    stacks: dict[str, list[int]] = {}
    for pad in pads:
        stacks.setdefault(names[pad].partition("_")[0], []).append(pad)
    alike = 2 * len(stacks) <= len(pads)
    return list(stacks.values()) if alike else [[pad] for pad in pads]


def tangents(xy: Floats, place: Floats, pitch_m: Floats) -> Floats:
    """(taxels, 3, 2): derivative of the place in space by the place on the flattened pad, from the taxels near it."""
    found = np.empty((len(xy), 3, 2))
    for taxel, here in enumerate(xy):
        apart = xy - here
        order = np.argsort(np.hypot(*apart.T))
        near = max(4, int((np.hypot(*apart.T) < ROOM.near * pitch_m.max()).sum()))
        own = order[:near]
        found[taxel] = np.linalg.lstsq(apart[own], place[own] - place[taxel], rcond=None)[0].T
    return found


def corners_of(place: Floats, layout: Layout) -> Floats:
    """(2, 3), corners of the box around taxels at places (taxels, 3)."""
    half = float(layout.pitch_m[: layout.pad_count].max()) / 2
    return np.stack([place.min(axis=0) - half, place.max(axis=0) + half])
