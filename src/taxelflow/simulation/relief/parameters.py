"""Parameters of a pressed relief: the object, the skin, how it is held, its course, and the sensor's faults.

Pressures are those at the sensor's full scale `full_scale_pa`, which stands for whatever reading its file declares.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import not_negative, positive, within

Shape = Literal[
    "handle", "fine-handle", "nut", "bolt", "key", "coin", "ring", "letters", "dome", "bar", "cloth", "tripod",
]  # fmt: skip
LoadKind = Literal["constant", "ramp", "cycles"]
_MOST_SCANS = 100_000
"""Scans of each part of a course at most."""


@dataclass(frozen=True, slots=True)
class _Exponent:
    """Range of the exponent of pressure over depth."""

    least: float = 0.8
    most: float = 1.5


EXPONENT = _Exponent()


@dataclass(frozen=True)
class Object:
    """The rigid object: a height map over the plane, and how it is held."""

    shape: Shape = "nut"
    """handle, fine-handle: fluted, with 4 and 12 flutes. coin: on its edge. ring: open at one side. cloth: random."""
    size_m: float = 0.016
    """Largest extent of the relief, m."""
    relief_m: float = 1e-3
    """Height of the relief, m: depth of grooves, drop of a dome at half its size."""
    seed: int = 0
    """Seed of a random relief (cloth)."""
    tilts: bool = True
    """Whether it is free to tilt until no moment is left about its load point; else it stays parallel to the skin."""
    lever_m: float = 0.0
    """Moment of friction over the normal force while the object slides, m: friction coefficient times the height at
    which it is held. The pressure's centre then lies so far ahead of the load point in the direction of sliding."""

    def __post_init__(self) -> None:
        if self.shape not in get_args(Shape):
            raise ParameterInvalid("object.shape", self.shape, f"be one of {', '.join(get_args(Shape))}")
        positive("object.size_m", self.size_m)
        positive("object.relief_m", self.relief_m)
        not_negative("object.lever_m", self.lever_m)


@dataclass(frozen=True)
class Skin:
    """The elastic foundation: pressure = stiffness_pa_m * depth * (depth / reference_m)^(exponent - 1)."""

    stiffness_pa_m: float = 1e8
    """Pressure over depth at the reference depth, Pa/m."""
    exponent: float = 1.0
    """Exponent of the law of pressure, 0.8 to 1.5; 1: linear (Winkler)."""
    reference_m: float = 5e-4
    """Depth at which all exponents give the same pressure, m."""
    cover_m: tuple[float, float] = (0.0, 0.0)
    """Standard deviations along the pad's x and y of the Gaussian by which an elastic cover spreads the pressure, m;
    0: no cover, unequal: anisotropic."""
    active_share: float = 0.9
    """Side of a taxel's sensitive area divided by the pitch, above 0 and at most 1."""

    def __post_init__(self) -> None:
        positive("skin.stiffness_pa_m", self.stiffness_pa_m)
        positive("skin.reference_m", self.reference_m)
        within("skin.exponent", self.exponent, EXPONENT.least, EXPONENT.most)
        for sigma_m in self.cover_m:
            not_negative("skin.cover_m", sigma_m)
        within("skin.active_share", self.active_share, 0.01, 1.0)


