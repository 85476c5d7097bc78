"""Checks of a sensor file beyond its syntax; each error names file, table and field."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import dist, hypot, isfinite, tau
from typing import TYPE_CHECKING

from taxelflow.errors import SensorFileInvalid
from taxelflow.sensors.flattening import MOST_CURVED
from taxelflow.sensors.pad_geometry import geometry_of, patch_taxels
from taxelflow.sensors.pads import MOST, MOST_NUMBERS, MOST_TAXELS
from taxelflow.sensors.schema import ROWS, SCHEMA
from taxelflow.sensors.triangulation import spacing_m

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from taxelflow.sensors.pads import Group, Pad, Patch


@dataclass(frozen=True, slots=True)
class _Largest:
    """The largest that a sensor file may hold: lengths (more is in another unit), and errors of unit vectors."""

    normal_error: float = 0.01
    """Largest error of a normal's length: tables are rounded to a few digits."""
    quaternion_error: float = 1e-3
    """Largest error of a quaternion's length."""
    pitch_m: float = 0.2
    """Largest pitch of a pad: a mat to walk on has less; more is a pitch in mm."""
    hand_m: float = 10.0
    """Largest distance of a pad from the hand's origin: more is one in mm."""


_LARGEST = _Largest()
_CURVED_NUMBERS = 6
"""Numbers in a row of a table with normals."""
_GRID_FIELDS = ("rows", "cols", "missing")


def pad_at(number: int, name: str) -> str:
    """Position of a pad in its file, for errors; number counts from 1."""
    return f"table [[pads]] number {number} ({name})"


def check_shear(axes: int, normal: str, shear: tuple[str, str], source: str) -> None:
    """Check that two axes of three lie in the skin. Raises SensorFileInvalid."""
    if axes != 3 or {normal, *(axis[-1] for axis in shear)} != set("xyz"):
        seen = f"{list(shear)} of {axes} axes, normal {normal}"
        remedy = 'set axes = 3, and name the two axes that are not normal, as in ["x", "-y"]'
        raise SensorFileInvalid(source, "top level, field shear", seen, remedy)


def check_sizes(pads: Sequence[Pad], groups: Sequence[Group], source: str) -> None:
    """Check what memory and time the layout takes before it is computed. Raises SensorFileInvalid."""
    taxels = sum(max(0, pad.count) for pad in pads)
    if taxels > MOST_TAXELS:
        seen = f"{taxels} taxels, and a sensor has at most {MOST_TAXELS}"
        raise SensorFileInvalid(source, "tables [[pads]]", seen, "leave out pads, or describe them in several files")
    curved = sum(pad.count**2 for pad in pads if pad.is_table and len(pad.taxels[0]) == _CURVED_NUMBERS)
    if curved > MOST_CURVED**2:
        seen = f"curved pads whose squared numbers of taxels add up to {curved}, and may to {MOST_CURVED}^2"
        raise SensorFileInvalid(source, "tables [[pads]]", seen, "describe fewer curved pads, or split them")
    by_name = {pad.name: pad for pad in pads}
    patches = [patch for group in groups for patch in group.patches]
    entries = sum(max(0, pad.count) * (1 + len(pad.contact_names)) for pad in pads)
    entries += sum(_largest(patch, by_name.get(patch.pad)) for patch in patches)
    if entries > MOST_NUMBERS or len(patches) > 4 * MOST.pads:
        seen = f"{entries} taxels of pads, groups and contacts in {len(patches)} patches"
        remedy = f"a layout has at most {MOST_NUMBERS} of them and {4 * MOST.pads} patches: declare fewer groups"
        raise SensorFileInvalid(source, "tables [[groups]]", seen, remedy)


def _largest(patch: Patch, pad: Pad | None) -> int:
    """Taxels of a patch at most; 0 for an unknown pad, which is another error."""
    if pad is None or patch.taxels or pad.is_table:
        return len(patch.taxels) or (pad.count if pad else 0)
    (top, bottom), (left, right) = patch.rows or (0, pad.rows - 1), patch.cols or (0, pad.cols - 1)
    return min(pad.count, max(0, bottom - top + 1) * max(0, right - left + 1))


