"""Taxels of pads, groups and contacts as the flat arrays that all stages compute with.

Hand frame: the skin of the hand flattened to a plane; a pad's origin in it is `origin_m`, the direction of the pad's x
axis `angle_rad`. The frames of pads are defined in `pad_geometry`.

A group is a selection of taxels of one or more pads that gets a slip vector of its own: all stages after conditioning
handle it like a pad. They do the same with each separate contact of a pad: it owns an entry for every taxel of the pad,
and contact segmentation gives the pressure of a taxel to one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.geometry import transform
from taxelflow.sensors import triangulation
from taxelflow.sensors.pad_geometry import geometry_of, patch_taxels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.sensors.pad_geometry import PadGeometry
    from taxelflow.sensors.pads import Group, Pad

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Pads, then groups, then separate contacts, as flat arrays over their taxels.

    An entry is a taxel of a pad, group or contact. In the shapes below, `pads` counts pads, groups and contacts.

    taxels: number of taxels in a scan. pad_count: number of pads without groups and contacts.
    pads: names. contact_of: (pads,), number of the pad that a contact lies on; -1 for pads and groups.
    starts: (pads + 1,), pad p owns entries starts[p] to starts[p + 1].
    source: (entries,), taxel of the scan that an entry reads. Entries of pads come first, in the order of the scan, so
    that the number of such an entry is that of its taxel.
    shapes: (rows, cols) per pad. tables: (pads,), whether the taxels are given as a table.
    pitch_m: (pads, 2), distance between taxels along x and y; of a table the median distance to the nearest taxel.
    row, col: (entries,), cell in the pad's grid, or in the raster that shows a table.
    x_m, y_m: (entries,), position in the pad's frame. A group has shape, pitch and frame of its first pad; one that
    spans several pads has the hand frame.
    adjacent: (entries, 2, 2), number within the pad (of a group: within its patch) of the taxel next to it, [left,
    right] along x and [below, above] along y; -1 where there is none.
    border: (entries, 2), whether one of the two adjacent taxels along x, y is absent.
    T_hand: (pads, 3), pose x, y, theta (m, m, rad) of the pad's frame in the hand frame, NaN where unknown.
    delay_s: (entries,), time from the scan's time stamp to the reading of the taxel. area_m2: (entries,), of a taxel.
    place_m, normal: (entries, 3), position and outward unit normal in the hand's 3-D frame, NaN where the pad's `pose`
    is unknown or its link moves. stretch: (pads,), largest relative error of a distance between neighbours that
    flattening causes.
    unseen_error: of readings, see `Sensor`.
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
    adjacent: Indices
    T_hand: Floats
    delay_s: Floats
    area_m2: Floats
    place_m: Floats
    normal: Floats
    stretch: Floats
    unseen_error: float

    @property
    def entries(self) -> int:
        """Number of entries: a taxel counts once for its pad, and again for each group and contact that has it."""
        return len(self.source)

    @property
    def independent(self) -> Bools:
        """(pads,): groups, and pads that share no taxel with a group, so that no measurement is used twice.

        False for separate contacts, which do not belong to one rigid object.
        """
        groups = np.flatnonzero(self.contact_of[self.pad_count :] < 0) + self.pad_count
        grouped = np.zeros(self.taxels, dtype=np.bool_)
        for group in groups:
            grouped[self.source[self.of_pad(int(group))]] = True
        independent = self.contact_of < 0
        independent[: self.pad_count] = [not grouped[self.of_pad(pad)].any() for pad in range(self.pad_count)]
        return independent

    @property
    def full_grid(self) -> tuple[int, int] | None:
        """Rows and columns of a sensor whose only pad is a grid without gaps; None for others."""
        if self.pad_count != 1 or self.tables[0] or int(np.prod(self.shapes[0])) != self.taxels:
            return None
        return self.shapes[0]

    def of_pad(self, pad: int) -> slice:
        """Entries of pad, group or contact number `pad`; those of a pad are its taxels in the scan."""
        return slice(int(self.starts[pad]), int(self.starts[pad + 1]))

    def neighbours(self, pad: int) -> Indices:
        """(pairs, 2) taxels of a pad, numbered within it, that are adjacent in a row or a column.

        Of a table: edges of its triangulation (`triangulation.neighbours`).
        """
        own = self.of_pad(pad)
        if self.tables[pad]:
            xy = np.stack([self.x_m[own], self.y_m[own]], axis=1)
            return triangulation.neighbours(xy, float(self.pitch_m[pad, 0]))
        number = np.full(self.shapes[pad], -1)
        number[self.row[own], self.col[own]] = np.arange(own.stop - own.start)
        in_row = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
        in_column = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
        pairs = np.concatenate([in_row, in_column])
        return pairs[(pairs >= 0).all(axis=1)]

    def grid(self, pad: int, scan: Floats, fill: float = np.nan) -> Floats:
        """Image (rows, cols) of one pad from a scan (taxels,), row 0 on top; `fill` where there is no taxel."""
        image: Floats = np.full(self.shapes[pad], fill)
        own = self.of_pad(pad)
        image[self.row[own], self.col[own]] = scan[self.source[own]]
        return image


class _Part(NamedTuple):
    """Taxels of one pad that a pad, group or contact has.

    pad: number of the pad. chosen: (n,), numbers of the taxels within it. in_hand: whether they belong to a group
    across pads, so that positions are in the hand frame.
    """

    pad: int
    chosen: Indices
    in_hand: bool


def layout_of(
    pads: Sequence[Pad], groups: Sequence[Group], delay_s: Sequence[float], unseen_error: float = 0.0
) -> Layout:
    """Arrays of checked pads and groups. delay_s: (taxels,), or empty if all taxels are read at once."""
    geometries = [geometry_of(pad) for pad in pads]
    first = np.concatenate([[0], np.cumsum([pad.count for pad in pads])]).astype(np.int64)
    contacts = [(name, number) for number, pad in enumerate(pads) for name in pad.contact_names]
    owners = _parts_by_owner(pads, groups, [number for _, number in contacts])
    parts = [part for owner in owners for part in owner]
    leaders = [owner[0] for owner in owners]
    T_hand_pad = np.array([_pose_in_hand(pad, alone=len(pads) == 1) for pad in pads])
    xy = np.concatenate([_positions(geometries[part.pad], T_hand_pad[part.pad], part) for part in parts])
    source = np.concatenate([first[part.pad] + part.chosen for part in parts])
    adjacent = np.concatenate([_adjacent(geometries[part.pad], part.chosen) for part in parts])
    pose_known = [pad.link is None and (len(pads) == 1 or pad.pose is not None) for pad in pads]

    def of_entries(field: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(geometries[part.pad], field)[part.chosen] for part in parts])

    in_space = np.concatenate([np.full(len(part.chosen), pose_known[part.pad]) for part in parts])[:, np.newaxis]
    return Layout(
        taxels=int(first[-1]),
        pad_count=len(pads),
        pads=(*(pad.name for pad in pads), *(group.name for group in groups), *(name for name, _ in contacts)),
        contact_of=np.array([-1] * (len(pads) + len(groups)) + [number for _, number in contacts]),
        shapes=tuple(geometries[part.pad].shape for part in leaders),
        tables=np.array([geometries[part.pad].table for part in leaders]),
        source=source,
        starts=np.cumsum([0, *(sum(len(part.chosen) for part in owner) for owner in owners)]).astype(np.int64),
        pitch_m=np.array([geometries[part.pad].pitch_m for part in leaders]),
        row=of_entries("row").astype(np.int64),
        col=of_entries("col").astype(np.int64),
        x_m=np.ascontiguousarray(xy[:, 0]),
        y_m=np.ascontiguousarray(xy[:, 1]),
        border=np.any(adjacent < 0, axis=2),
        adjacent=adjacent,
        T_hand=np.array([np.zeros(3) if part.in_hand else T_hand_pad[part.pad] for part in leaders]),
        delay_s=np.array(delay_s if len(delay_s) else [0.0] * int(first[-1]), dtype=np.float64)[source],
        area_m2=of_entries("area_m2"),
        place_m=np.where(in_space, of_entries("place_m"), np.nan),
        normal=np.where(in_space, of_entries("normal"), np.nan),
        stretch=np.array([geometries[part.pad].stretch for part in leaders]),
        unseen_error=unseen_error,
    )


def _parts_by_owner(pads: Sequence[Pad], groups: Sequence[Group], contact_of: Sequence[int]) -> list[list[_Part]]:
    """Parts of each pad, then of each group, then of each contact. contact_of: the contacts' pads."""
    numbers = {pad.name: number for number, pad in enumerate(pads)}
    whole = [[_Part(number, np.arange(pad.count), in_hand=False)] for number, pad in enumerate(pads)]
    of_groups = []
    for group in groups:
        across = len({patch.pad for patch in group.patches}) > 1
        of_groups.append(
            [
                _Part(numbers[patch.pad], patch_taxels(patch, pads[numbers[patch.pad]]), in_hand=across)
                for patch in group.patches
            ]
        )
    return [*whole, *of_groups, *(whole[number] for number in contact_of)]


