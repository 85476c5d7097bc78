"""Sensors, pads and taxels: what a TOML file declares, and the arrays that the stages compute with.

Pad frame: row 0 is the top row, column 0 the left; x to the right along columns, y up (towards row 0),
z out of the skin; origin at the pad's centre. Taxels run pad by pad, row-major, missing ones left out.

Hand frame: the hand's skin laid flat, as on a map; a pad's place on it is `origin_m` and `angle_rad`. A group is a
choice of taxels of one or more pads that gets a slip vector of its own: to all that follows conditioning it is one
more pad.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from taxelflow.errors import NameUnknown, SensorFileInvalid
from taxelflow.geometry import place
from taxelflow.messages import Bools, Floats

PASCAL_PER = {"Pa": 1.0, "kPa": 1e3, "psi": 6894.757293168, "N/cm2": 1e4}

Name = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[^,\"\r\n]+$")]
Count = Annotated[int, Meta(ge=1, le=1024)]
Positive = Annotated[float, Meta(gt=0, lt=1e12)]
Index = Annotated[int, Meta(ge=0)]
Number = Annotated[float, Meta(gt=-1e6, lt=1e6)]
Delay = Annotated[float, Meta(ge=0, lt=1e3)]


class Pad(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rectangular grid of taxels, some of which may be missing."""

    name: Name
    """How the pad is called in results."""
    rows: Count
    cols: Count
    pitch_m: tuple[Positive, Positive]
    """Distance between taxel centres along x (columns) and y (rows), m."""
    missing: tuple[tuple[Index, Index], ...] = ()
    """Grid places [row, col] where there is no taxel."""
    origin_m: tuple[Number, Number] | None = None
    """The pad's centre in the hand frame, m, if known."""
    angle_rad: Number = 0.0
    """Direction of the pad's x axis in the hand frame, rad, anticlockwise."""
    note: str = ""
    """What a user should know, such as an assumption."""