def check_pads(pads: Sequence[Pad], source: str) -> None:
    """Check each pad by itself. Raises SensorFileInvalid for the first that is invalid."""
    for number, pad in enumerate(pads, 1):
        for field, seen, remedy in (*(_of_table(pad) if pad.is_table else _of_grid(pad)), *_of_any(pad)):
            raise SensorFileInvalid(source, f"{pad_at(number, pad.name)}, field {field}", seen, remedy)
        where = f"{pad_at(number, pad.name)}, field taxels"
        try:
            geometry = geometry_of(pad)
        except ValueError as error:
            seen, _, remedy = str(error).partition(": ")
            raise SensorFileInvalid(source, where, seen, remedy) from error
        apart_m = spacing_m(geometry.xy) if geometry.table and pad.count > 1 else 0.0
        if apart_m > _LARGEST.pitch_m:
            raise SensorFileInvalid(source, where, *_too_far(apart_m))


def _too_far(apart_m: float) -> tuple[str, str]:
    """What was seen of taxels whose distance is not in m, and what to do."""
    return f"{apart_m:g} m between taxels", "give it in m: 4 mm are 0.004"


def _of_grid(pad: Pad) -> Iterator[tuple[str, str, str]]:
    """Errors of a grid: field, what was seen, what to do."""
    for field in ("rows", "cols"):
        if not getattr(pad, field):
            yield field, "it is missing or 0", SCHEMA
    if pad.pitch_m is None:
        yield "pitch_m", "it is missing", SCHEMA
    for row, col in pad.missing:
        if row >= pad.rows or col >= pad.cols:
            seen = f"[{row}, {col}] is outside {pad.rows} rows and {pad.cols} cols"
            yield "missing", seen, "count rows and cols from 0"
    if len(set(pad.missing)) != len(pad.missing):
        yield "missing", "a cell is listed twice", "list each cell once"
    if len(pad.missing) == pad.rows * pad.cols:
        yield "missing", "no taxel is left", "a pad has at least one taxel"
    if pad.channels not in (None, pad.count, pad.rows * pad.cols) and not pad.index:
        seen = f"{pad.channels} numbers for {pad.count} taxels in {pad.rows * pad.cols} cells"
        yield "channels", seen, "give the number of taxels or of cells, or an index for each taxel"


def _of_table(pad: Pad) -> Iterator[tuple[str, str, str]]:
    """Errors of a table, as `_of_grid`."""
    for field in _GRID_FIELDS:
        if getattr(pad, field):
            yield field, "given beside a table of taxels", "a pad is a grid or a table, not both"
    if pad.order != "row-major" or pad.first != "top-left":
        yield "order and first", "given beside a table of taxels", "give an index instead"
    rows = [row for row in pad.taxels if not isinstance(row, str)]
    widths = Counter(len(row) for row in rows)
    if len(widths) > 1 or not set(widths) <= {2, 6}:
        seen = f"rows have {', '.join(map(str, sorted(widths)))} numbers"
        yield "taxels", seen + (", a position without a normal" if set(widths) == {3} else ""), ROWS
    elif 6 in widths:
        length = min((dist(row[3:], (0.0, 0.0, 0.0)) for row in rows), key=lambda long: -abs(long - 1.0))
        if length == 0.0:
            yield "taxels", "a normal is 0, 0, 0", "leave out absent taxels, and give the others an index"
        elif abs(length - 1.0) > _LARGEST.normal_error:
            yield "taxels", f"a normal has length {length:.3g}", "its length must be 1: check the order of the columns"
    if pad.channels not in (None, pad.count) and not pad.index:
        seen = f"{pad.channels} numbers for {pad.count} taxels"
        yield "channels", seen, "give the index of each taxel among them"


