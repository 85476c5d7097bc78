"""Scenarios of the rig: named sets of parameters, each of one recording."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import pi
from typing import Literal

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import not_negative
from taxelflow.simulation.parameters import TEXTURED, Contact, Load, Motion, Second, Sensing

__all__ = ["DESCRIPTIONS", "SCENARIOS", "Contact", "Load", "Motion", "Scenario", "Second", "Sensing", "Solver"]

Solver = Literal["analytic", "elastic"]


@dataclass(frozen=True)
class Scenario:
    """Parameters of one simulated recording."""

    sensor: str = "barretthand-162"
    """Name of a built-in sensor, or path of a TOML file."""
    pad: str = "palm"
    """Pad in contact; all others read offset and noise. hand: the object moves over the flattened hand and touches all
    pads with a known position in it; poses are then in the hand frame."""
    seed: int = 0
    """Seed of all random numbers, 0 or more; the same seed gives the same recording."""
    solver: Solver = "analytic"
    """Contact model. analytic: pressure by formula. elastic: by a boundary-element solver of elastic contact (extra
    `elastic`)."""
    contact: Contact = field(default_factory=Contact)
    motion: Motion = field(default_factory=Motion)
    load: Load = field(default_factory=Load)
    second: Second = field(default_factory=Second)
    sensing: Sensing = field(default_factory=Sensing)

    def __post_init__(self) -> None:
        not_negative("seed", self.seed)
        motion_s = self.motion.duration_s
        if motion_s * self.sensing.rate_hz < 1:
            duty = f"be at least {1 / motion_s:.3g} Hz, for one scan in a motion of {motion_s:.3g} s"
            raise ParameterInvalid("sensing.rate_hz", self.sensing.rate_hz, duty)
        for motion, load in ((self.motion, self.load), (self.second.motion, self.second.load)):
            if load.lift_s > motion.rest_s:
                duty = f"be at most motion.rest_s, {motion.rest_s:g} s: a moving object is in contact"
                raise ParameterInvalid("load.lift_s", load.lift_s, duty)
        if self.load.steps and (self.contact.shape != "feet" or self.solver == "elastic"):
            raise ParameterInvalid(
                "load.steps", self.load.steps, "be 0, except for contact.shape feet with solver analytic"
            )
        if self.second.there and self.pad == "hand":
            raise ParameterInvalid(
                "second.there", self.second.there, "be False for pad hand: two objects need a single pad"
            )
        if self.load.roll_m and self.contact.shape == "feet":
            raise ParameterInvalid("load.roll_m", self.load.roll_m, "be 0 for contact.shape feet: use load.tilt")
        if self.solver == "elastic" and self.contact.deform_1_m:
            raise ParameterInvalid("contact.deform_1_m", self.contact.deform_1_m, "be 0 with solver elastic")
        if self.solver == "elastic" and self.load.roll_m and self.contact.shape in TEXTURED:
            raise ParameterInvalid("load.roll_m", self.load.roll_m, "be 0 for a textured contact with solver elastic")


_PAPER = Scenario()
_SDH = Scenario(
    sensor="schunk-sdh2",
    pad="finger2_proximal",
    contact=Contact("elongated", radius_m=0.0035, aspect=2.2, peak_pa=1600.0),
    motion=Motion(speed_m_s=0.01, direction_rad=1.5707963267948966, travel_m=0.025, middle_m=(0.0, 0.0), rest_s=1.0),
    sensing=Sensing(
        rate_hz=31.0, noise_pa=4.0, baseline_pa=(0.0, 0.0), bits=12, full_scale_pa=3271.3, active_share=0.95
    ),
)
_BULB = Scenario(
    pad="hand",
    contact=Contact("bulb", radius_m=0.03, aspect=2.8, peak_pa=60e3, texture=0.25, deform_1_m=1.0),
    motion=Motion(
        speed_m_s=0.05, direction_rad=0.0, travel_m=0.38, strokes=1, angle_rad=pi / 2, middle_m=(0.0, -0.035)
    ),
)
_OVER_HAND = Scenario(
    pad="hand",
    contact=Contact(
        "feet",
        radius_m=0.0065,
        peak_pa=100e3,
        # two on each phalanx of fingers 1 and 2, one on each side of the palm; none leaves its pad or group
        feet_at_m=(
            *((x, 0.0) for x in (-0.124, -0.106, -0.082, -0.064, 0.064, 0.082, 0.106, 0.124)),
            (-0.02, 0.0),
            (0.02, 0.0),
        ),
    ),
    motion=Motion(
        direction_rad=0.0,
        travel_m=0.0,
        strokes=18,
        turn_rad_s=0.5,
        turn_s=0.2,
        centre_m=(0.0, 0.0),
        angle_rad=-0.05,
        middle_m=(0.0, 0.0),
        rest_s=1.5,
    ),
    load=Load(lift_s=1.0),
    sensing=Sensing(rate_hz=50.0),
)
_STILL = replace(
    _PAPER,
    motion=Motion(travel_m=0.0, strokes=1, turn_s=6.0, middle_m=(0.0, 0.0), rest_s=2.0),
    load=Load(lift_s=1.0),
    sensing=Sensing(rate_hz=30.0),
)
_STICK_SLIP = Scenario(
    sensor="grid-16x16",
    pad="grid",
    contact=Contact("textured", radius_m=0.016),
    motion=Motion("stick-slip", travel_m=0.02, middle_m=(0.0, 0.0), rest_s=1.5),
    load=Load(lift_s=1.0),
    sensing=Sensing(rate_hz=100.0),
)
_FEET_LIFT = replace(
    _STICK_SLIP,
    contact=Contact("feet", radius_m=0.006, feet=4, ring_m=0.013),
    motion=Motion(
        speed_m_s=0.008, direction_rad=0.6, travel_m=0.02, turn_rad_s=0.15, middle_m=(0.001, -0.001), rest_s=1.5
    ),
    load=Load(lift_s=1.0, steps=8),
    sensing=Sensing(rate_hz=50.0),
)
_TWO = replace(
    _FEET_LIFT,
    contact=Contact("bulb", radius_m=0.0065, aspect=1.5),
    motion=Motion(
        speed_m_s=0.012, direction_rad=pi / 2, travel_m=0.024, turn_rad_s=0.2, middle_m=(-0.016, 0.0), rest_s=1.5
    ),
    load=Load(lift_s=1.0),
    second=Second(
        there=True,
        contact=Contact("bulb", radius_m=0.007, aspect=1.6, peak_pa=60e3),
        motion=Motion(
            speed_m_s=0.012, direction_rad=-pi / 2, travel_m=0.024, turn_rad_s=-0.3, middle_m=(0.014, 0.0), rest_s=1.5
        ),
        load=Load(lift_s=1.2),
    ),
)
_HOLD = replace(_STICK_SLIP, motion=replace(_STILL.motion, turn_s=60.0))
_BAR = Scenario(
    sensor="grid-16x16",
    pad="grid",
    contact=Contact("elongated", radius_m=0.008),
    motion=Motion(
        speed_m_s=0.02 / 1.5, travel_m=0.02, strokes=1, turn_rad_s=1.4, angle_rad=0.3, middle_m=(0.0, 0.0), rest_s=1.0
    ),
    load=Load(lift_s=1.0),
    sensing=Sensing(rate_hz=100.0),
)
_FEET = Contact("feet", radius_m=0.006)
_TURNING = replace(_STICK_SLIP.motion, turn_rad_s=0.5)

SCENARIOS = {
    "stroke": _PAPER,
    "fast-stroke": replace(_PAPER, motion=replace(_PAPER.motion, speed_m_s=0.050)),
    "hertz-stroke": replace(_PAPER, contact=Contact("hertz", radius_m=0.017)),
    "turn": replace(_SDH, motion=replace(_SDH.motion, travel_m=0.0, turn_rad_s=1.0)),
    "slide-and-turn": replace(_SDH, motion=replace(_SDH.motion, turn_rad_s=0.8)),
    "bar-on-grid": _BAR,
    "feet-on-grid": replace(_BAR, contact=_FEET),
    "texture-on-grid": replace(
        _BAR,
        sensor="grid:32x32@2mm,kPa",
        contact=Contact("textured", radius_m=0.016),
        motion=replace(_BAR.motion, speed_m_s=0.01, turn_rad_s=0.2),
    ),
    "bulb-pull": _BULB,
    "turn-over-hand": _OVER_HAND,
    "slide-and-turn-over-hand": replace(_OVER_HAND, motion=replace(_OVER_HAND.motion, travel_m=0.004, speed_m_s=0.02)),
    "stick-slip": _STICK_SLIP,
    "stick-slip-bar": replace(_STICK_SLIP, contact=_BAR.contact, motion=_TURNING),
    "stick-slip-feet": replace(_STICK_SLIP, contact=_FEET, motion=_TURNING),
    "feet-lift": _FEET_LIFT,
    "two-contacts": _TWO,
    "two-contacts-meet": replace(
        _TWO,
        second=replace(
            _TWO.second,
            motion=replace(
                _TWO.second.motion,
                direction_rad=pi,
                travel_m=0.014,
                speed_m_s=0.007,
                angle_rad=pi / 2,
                middle_m=(0.0085, 0.0),
            ),
        ),
    ),
    "press": replace(
        _STILL,
        contact=Contact("hertz", radius_m=0.010, peak_pa=50e3),
        load=replace(_STILL.load, kind="cycles", multiples=(1.0, 5.0), growth=1 / 3),
    ),
    "roll": replace(_STILL, load=replace(_STILL.load, roll_m=0.005)),
    "tilt": replace(_STILL, load=replace(_STILL.load, tilt=0.6)),
    "hold-pressed": replace(_HOLD, load=replace(_HOLD.load, kind="cycles", multiples=(0.3, 1.5), cycles=30)),
    "hold-at-edge": replace(
        _HOLD,
        contact=Contact("hertz", radius_m=0.010, peak_pa=50e3),
        motion=replace(_HOLD.motion, middle_m=(0.024, 0.0)),
        load=replace(_HOLD.load, kind="cycles", multiples=(1.0, 5.0), cycles=30, growth=1 / 3),
    ),
    "hold-drifting": replace(_HOLD, sensing=replace(_HOLD.sensing, drift_pa_s=4e3 / 64)),
    "hold-wobbling": replace(_HOLD, sensing=replace(_HOLD.sensing, gain_wobble=0.02)),
}

DESCRIPTIONS = {
    "stroke": "The paper's experiment: an airbag slides back and forth over the palm at 25 mm/s.",
    "fast-stroke": "As stroke, at 50 mm/s.",
    "hertz-stroke": "As stroke, with an elastic sphere (Hertz contact).",
    "turn": "An elongated object turns in place on a Schunk finger.",
    "slide-and-turn": "As turn, with sliding.",
    "bar-on-grid": "An elongated object slides and turns by 120 degrees on a 16x16 grid: 150 scans.",
    "feet-on-grid": "As bar-on-grid, with an object on three feet.",
    "texture-on-grid": "A textured object slides 20 mm and turns by 23 degrees on a 32x32 grid: 200 scans.",
    "bulb-pull": "The paper's Fig. 4: a compliant bulb is pulled from left to right over all pads of the hand.",
    "turn-over-hand": "The paper's Fig. 7: an object on ten feet turns back and forth over two fingers and the palm.",
    "slide-and-turn-over-hand": "As turn-over-hand, with sliding.",
    "stick-slip": "A textured object sticks and slips on a 16x16 grid, at 100 Hz.",
    "stick-slip-bar": "As stick-slip, with an elongated object that turns as it slips.",
    "stick-slip-feet": "As stick-slip, with an object on three feet that turns as it slips.",
    "feet-lift": "A rigid object on four feet slides and turns; its feet lift and land one after the other.",
    "two-contacts": "Two objects on one pad slide past each other.",
    "two-contacts-meet": "Two objects on one pad; one of them approaches until they touch, and returns.",
    "press": "An elastic sphere is pressed with up to five times the force, without slip.",
    "roll": "An airbag rolls by 5 mm on the palm, without slip.",
    "tilt": "An airbag tilts on the palm, without slip.",
    "hold-pressed": "The object of stick-slip at rest for 60 s; the force varies fivefold every two seconds.",
    "hold-at-edge": "An elastic sphere at rest at the border of a 16x16 grid; the force varies fivefold.",
    "hold-drifting": "The object of stick-slip at rest while the offsets drift from 0 to 4 kPa.",
    "hold-wobbling": "The object of stick-slip at rest; a common gain varies by 2 % from scan to scan.",
}
