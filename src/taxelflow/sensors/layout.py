"""Taxels of pads and groups as the arrays that the stages compute with.

Pad frame of a grid: row 0 is the top row, column 0 the left; x to the right along columns, y up (towards row 0),
z out of the skin; origin at the grid's centre. Taxels run pad by pad, row-major, missing ones left out. Pad frame of a
table: if it is flat and has no normals, its own; else the map of `chart`, origin at the mean of its taxels.

Hand frame: the hand's skin laid flat, as on a map; a pad's place on it is `origin_m` and `angle_rad`. A group is a
choice of taxels of one or more pads that gets a slip vector of its own: to all that follows conditioning it is one
more pad. So is each of the contacts of a pad that are told apart: all of the pad's taxels, of which conditioning
leaves it those that are its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taxelflow.geometry import place, swing
from taxelflow.messages import Bools, Floats
from taxelflow.sensors import triangulation as mesh
from taxelflow.sensors.flattening import lay_flat

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.sensors.pads import Group, Pad, Patch

Indices = NDArray[np.int64]

_CLOSEST = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Pads, after them groups, and then contacts that are told apart, as flat arrays over their taxels.

    taxels: how many a scan has. source: (entries,), the taxel of the scan that an entry reads; a group's entries come
    after those of all pads, so for pads an entry's number is its taxel's. pads: names of pads, groups and contacts, the
    first pad_count of which are pads; contact_of: (pads,), the pad whose contact it is, -1 for pads and groups.
    starts: (pads + 1,), pad p owns entries starts[p] to starts[p + 1]. row, col: (entries,) place in
    the pad's grid, of a table on its raster. x_m, y_m: (entries,) place in the pad's frame. beside: (entries, 2, 2),
    number within the pad (of a group: within the patch) of the next taxel to the left, right (x), below, above (y), -1
    where none is. border: (entries, 2), one of the two is not there. shapes: (rows, cols) per pad. tables: (pads,),
    given as a table. pitch_m: (pads, 2), of a table the median distance to the nearest taxel. T_hand: (pads, 3) pose
    of the pad's frame in the hand, NaN where unknown. A group has shape and pitch of its first pad, and its frame
    unless it spans several: then that of the hand. delay_s: (entries,), when in a scan a taxel is read.
    area_m2: (entries,), of a taxel. place_m, normal: (entries, 3), place in space and direction out of the skin, in the
    hand's 3-D frame, NaN where the pad's `pose` is unknown. stretch: (pads,), how much laying flat changes a distance
    between near neighbours at most, relative.
    """

    taxels: int
    pad_count: int
    pads: tuple[str, ...]
    contact_of: Indices
    shapes: tuple[tuple[int, int], ...]
    tables: Bools
    source: Indices
    starts: Indices
    pitch_m: Floats
    row: Indices
    col: Indices
    x_m: Floats
    y_m: Floats
    border: Bools
    beside: Indices
    T_hand: Floats
    delay_s: Floats
    area_m2: Floats
    place_m: Floats
    normal: Floats
    stretch: Floats

    @property
    def entries(self) -> int:
        """Taxels of all pads, groups and contacts, those of the latter two counted again."""
        return len(self.source)

    @property
    def apart(self) -> Bools:
        """(pads,): groups, and pads that no group takes taxels from: no taxel counts as pad and as group. No contact,
        for those that are told apart belong to no one rigid object.
        """
        groups = np.flatnonzero(self.contact_of[self.pad_count :] < 0) + self.pad_count
        grouped = np.zeros(self.taxels, dtype=np.bool_)
        for group in groups:
            grouped[self.source[self.of_pad(int(group))]] = True
        apart = self.contact_of < 0
        apart[: self.pad_count] = [not grouped[self.of_pad(pad)].any() for pad in range(self.pad_count)]
        return apart

    def of_pad(self, pad: int) -> slice:
        """Entries of pad, group or contact number `pad`; for a pad these are its taxels in the scan."""
        return slice(int(self.starts[pad]), int(self.starts[pad + 1]))

    def neighbours(self, pad: int) -> Indices:
        """(pairs, 2) taxels of a pad, numbered within it, that lie side by side in a row or a column.

        Of a table: edges of its triangulation (`mesh.neighbours`).
        """
        own = self.of_pad(pad)
        if self.tables[pad]:
            xy = np.stack([self.x_m[own], self.y_m[own]], axis=1)
            return mesh.neighbours(xy, float(self.pitch_m[pad, 0]))
        number = np.full(self.shapes[pad], -1)
        number[self.row[own], self.col[own]] = np.arange(own.stop - own.start)
        across = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
        down = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
        pairs = np.concatenate([across, down])
        return pairs[(pairs >= 0).all(axis=1)]

    def grid(self, pad: int, scan: Floats, fill: float = np.nan) -> Floats:
        """One pad of a scan (taxels,) or (entries,) as (rows, cols), row 0 on top; `fill` where no taxel is."""
        image: Floats = np.full(self.shapes[pad], fill)
        own = self.of_pad(pad)
        image[self.row[own], self.col[own]] = scan[self.source[own]]
        return image


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """One pad's taxels, (taxels,) or (taxels, ...), as `Layout` has them."""

    row: Indices
    col: Indices
    shape: tuple[int, int]
    xy: Floats
    pitch_m: tuple[float, float]
    area_m2: Floats
    place_m: Floats
    normal: Floats
    table: bool = False
    stretch: float = 0.0


