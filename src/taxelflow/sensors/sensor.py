"""A tactile sensor as a TOML file declares it: pads in the order of the scans, unit, channels."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta

from taxelflow.errors import NameUnknown, ParameterInvalid, SensorFileInvalid
from taxelflow.sensors import validation
from taxelflow.sensors.channels import ChannelMap, assign_columns
from taxelflow.sensors.frame import Frame
from taxelflow.sensors.hand import Hand, check_hand, with_model
from taxelflow.sensors.layout import Layout, layout_of
from taxelflow.sensors.names import check_names
from taxelflow.sensors.pads import MOST, Channels, Group, Name, Number, Pad, Positive
from taxelflow.sensors.schema import schema_error
from taxelflow.sensors.taxel_table import with_table
from taxelflow.sensors.toml_text import parse_toml, read_limited

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

PASCAL_PER = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "psi": 6894.757293168, "N/cm2": 1e4}

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
Delay = Annotated[float, Meta(ge=0, lt=1e3)]


class Sensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """A tactile sensor: its pads in the order of the scans, and the unit of its readings."""

    name: Name
    unit: Literal["Pa", "kPa", "MPa", "psi", "N/cm2", "N", "count"]
    """Unit of a reading. N: force on a taxel, whose area makes it a pressure."""
    pads: Annotated[tuple[Pad, ...], Meta(min_length=1, max_length=MOST.pads)]
    scale_pa: Positive | None = None
    """Pa per count, for unit `count`, if known."""
    full_scale: Positive | None = None
    """Reading at gain 1 at which a taxel saturates, in `unit`, if known."""
    groups: Annotated[tuple[Group, ...], Meta(max_length=MOST.pads)] = ()
    delay_s: tuple[Delay, ...] = ()
    """Time from the scan's time stamp to the reading of each taxel, s, in the order of the layout; 0 if left out."""
    gain: tuple[Positive, ...] = ()
    """Factor that equalises each taxel's reading, in the order of the layout; 1 if left out."""
    offset: Number | tuple[Number, ...] = 0.0
    """Number that the source sends without load, in `unit`: one for all, or one per taxel in the order of the layout.
    A reading is polarity (number - offset) gain."""
    polarity: Literal[1, -1] = 1
    """-1 for a source whose numbers decrease under load."""
    axes: Literal[1, 3] = 1
    """Numbers that the source sends per taxel: 3 for x, y, z of a three-axis taxel, in sequence."""
    normal: Literal["x", "y", "z"] = "z"
    """The one of three axes that is normal to the skin."""
    shear: tuple[Axis, Axis] | None = None
    """Those of the other two axes that point along x (right) and y (up) of a pad, as in ["x", "-y"]; shear is not read
    if left out."""
    shear_gain: Positive = 1.0
    """Factor from a number of the shear axes to `unit`."""
    unseen_error: Annotated[float, Meta(ge=0, le=1)] = 0.05
    """Share of a contact's largest reading by which readings may be wrong unseen (hysteresis, creep, gain errors);
    the least error that covariances of poses allow for. 0 for a sensor without them."""
    hand: Hand | None = None
    """Kinematics of the hand, if pads are on moving links."""
    channels: Channels | None = None
    """Places for taxels in a scan of the source, if more than the pads read."""
    frame: Frame | None = None
    """Binary frames of a live device of this kind; lines of text if left out."""
    note: str = ""

    @property
    def to_si(self) -> float:
        """Factor from a reading to Pa; 1 for counts without a scale."""
        if self.unit == "N":
            return 1.0 / float(self.layout.area_m2[0])
        return PASCAL_PER.get(self.unit) or self.scale_pa or 1.0

    @property
    def si_unit(self) -> str:
        """Unit of conditioned pressure: `Pa`, or `count` where no scale is known."""
        return "count" if self.unit == "count" and self.scale_pa is None else "Pa"

    @property
    def layout(self) -> Layout:
        """Taxel arrays of this sensor, computed once."""
        return _layout(self)

    @property
    def images(self) -> list[tuple[int, ...]]:
        """Shapes of a scan as an image, row 0 on top: (rows, cols) of a full grid, or (rows, cols, 3) of three axes."""
        grid = self.layout.full_grid
        if grid is None:
            return []
        return [grid, (*grid, 3)] if self.axes == 3 else [grid]

    @property
    def channel_map(self) -> ChannelMap:
        """Map from a source's scans to readings, computed once."""
        return _channel_map(self)


