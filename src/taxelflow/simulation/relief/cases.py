"""Named cases: every shape on five layouts, moved in four ways, with each effect of a real skin or all of them.

Amounts are those of common arrays: gains within 10 %, a few percent of cross-talk, hysteresis and creep of ten percent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np

from taxelflow.errors import NameUnknown
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.relief.parameters import Course, Object, Pressing, SensorFaults, Skin

if TYPE_CHECKING:
    from taxelflow.simulation.relief.parameters import Shape

Moved = Literal["hold", "slide", "turn", "slide-turn"]


@dataclass(frozen=True, slots=True)
class _Hex:
    """The hexagonal pad."""

    rings: int = 6
    pitch_m: float = 3e-3
    """Rings of taxels around the middle, and their pitch."""


_HEX = _Hex()
_FULL_SCALE_KPA = SensorFaults.full_scale_pa / 1e3
_LARGE = {"handle": 2.2, "fine-handle": 2.2, "letters": 1.5, "cloth": 2.2, "bar": 1.6}
"""Size of objects that a pad cannot hold whole, over that of those that it can."""
_TURN_RAD = (0.3, 0.5)
"""Smallest and largest turn of a case."""


@dataclass(frozen=True)
class Place:
    """A pad on which objects are pressed. size_m: of objects that lie within it. travel_m: of a stroke.
    along_rad: its direction, within spread_rad.
    """

    sensor: str
    pad: str
    size_m: float
    travel_m: float
    along_rad: float = 0.0
    spread_rad: float = pi


PLACES = {
    "palm": Place("barretthand-162", "palm", 0.020, 0.020, 0.0, 0.15),
    "sdh": Place("schunk-sdh2", "finger2_distal", 0.012, 0.012, pi / 2, 0.15),
    "grid": Place("grid:16x16@2mm,kPa", "grid", 0.016, 0.006),
    "xela": Place("xela-4x4@4.7mm", "uskin", 0.0095, 0.004),
    "hex": Place("hexagon", "hexagon", 0.018, 0.007),
}
"""hex: a flat hexagon of 127 taxels, 3 mm apart."""


def sensor_at(place: Place) -> Sensor:
    """The sensor of a place."""
    if place.sensor != "hexagon":
        sensor = load_sensor(place.sensor)
        return sensor if sensor.unit != "kPa" else msgspec.structs.replace(sensor, full_scale=_FULL_SCALE_KPA)
    rings = range(-_HEX.rings, _HEX.rings + 1)
    cells = [(q, r) for r in rings for q in rings if abs(q + r) <= _HEX.rings]
    places = tuple((_HEX.pitch_m * (q + r / 2), -_HEX.pitch_m * float(np.sqrt(0.75)) * r) for q, r in cells)
    area_m2 = float(np.sqrt(0.75)) * _HEX.pitch_m**2
    pad = Pad(name="hexagon", taxels=places, area_m2=area_m2)
    return Sensor(name="hexagon-127", unit="kPa", full_scale=_FULL_SCALE_KPA, pads=(pad,))


_LOADED: dict[str, Any] = {"idle_scans": 0, "pressing_scans": 0}
_ALL: dict[str, Any] = {
    "lever_sizes": 0.02, "wander_sizes": 0.0125,
    "skin": {"exponent": 1.2},
    "cover_pitches": (0.35, 0.2),
    "course": {"load": "ramp", "multiples": (0.85, 1.15)},
    "faults": {
        "gain_spread": 0.1, "offset_spread_pa": 1e3, "offset_pa": 2e3, "cross_talk": 0.03, "hysteresis": 0.1,
        "relaxation": 0.1, "creep": 0.05, "scan_share": 0.8, "noise_pa": 500.0, "dead": 1, "bits": 10,
    },
}  # fmt: skip
EFFECTS: dict[str, dict[str, Any]] = {
    "none": {},
    "law-0.8": {"skin": {"exponent": 0.8}},
    "law-1.5": {"skin": {"exponent": 1.5}},
    "cover": {"cover_pitches": (0.4, 0.4)},
    "anisotropic-cover": {"cover_pitches": (0.6, 0.2)},
    "gains": {"faults": {"gain_spread": 0.1}},
    "offsets": {"faults": {"offset_spread_pa": 2e3, "offset_pa": 4e3}, "course": _LOADED},
    "cross-talk": {"faults": {"cross_talk": 0.05}},
    "hysteresis": {"faults": {"hysteresis": 0.1}},
    "relaxation": {"faults": {"relaxation": 0.3}},
    "creep": {"faults": {"creep": 0.1}},
    "friction": {"lever_sizes": 0.03},
    "tilt": {"wander_sizes": 0.03},
    "held": {"object": {"tilts": False}},
    "rolling-scan": {"faults": {"scan_share": 0.9}},
    "noise": {"faults": {"noise_pa": 1e3}},
    "dead": {"faults": {"dead": 2}},
    "coarse": {"faults": {"bits": 6}},
    "saturated": {"course": {"load": "ramp", "multiples": (1.0, 3.0)}},
    "load": {"course": {"load": "cycles", "multiples": (0.5, 1.5)}},
    "loaded": {"course": _LOADED},
    "all": _ALL,
    "all-loaded": {**_ALL, "course": {**_ALL["course"], **_LOADED}},
}
"""What an effect changes. Covers are in pitches of the pad, levers and wandering in the size of small objects.
all-loaded: as all, without idle scans to tare on."""


def case(shape: Shape, place: str, effect: str = "none", moved: Moved = "slide-turn", seed: int = 0) -> Pressing:
    """The pressing of a shape at a place; `seed` draws its course, and the faults. Raises NameUnknown."""
    if place not in PLACES:
        raise NameUnknown("layout", place, PLACES)
    if effect not in EFFECTS:
        raise NameUnknown("effect", effect, EFFECTS)
    at, changed = PLACES[place], EFFECTS[effect]
    spread = changed.get("cover_pitches", (0.0, 0.0))
    layout = sensor_at(at).layout
    pitch_m = layout.pitch_m[layout.pads.index(at.pad)]
    cover_m = (float(spread[0] * pitch_m[0]), float(spread[1] * pitch_m[1]))
    course = replace(_course(at, moved, seed, pitch_m.min()), **changed.get("course", {}))
    lever_m = at.size_m * changed.get("lever_sizes", 0.0)
    size_m = at.size_m * _LARGE.get(shape, 1.0)
    return Pressing(
        object=Object(shape=shape, size_m=size_m, seed=seed, lever_m=lever_m, **changed.get("object", {})),
        skin=Skin(cover_m=cover_m, **changed.get("skin", {})),
        course=replace(course, wander_m=at.size_m * changed.get("wander_sizes", 0.0)),
        faults=SensorFaults(**changed.get("faults", {})),
        seed=seed,
    )


def _course(at: Place, moved: Moved, seed: int, pitch_m: float) -> Course:
    """A course whose direction, angle, turn and place between the taxels are drawn."""
    random = np.random.default_rng([seed, 32])
    way = random.choice([0.0, pi])
    direction = at.along_rad + way + random.uniform(-at.spread_rad, at.spread_rad)
    turn = float(random.uniform(*_TURN_RAD) * random.choice([-1, 1]))
    angle = float(random.uniform(-pi, pi) if at.spread_rad >= pi else random.uniform(-0.6, 0.6) + at.along_rad + way)
    middle_m = tuple((0.25 * pitch_m * random.uniform(-1, 1, 2)).tolist())
    return Course(
        travel_m=at.travel_m if moved in ("slide", "slide-turn") else 0.0,
        direction_rad=float(direction),
        turn_rad=turn if moved in ("turn", "slide-turn") else 0.0,
        middle_m=middle_m,
        angle_rad=angle,
    )