def _of_any(pad: Pad) -> Iterator[tuple[str, str, str]]:
    """Errors of any pad, as `_of_grid`."""
    if pad.pitch_m is not None and max(pad.pitch_m) > _LARGEST.pitch_m:
        yield "pitch_m", *_too_far(max(pad.pitch_m))
    if pad.origin_m is not None and hypot(*pad.origin_m) > _LARGEST.hand_m:
        yield "origin_m", f"{hypot(*pad.origin_m):g} m from the hand's origin", "give it in m: 40 mm are 0.04"
    if abs(pad.angle_rad) > tau:
        yield "angle_rad", f"{pad.angle_rad:g} rad", "give it in rad, from -6.28 to 6.28: 90 deg are 1.571"
    if isinstance(pad.area_m2, tuple) and len(pad.area_m2) != pad.count:
        yield "area_m2", f"{len(pad.area_m2)} areas for {pad.count} taxels", "give one for all, or one per taxel"
    if pad.index and len(pad.index) != pad.count:
        yield "index", f"{len(pad.index)} numbers for {pad.count} taxels", "give one per taxel"
    if pad.index and (pad.order != "row-major" or pad.first != "top-left"):
        yield "index", "given beside order or first", "give one of them"
    if pad.pose is not None:
        if hypot(*pad.pose[:3]) > _LARGEST.hand_m:
            yield "pose", f"{hypot(*pad.pose[:3]):g} m from the frame's origin", "give x, y, z in m: 40 mm are 0.04"
        length = dist(pad.pose[3:], (0.0, 0.0, 0.0, 0.0))
        if not isfinite(length) or abs(length - 1.0) > _LARGEST.quaternion_error:
            yield (
                "pose",
                f"quaternion of length {length:.3g}",
                "give x, y, z in m, then qx, qy, qz, qw of length 1",
            )


def check_groups(groups: Sequence[Group], pads: Sequence[Pad], source: str) -> None:
    """Check names and groups. Raises SensorFileInvalid for a repeated name and for the first invalid group."""
    contacts = [name for pad in pads for name in pad.contact_names]
    for name, times in Counter([pad.name for pad in pads] + [group.name for group in groups] + contacts).items():
        if times > 1:
            where, seen = "tables [[pads]] and [[groups]], field name", f"{name!r} is used {times} times"
            remedy = "give each pad and group a name of its own" + (", unlike a contact's" if name in contacts else "")
            raise SensorFileInvalid(source, where, seen, remedy)
    known = {pad.name: pad for pad in pads}
    for number, group in enumerate(groups, 1):
        where = f"table [[groups]] number {number} ({group.name}), field patches"
        for patch in group.patches:
            for seen, remedy in _of_patch(patch, known):
                raise SensorFileInvalid(source, where, seen, remedy)
        members = {patch.pad for patch in group.patches}
        if len(members) > 1 and any(known[name].origin_m is None for name in members):
            seen = "the group spans pads whose position in the hand is unknown"
            raise SensorFileInvalid(source, where, seen, "give those pads origin_m = [x, y] and angle_rad")


def _of_patch(patch: Patch, pads: dict[str, Pad]) -> Iterator[tuple[str, str]]:
    """Errors of a patch: what was seen, what to do."""
    pad = pads.get(patch.pad)
    if pad is None:
        yield f"unknown pad {patch.pad!r}", f"the pads are {', '.join(pads)}"
        return
    spans = [(name, span) for name, span in (("rows", patch.rows), ("cols", patch.cols)) if span is not None]
    if spans and (pad.is_table or patch.taxels):
        yield f"{spans[0][0]} of {patch.pad}, with a table or a list of taxels", "select with taxels = [...] alone"
    for name, span in spans:
        size = getattr(pad, name)
        if not span[0] <= span[1] < size:
            yield f"{name} {list(span)} of {patch.pad}", f"give the first and the last, between 0 and {size - 1}"
    if patch.taxels and (max(patch.taxels) >= pad.count or len(set(patch.taxels)) < len(patch.taxels)):
        yield f"taxels of {patch.pad}", f"list each once, between 0 and {pad.count - 1}"
    if not len(patch_taxels(patch, pad)):
        yield f"no taxel of {patch.pad} is selected", "select others"