@cache
def skin_of(pad: Pad) -> Skin:
    """A pad's taxels. Raises ValueError, saying what is wrong, if a table can be no pad."""
    skin = _table(pad) if pad.is_table else _grid(pad)
    if pad.pose is None:
        return skin
    pose = np.array(pad.pose)
    places, normal = swing(pose[3:], skin.place_m) + pose[:3], swing(pose[3:], skin.normal)
    return replace(skin, place_m=places, normal=normal)


def _grid(pad: Pad) -> Skin:
    if pad.pitch_m is None:
        raise ValueError("a grid needs its pitch")
    row, col = np.nonzero(present_of(pad))
    x = (col - (pad.cols - 1) / 2) * pad.pitch_m[0]
    y = ((pad.rows - 1) / 2 - row) * pad.pitch_m[1]
    xy, flat = np.stack([x, y], axis=1), np.zeros(len(x))
    outwards = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    places = np.stack([x, y, flat], axis=1)
    return Skin(row, col, (pad.rows, pad.cols), xy, pad.pitch_m, _areas(pad, pad.pitch_m), places, outwards)


def _table(pad: Pad) -> Skin:
    table = np.array(pad.taxels, dtype=np.float64)
    if table.shape[1] == 2:
        xy, stretch = table, 0.0
        places = np.column_stack([table, np.zeros(len(table))])
        normal = np.tile([0.0, 0.0, 1.0], (len(table), 1))
    else:
        places, normal = table[:, :3], table[:, 3:]
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        chart = lay_flat(places, normal)
        xy, stretch = chart.xy, chart.stretch
    if len(xy) == 1 and pad.pitch_m is None:
        raise ValueError("a single taxel has no neighbour to tell the pitch from: give pitch_m = [x, y]")
    if mesh.closest_m(xy) < _CLOSEST * max(float(np.ptp(xy, axis=0).max()), 1e-3):
        raise ValueError("two taxels lie at the same place, or closer than a thousandth of the pad: mend the table")
    pitch = pad.pitch_m or (mesh.spacing_m(xy),) * 2
    row, col, shape = mesh.raster(xy)
    return Skin(row, col, shape, xy, pitch, _areas(pad, pitch), places, normal, table=True, stretch=stretch)


def _areas(pad: Pad, pitch_m: tuple[float, float]) -> Floats:
    area = pad.area_m2 if pad.area_m2 is not None else pitch_m[0] * pitch_m[1]
    return np.broadcast_to(np.asarray(area, dtype=np.float64), pad.count)