@cache
def _layout(sensor: Sensor) -> Layout:
    return layout_of(sensor.pads, sensor.groups, sensor.delay_s, sensor.unseen_error)


@cache
def _channel_map(sensor: Sensor) -> ChannelMap:
    import numpy as np

    columns, column = assign_columns(sensor.pads, sensor.channels, sensor.axes, _axis(sensor))
    gain, normal = np.array(sensor.gain or [1.0] * len(column)), (np.array(sensor.offset), sensor.polarity)
    if sensor.shear is None:
        return ChannelMap(columns, column, *normal, gain)
    axes = np.array(["xyz".index(axis[-1]) for axis in sensor.shear]) - _axis(sensor)
    factor = np.array([-sensor.shear_gain if axis.startswith("-") else sensor.shear_gain for axis in sensor.shear])
    return ChannelMap(columns, column, *normal, gain, column[:, np.newaxis] + axes, factor)


def _axis(sensor: Sensor) -> int:
    return "xyz".index(sensor.normal) if sensor.axes == 3 else 0


def with_shear(sensor: Sensor, source: str) -> Sensor:
    """The sensor; one of a single axis gets three. source: what holds shear. Raises SensorFileInvalid if three axes do
    not declare where they point."""
    if sensor.axes == 1:
        return msgspec.structs.replace(sensor, axes=3, normal="z", shear=("x", "y"))
    if sensor.shear is None:
        seen = f"{sensor.name} does not state where the axes of its taxels point, and {source} hold shear"
        raise SensorFileInvalid(sensor.name, "top level, field shear", seen, 'add it, as in shear = ["x", "-y"]')
    return sensor


def with_contacts(sensor: Sensor, asked: int | str | Mapping[str, int]) -> Sensor:
    """The sensor with a number of separate contacts on every pad, or on some pads by name.

    asked: 2, or {"palm": 2}, or text such as 2 or palm=2,thumb=3. Raises ParameterInvalid, NameUnknown.
    """
    names = [pad.name for pad in sensor.pads]
    if isinstance(asked, str):
        asked = int(asked) if asked.strip().isdecimal() else _counts(asked)
    counts = asked if isinstance(asked, Mapping) else dict.fromkeys(names, asked)
    for name, count in counts.items():
        if name not in names:
            raise NameUnknown("pad", name, names)
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST.contacts:
            raise ParameterInvalid("contacts", count, f"be a whole number from 1 to {MOST.contacts}")
    pads = tuple(msgspec.structs.replace(pad, contacts=counts.get(pad.name, pad.contacts)) for pad in sensor.pads)
    taken = {*names, *(group.name for group in sensor.groups)} & {name for pad in pads for name in pad.contact_names}
    if taken:
        raise ParameterInvalid(
            "contacts", asked, f"leave the name {min(taken)} free: rename the pad or group of that name"
        )
    return msgspec.structs.replace(sensor, pads=pads)


def _counts(asked: str) -> dict[str, int]:
    """Numbers of contacts from text such as palm=2,thumb=3. Raises ParameterInvalid."""
    parts = [part.rpartition("=") for part in asked.split(",")]
    if not all(name and count.strip().isdecimal() for name, _, count in parts):
        raise ParameterInvalid("contacts", asked, "be a number such as 2, or a number per pad as in palm=2,thumb=3")
    names = [name.strip() for name, _, _ in parts]
    if len(set(names)) < len(names):
        raise ParameterInvalid("contacts", asked, "name each pad once")
    return {name: int(count) for name, (_, _, count) in zip(names, parts, strict=True)}


def read_sensor(path: Path) -> Sensor:
    """A sensor from a TOML file. Raises SensorFileInvalid, and OSError if it does not open."""
    try:
        content = read_limited(path)
    except ValueError as error:
        raise SensorFileInvalid(str(path), "file", str(error), "give a smaller TOML file") from error
    return parse_sensor(content, str(path), path.parent)