class Patch(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rectangle of a pad's grid."""

    pad: Name
    rows: tuple[Index, Index] | None = None
    """First and last row; all if left out."""
    cols: tuple[Index, Index] | None = None
    """First and last column; all if left out."""


class Group(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Taxels that get a slip vector of their own. Groups may overlap.

    A group within one pad reports in that pad's frame, one across pads in the hand frame.
    """

    name: Name
    patches: Annotated[tuple[Patch, ...], Meta(min_length=1, max_length=1024)]


class Sensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A tactile sensor: its pads in the order of the scans, and the unit of its readings."""

    name: Name
    unit: Literal["Pa", "kPa", "psi", "N/cm2", "count"]
    pads: Annotated[tuple[Pad, ...], Meta(min_length=1, max_length=1024)]
    scale_pa: Positive | None = None
    """Pa per count, for unit `count`, if known."""
    full_scale: Positive | None = None
    """Largest reading, in `unit`, if known: there a taxel saturates."""
    groups: tuple[Group, ...] = ()
    delay_s: tuple[Delay, ...] = ()
    """How long after its scan's time stamp each taxel is read, s, in the order of the scan; at once if left out."""
    note: str = ""

    @property
    def to_si(self) -> float:
        """Factor from a reading to Pa; 1 for counts without a scale."""
        return PASCAL_PER.get(self.unit) or self.scale_pa or 1.0

    @property
    def si_unit(self) -> str:
        """Unit of conditioned pressure: `Pa`, or `count` where no scale is known."""
        return "count" if self.unit == "count" and self.scale_pa is None else "Pa"

    @property
    def layout(self) -> Layout:
        """Taxel arrays of this sensor, computed once."""
        return _layout(self)


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Pads, and after them groups, as flat arrays over their taxels.

    taxels: how many a scan has. source: (entries,), the taxel of the scan that an entry reads; a group's entries come
    after those of all pads, so for pads an entry's number is its taxel's. pads: names of pads and groups, pad_count of
    which are pads. starts: (pads + 1,), pad p owns entries starts[p] to starts[p + 1]. row, col: (entries,) place in
    the pad's grid. x_m, y_m: (entries,) place in the pad's frame. border: (entries, 2), no neighbour to the left or
    right (x), above or below (y). shapes: (rows, cols) per pad. pitch_m: (pads, 2). T_hand: (pads, 3) pose of the pad's
    frame in the hand, NaN where unknown. A group has shape and pitch of its first pad, and its
    frame unless it spans several: then that of the hand. delay_s: (entries,), when in a scan a taxel is read.
    """

    taxels: int
    pad_count: int
    pads: tuple[str, ...]
    shapes: tuple[tuple[int, int], ...]
    source: NDArray[np.int64]
    starts: NDArray[np.int64]
    pitch_m: Floats
    row: NDArray[np.int64]
    col: NDArray[np.int64]
    x_m: Floats
    y_m: Floats
    border: Bools
    T_hand: Floats
    delay_s: Floats

    @property
    def entries(self) -> int:
        """Taxels of all pads and groups, those of groups counted again."""
        return len(self.source)

    @property
    def apart(self) -> Bools:
        """(pads,): groups, and pads that no group takes taxels from: no taxel counts as pad and as group."""
        grouped = np.zeros(self.taxels, dtype=np.bool_)
        grouped[self.source[self.starts[self.pad_count] :]] = True
        free = [not grouped[self.of_pad(pad)].any() for pad in range(self.pad_count)]
        return np.array(free + [True] * (len(self.pads) - self.pad_count))

    def of_pad(self, pad: int) -> slice:
        """Entries of pad or group number `pad`; for a pad these are its taxels in the scan."""
        return slice(int(self.starts[pad]), int(self.starts[pad + 1]))

    def neighbours(self, pad: int) -> NDArray[np.int64]:
        """(pairs, 2) taxels of a pad, numbered within it, that lie side by side in a row or a column."""
        own = self.of_pad(pad)
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


@cache
def _layout(sensor: Sensor) -> Layout:
    numbers = {pad.name: number for number, pad in enumerate(sensor.pads)}
    present = [_present(pad) for pad in sensor.pads]
    first = np.concatenate([[0], np.cumsum([there.sum() for there in present])]).astype(np.int64)
    zones = [[(number, there)] for number, there in enumerate(present)] + [
        [(numbers[patch.pad], _patch(patch, present[numbers[patch.pad]])) for patch in group.patches]
        for group in sensor.groups
    ]
    parts = [[_part(sensor.pads[n], present[n], first[n], chosen) for n, chosen in zone] for zone in zones]
    homes = np.array([_home(pad, alone=len(sensor.pads) == 1) for pad in sensor.pads])
    for zone, own in zip(zones, parts, strict=True):
        if len({number for number, _ in zone}) > 1:  # across pads: everything in the hand frame
            for (number, _), part in zip(zone, own, strict=True):
                part.places[:] = place(homes[number], part.places)
    flat = [part for own in parts for part in own]
    places = np.concatenate([part.places for part in flat])
    counts = [sum(len(part.source) for part in own) for own in parts]
    across = [len({number for number, _ in zone}) > 1 for zone in zones]
    return Layout(
        taxels=int(first[-1]),
        pad_count=len(sensor.pads),
        pads=(*numbers, *(group.name for group in sensor.groups)),
        shapes=tuple((sensor.pads[zone[0][0]].rows, sensor.pads[zone[0][0]].cols) for zone in zones),
        source=np.concatenate([part.source for part in flat]),
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        pitch_m=np.array([sensor.pads[zone[0][0]].pitch_m for zone in zones]),
        row=np.concatenate([part.row for part in flat]),
        col=np.concatenate([part.col for part in flat]),
        x_m=np.ascontiguousarray(places[:, 0]),
        y_m=np.ascontiguousarray(places[:, 1]),
        border=np.concatenate([part.border for part in flat]),
        T_hand=np.array([np.zeros(3) if wide else homes[zone[0][0]] for zone, wide in zip(zones, across, strict=True)]),
        delay_s=np.array(sensor.delay_s or [0.0] * int(first[-1]))[np.concatenate([part.source for part in flat])],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """The taxels that a zone takes from one pad."""

    source: NDArray[np.int64]
    row: NDArray[np.int64]
    col: NDArray[np.int64]
    places: Floats
    border: Bools


def _part(pad: Pad, present: Bools, first: int, chosen: Bools) -> _Part:
    number = np.full(present.shape, -1, dtype=np.int64)
    number[present] = first + np.arange(present.sum())
    row, col = np.nonzero(chosen)
    x = (col - (pad.cols - 1) / 2) * pad.pitch_m[0]
    y = ((pad.rows - 1) / 2 - row) * pad.pitch_m[1]
    return _Part(number[chosen], row, col, np.stack([x, y], axis=1), _border(chosen))


def _home(pad: Pad, *, alone: bool) -> tuple[float, float, float]:
    """T_hand_pad. Without an origin it is unknown, but the only pad of a sensor is its hand."""
    unknown = 0.0 if alone else float("nan")
    return (*(pad.origin_m or (unknown, unknown)), pad.angle_rad)


def _patch(patch: Patch, present: Bools) -> Bools:
    rows, cols = patch.rows or (0, present.shape[0] - 1), patch.cols or (0, present.shape[1] - 1)
    chosen = np.zeros_like(present)
    chosen[rows[0] : rows[1] + 1, cols[0] : cols[1] + 1] = True
    return chosen & present


def _present(pad: Pad) -> Bools:
    there = np.ones((pad.rows, pad.cols), dtype=np.bool_)
    for row, col in pad.missing:
        there[row, col] = False
    return there


def _border(there: Bools) -> Bools:
    padded = np.pad(there, 1)
    left_right = ~(padded[1:-1, :-2] & padded[1:-1, 2:])
    above_below = ~(padded[:-2, 1:-1] & padded[2:, 1:-1])
    return np.stack([left_right[there], above_below[there]], axis=1)


def builtin_sensors() -> list[str]:
    """Names of the sensors that come with taxelflow."""
    folder = resources.files("taxelflow") / "sensors"
    return sorted(Path(file.name).stem for file in folder.iterdir() if file.name.endswith(".toml"))


def load_sensor(name: str) -> Sensor:
    """A built-in sensor by name, or one from a TOML file by path.

    Raises NameUnknown (with the list of names) and SensorFileInvalid (with file, table and field).
    """
    if name in builtin_sensors():
        return parse_sensor((resources.files("taxelflow") / "sensors" / f"{name}.toml").read_bytes(), f"{name}.toml")
    path = Path(name)
    if path.is_file():
        return parse_sensor(path.read_bytes(), str(path))
    raise NameUnknown("sensor", name, [*builtin_sensors(), "or the path of a TOML file"])


def parse_sensor(text: bytes, source: str) -> Sensor:
    """A sensor from TOML text; `source` names it in errors. Raises SensorFileInvalid."""
    try:
        table = tomllib.loads(text.decode())
    except UnicodeDecodeError as error:
        raise SensorFileInvalid(source, "text", str(error), "a TOML file is UTF-8 text") from error
    except tomllib.TOMLDecodeError as error:
        raise SensorFileInvalid(source, "syntax", str(error), "see toml.io for the format") from error
    return sensor_of(table, source)


def sensor_of(table: object, source: str) -> Sensor:
    """A sensor from the mapping that TOML or JSON holds; `source` names it in errors. Raises SensorFileInvalid."""
    try:
        sensor = msgspec.convert(table, Sensor)
    except msgspec.ValidationError as error:
        raise _schema_error(source, str(error)) from error
    _check_sensor(sensor, source)
    return sensor


def _schema_error(source: str, message: str) -> SensorFileInvalid:
    """Turn msgspec's `... - at `$.pads[0].rows`` into the words of TOML."""
    what, _, path = message.partition(" - at `$")
    seen = what.replace("Object", "table").replace("object", "table").replace("`array`", "a list")
    table = re.match(r"\.(pads|groups)\[(\d+)\]", path)
    field = re.sub(r"^\.(pads|groups)\[\d+\]", "", path.rstrip("`")).lstrip(".")
    where = f"table [[{table[1]}]] number {int(table[2]) + 1}" if table else "top level"
    return SensorFileInvalid(
        source,
        where + (f", field {field}" if field else ""),
        seen[:1].lower() + seen[1:],
        "a sensor has name, unit (Pa, kPa, psi, N/cm2 or count) and [[pads]] with name, rows, cols, pitch_m = [x, y]",
    )


def _check_sensor(sensor: Sensor, source: str) -> None:
    if sensor.scale_pa is not None and sensor.unit != "count":
        raise SensorFileInvalid(
            source,
            "top level, field scale_pa",
            f"given for unit {sensor.unit!r}",
            "leave it out: only counts need a scale",
        )
    for name, times in Counter([pad.name for pad in sensor.pads] + [group.name for group in sensor.groups]).items():
        if times > 1:
            raise SensorFileInvalid(
                source,
                "tables [[pads]] and [[groups]], field name",
                f"{name!r} stands {times} times",
                "name each pad and each group once",
            )
    for number, pad in enumerate(sensor.pads, 1):
        where = f"table [[pads]] number {number} ({pad.name}), field missing"
        for row, col in pad.missing:
            if row >= pad.rows or col >= pad.cols:
                raise SensorFileInvalid(
                    source,
                    where,
                    f"[{row}, {col}] lies outside {pad.rows} rows and {pad.cols} cols",
                    "count rows and cols from 0",
                )
        if len(set(pad.missing)) != len(pad.missing):
            raise SensorFileInvalid(source, where, "a place is listed twice", "list each place once")
        if len(pad.missing) == pad.rows * pad.cols:
            raise SensorFileInvalid(source, where, "no taxel is left", "a pad has at least one taxel")
    _check_groups(sensor, source)
    taxels = sum(pad.rows * pad.cols - len(pad.missing) for pad in sensor.pads)
    if sensor.delay_s and len(sensor.delay_s) != taxels:
        seen = f"{len(sensor.delay_s)} delays for {taxels} taxels"
        raise SensorFileInvalid(source, "top level, field delay_s", seen, "give one for each taxel, or none")


def _check_groups(sensor: Sensor, source: str) -> None:
    pads = {pad.name: pad for pad in sensor.pads}
    for number, group in enumerate(sensor.groups, 1):
        where = f"table [[groups]] number {number} ({group.name}), field patches"
        for patch in group.patches:
            if patch.pad not in pads:
                known = ", ".join(pads)
                raise SensorFileInvalid(source, where, f"there is no pad {patch.pad!r}", f"the pads are {known}")
            pad = pads[patch.pad]
            for name, span, size in (("rows", patch.rows, pad.rows), ("cols", patch.cols, pad.cols)):
                if span is not None and not span[0] <= span[1] < size:
                    remedy = f"give the first and the last, between 0 and {size - 1}"
                    raise SensorFileInvalid(source, where, f"{name} {list(span)} of {patch.pad}", remedy)
            if not _patch(patch, _present(pad)).any():
                raise SensorFileInvalid(source, where, f"no taxel of {patch.pad} lies in it", "choose others")
        members = {patch.pad for patch in group.patches}
        if len(members) > 1 and any(pads[name].origin_m is None for name in members):
            seen = "it spans pads whose place in the hand is unknown"
            raise SensorFileInvalid(source, where, seen, "give those pads origin_m = [x, y] and angle_rad")