def layout_of(pads: Sequence[Pad], groups: Sequence[Group], delay_s: Sequence[float]) -> Layout:
    """Arrays of checked pads and groups. delay_s: (taxels,), or empty if all taxels are read at once."""
    numbers = {pad.name: number for number, pad in enumerate(pads)}
    skins = [skin_of(pad) for pad in pads]
    first = np.concatenate([[0], np.cumsum([pad.count for pad in pads])]).astype(np.int64)
    zones = [[(number, np.arange(pad.count))] for number, pad in enumerate(pads)]
    zones += [[(numbers[patch.pad], chosen_of(patch, pads[numbers[patch.pad]])) for patch in g.patches] for g in groups]
    told = [(name, number) for number, pad in enumerate(pads) for name in pad.contact_names]
    zones += [[(number, np.arange(pads[number].count))] for _, number in told]
    homes = np.array([_home(pad, alone=len(pads) == 1) for pad in pads])
    wide = [len({number for number, _ in zone}) > 1 for zone in zones]  # across pads: everything in the hand frame
    parts = [(number, chosen, across) for zone, across in zip(zones, wide, strict=True) for number, chosen in zone]
    xy = [skins[n].xy[chosen] if not across else place(homes[n], skins[n].xy[chosen]) for n, chosen, across in parts]
    xy_all, source = np.concatenate(xy), np.concatenate([first[n] + chosen for n, chosen, _ in parts])
    leaders = [zone[0][0] for zone in zones]
    known = [len(pads) == 1 or pad.pose is not None for pad in pads]

    beside = np.concatenate([_beside(skins[n], chosen) for n, chosen, _ in parts])

    def of_parts(field: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(skins[n], field)[chosen] for n, chosen, _ in parts])

    def in_space(field: str) -> Floats:
        arrays = [getattr(skins[n], field)[chosen] for n, chosen, _ in parts]
        return np.concatenate([a if known[part[0]] else a * np.nan for a, part in zip(arrays, parts, strict=True)])

    return Layout(
        taxels=int(first[-1]),
        pad_count=len(pads),
        pads=(*numbers, *(group.name for group in groups), *(name for name, _ in told)),
        contact_of=np.array([-1] * (len(pads) + len(groups)) + [number for _, number in told]),
        shapes=tuple(skins[n].shape for n in leaders),
        tables=np.array([skins[n].table for n in leaders]),
        source=source,
        starts=np.cumsum([0, *(sum(len(chosen) for _, chosen in zone) for zone in zones)]).astype(np.int64),
        pitch_m=np.array([skins[n].pitch_m for n in leaders]),
        row=of_parts("row").astype(np.int64),
        col=of_parts("col").astype(np.int64),
        x_m=np.ascontiguousarray(xy_all[:, 0]),
        y_m=np.ascontiguousarray(xy_all[:, 1]),
        border=np.any(beside < 0, axis=2),
        beside=beside,
        T_hand=np.array([np.zeros(3) if across else homes[n] for n, across in zip(leaders, wide, strict=True)]),
        delay_s=np.array(delay_s if len(delay_s) else [0.0] * int(first[-1]), dtype=np.float64)[source],
        area_m2=of_parts("area_m2"),
        place_m=in_space("place_m"),
        normal=in_space("normal"),
        stretch=np.array([skins[n].stretch for n in leaders]),
    )


def _home(pad: Pad, *, alone: bool) -> tuple[float, float, float]:
    """T_hand_pad. Without an origin it is unknown, but the only pad of a sensor is its hand."""
    unknown = 0.0 if alone else float("nan")
    return (*(pad.origin_m or (unknown, unknown)), pad.angle_rad)


def present_of(pad: Pad) -> Bools:
    """(rows, cols) of a grid, True where a taxel is."""
    there = np.ones((pad.rows, pad.cols), dtype=np.bool_)
    for row, col in pad.missing:
        there[row, col] = False
    return there


def chosen_of(patch: Patch, pad: Pad) -> Indices:
    """Numbers, within the pad, of a patch's taxels."""
    if patch.taxels:
        return np.array(patch.taxels, dtype=np.int64)
    if pad.is_table:
        return np.arange(pad.count)
    row, col = np.nonzero(present_of(pad))
    rows, cols = patch.rows or (0, pad.rows - 1), patch.cols or (0, pad.cols - 1)
    inside = (row >= rows[0]) & (row <= rows[1]) & (col >= cols[0]) & (col <= cols[1])
    return np.flatnonzero(inside)


def _beside(skin: Skin, chosen: Indices) -> Indices:
    """(chosen, 2, 2): which of the chosen taxels is the next to the left, right, below, above; -1 where none is."""
    if skin.table:
        return mesh.beside(skin.xy[chosen], skin.pitch_m[0])
    number = np.full((skin.shape[0] + 2, skin.shape[1] + 2), -1)
    row, col = skin.row[chosen] + 1, skin.col[chosen] + 1
    number[row, col] = np.arange(len(chosen))
    across = np.stack([number[row, col - 1], number[row, col + 1]], axis=1)
    return np.stack([across, np.stack([number[row + 1, col], number[row - 1, col]], axis=1)], axis=1)