def _positions(geometry: PadGeometry, T_hand_pad: Floats, part: _Part) -> Floats:
    xy: Floats = geometry.xy[part.chosen]
    return transform(T_hand_pad, xy) if part.in_hand else xy


def _pose_in_hand(pad: Pad, *, alone: bool) -> tuple[float, float, float]:
    """Pose of the pad in the hand frame; NaN without an origin, but the only pad of a sensor is its hand."""
    unknown = 0.0 if alone else float("nan")
    return (*(pad.origin_m or (unknown, unknown)), pad.angle_rad)


def _adjacent(geometry: PadGeometry, chosen: Indices) -> Indices:
    """(chosen, 2, 2): which of the chosen taxels lies next to each, left, right, below, above; -1 where none does."""
    if geometry.table:
        return triangulation.adjacent(geometry.xy[chosen], geometry.pitch_m[0])
    number = np.full((geometry.shape[0] + 2, geometry.shape[1] + 2), -1)
    row, col = geometry.row[chosen] + 1, geometry.col[chosen] + 1
    number[row, col] = np.arange(len(chosen))
    along_x = np.stack([number[row, col - 1], number[row, col + 1]], axis=1)
    return np.stack([along_x, np.stack([number[row + 1, col], number[row - 1, col]], axis=1)], axis=1)