@dataclass(frozen=True)
class Course:
    """Pose and load over time: idle, pressing, rest, motion at constant speed, rest.

    The motion is one straight stroke with a turn at a constant rate: 0 and 0 hold the object still.
    """

    travel_m: float = 0.006
    """Length of the stroke, m, centred at `middle_m`."""
    direction_rad: float = 0.4
    """Its direction in the pad's frame, rad."""
    turn_rad: float = 0.0
    """Turn during the stroke, rad."""
    middle_m: tuple[float, float] = (0.0, 0.0)
    """Middle of the stroke in the pad's frame, m."""
    angle_rad: float = 0.2
    """Angle of the object at the middle of the stroke, rad."""
    idle_scans: int = 12
    """Scans without contact at the start; 0 (and pressing_scans 0): the recording starts loaded."""
    pressing_scans: int = 6
    """Scans during which the load rises from 0."""
    rest_scans: int = 12
    """Scans at rest before and after the motion."""
    moving_scans: int = 108
    """Scans of the motion."""
    load: LoadKind = "constant"
    """Force from the start to the end of the motion. ramp: from the first to the second multiple of the nominal force.
    cycles: three sinusoidal cycles between them."""
    multiples: tuple[float, float] = (0.6, 1.4)
    """First and second multiple of the nominal force, for ramp and cycles."""
    wander_m: float = 0.0
    """How far the load's line of action wanders over the object during the motion, m, as the arm that presses it does
    not hold it quite upright; at rest it passes through the load point."""

    def __post_init__(self) -> None:
        not_negative("course.travel_m", self.travel_m)
        not_negative("course.wander_m", self.wander_m)
        for name, least in (("idle_scans", 0), ("pressing_scans", 0), ("rest_scans", 0), ("moving_scans", 1)):
            within(f"course.{name}", getattr(self, name), least, _MOST_SCANS)
        if self.load not in get_args(LoadKind):
            raise ParameterInvalid("course.load", self.load, f"be one of {', '.join(get_args(LoadKind))}")
        for multiple in self.multiples:
            positive("course.multiples", multiple)

    @property
    def scans(self) -> int:
        """Scans of the recording."""
        return self.idle_scans + self.pressing_scans + 2 * self.rest_scans + self.moving_scans


@dataclass(frozen=True)
class SensorFaults:
    """What a real sensor does to the pressure on its taxels; 0 is off. In the order in which they act."""

    cross_talk: float = 0.0
    """Share of the pressure on a taxel that each of its neighbours reads in addition."""
    relaxation: float = 0.0
    """Share by which the reading under constant pressure decreases in the end."""
    relaxation_s: float = 2.0
    """Time constant of relaxation, s."""
    creep: float = 0.0
    """Share by which the reading under constant pressure increases in the end."""
    creep_s: float = 2.0
    """Time constant of creep, s."""
    hysteresis: float = 0.0
    """Share of the reading that follows the pressure with play; half-widths of play: 1/8, 2/8, 3/8 and 4/8 of the
    recording's largest reading (Prandtl-Ishlinskii)."""
    gain_spread: float = 0.0
    """Standard deviation of the taxels' gains, mean 1."""
    offset_spread_pa: float = 0.0
    """Standard deviation of the taxels' constant offsets, Pa."""
    offset_pa: float = 0.0
    """Mean of the offsets, Pa."""
    scan_share: float = 0.0
    """Share of the scan period during which the taxels are read row by row; the sensor file then declares the delay.
    Used where the sensor declares no `delay_s` of its own."""
    noise_pa: float = 250.0
    """Standard deviation of the noise of a reading, Pa."""
    dead: int = 0
    """Number of taxels, drawn at random from those that are loaded, that read offset and noise only."""
    full_scale_pa: float = 140e3
    """Full scale, Pa: readings are clipped to 0 and to this."""
    bits: int = 12
    """Resolution of the full scale, bits; 0: not quantised. Counts are whole numbers of the sensor's own full scale."""

    def __post_init__(self) -> None:
        for name in ("cross_talk", "relaxation", "hysteresis", "scan_share"):
            within(f"faults.{name}", getattr(self, name), 0.0, 1.0)
        for name in ("creep", "gain_spread", "offset_spread_pa", "noise_pa"):
            not_negative(f"faults.{name}", getattr(self, name))
        for name in ("relaxation_s", "creep_s", "full_scale_pa"):
            positive(f"faults.{name}", getattr(self, name))
        within("faults.dead", self.dead, 0, 100_000)
        within("faults.bits", self.bits, 0, 32)


@dataclass(frozen=True)
class Pressing:
    """One recording: an object pressed on one pad of a sensor and moved."""

    object: Object = field(default_factory=Object)
    skin: Skin = field(default_factory=Skin)
    course: Course = field(default_factory=Course)
    faults: SensorFaults = field(default_factory=SensorFaults)
    peak_pa: float = 60e3
    """The nominal force is the one whose largest pressure on a taxel is this, at the middle of the stroke, without
    cover, Pa."""
    force_n: float = 0.0
    """Nominal force instead, N; 0: from `peak_pa`."""
    rate_hz: float = 50.0
    """Scan rate, Hz."""
    seed: int = 0
    """Seed of the faults and the noise."""

    def __post_init__(self) -> None:
        positive("peak_pa", self.peak_pa)
        not_negative("force_n", self.force_n)
        positive("rate_hz", self.rate_hz)