def parse_sensor(text: bytes, source: str, folder: Traversable | None = None) -> Sensor:
    """A sensor from TOML text. source: its name in errors. folder: of its tables. Raises SensorFileInvalid."""
    return sensor_of(sensor_table(text, source), source, folder)


def sensor_table(text: bytes, source: str) -> dict[str, object]:
    """The mapping in TOML text. Raises SensorFileInvalid."""
    try:
        return parse_toml(text)
    except ValueError as error:
        raise SensorFileInvalid(source, "syntax", str(error), "a sensor file is TOML in UTF-8: see toml.io") from error


def sensor_of(table: object, source: str, folder: Traversable | None = None) -> Sensor:
    """A sensor from the mapping in TOML or JSON, completely checked. Raises SensorFileInvalid."""
    sensor = unchecked(table, source, folder)
    check_names(sensor.name, sensor.note, sensor.pads, sensor.groups, source)
    validation.check_sizes(sensor.pads, sensor.groups, source)
    validation.check_pads(sensor.pads, source)
    validation.check_groups(sensor.groups, sensor.pads, source)
    check_hand(sensor.hand, {pad.name: pad.link for pad in sensor.pads if pad.link is not None}, source)
    _check(sensor, source)
    return sensor


def checked(sensor: Sensor) -> Sensor:
    """A sensor made in Python, checked as a file is; lists and arrays in it become tuples. Raises SensorFileInvalid."""
    source = f"of {sensor.name!r}, made in Python"
    try:
        table = msgspec.to_builtins(sensor, enc_hook=_plain)
    except (TypeError, NotImplementedError) as error:
        raise SensorFileInvalid(source, "top level", str(error), "give numbers, text and Pads") from error
    return sensor_of(table, source)


def _plain(value: Any) -> object:
    """Numbers and lists of numbers of a NumPy scalar or array. Raises NotImplementedError for what is neither."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise NotImplementedError(f"a value is of type {type(value).__name__}")


def unchecked(table: object, source: str, folder: Traversable | None) -> Sensor:
    """`sensor_of` without the checks that compute the layout, which take time: only types and ranges of fields."""
    try:
        sensor = msgspec.convert(table, Sensor)
    except msgspec.ValidationError as error:
        raise schema_error(source, str(error), table, Sensor) from error
    pads = tuple(
        with_table(pad, folder, source, validation.pad_at(number, pad.name))
        for number, pad in enumerate(sensor.pads, 1)
    )
    return msgspec.structs.replace(sensor, pads=pads, hand=with_model(sensor.hand, folder, source))


def _check(sensor: Sensor, source: str) -> None:
    if sensor.scale_pa is not None and sensor.unit != "count":
        seen, remedy = f"given for unit {sensor.unit!r}", "leave it out: only counts have a scale"
        raise SensorFileInvalid(source, "top level, field scale_pa", seen, remedy)
    taxels = sum(pad.count for pad in sensor.pads)
    offsets = sensor.offset if isinstance(sensor.offset, tuple) else ()
    if isinstance(sensor.offset, tuple) and not offsets:
        raise SensorFileInvalid(source, "top level, field offset", "an empty list", "give one number, or one per taxel")
    for field, numbers in (("delay_s", sensor.delay_s), ("gain", sensor.gain), ("offset", offsets)):
        if numbers and len(numbers) != taxels:
            what = field.removesuffix("_s")
            seen = f"{len(numbers)} {what}s for {taxels} taxels"
            raise SensorFileInvalid(source, f"top level, field {field}", seen, "give one per taxel, or none")
    if sensor.shear is not None:
        validation.check_shear(sensor.axes, sensor.normal, sensor.shear, source)
    try:
        assign_columns(sensor.pads, sensor.channels, sensor.axes, _axis(sensor))
    except ValueError as error:
        raise SensorFileInvalid(source, "order of the source's numbers", *str(error).split(": ", 1)) from error
    area = sensor.layout.area_m2
    if sensor.unit == "N" and area.min() < 0.999 * area.max():
        seen = f"N, with taxels of {area.min():.3g} to {area.max():.3g} m2"
        raise SensorFileInvalid(source, "top level, field unit", seen, "choose a unit of pressure, or give one area_m2")
