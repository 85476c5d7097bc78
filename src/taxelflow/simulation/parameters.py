"""Parameters of the rig: the object in contact, its motion, its load, and the errors of the sensor."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot
from typing import Literal, get_args

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import not_negative, numeric, positive, within
from taxelflow.sensors.pads import LARGEST

Shape = Literal["airbag", "hertz", "elongated", "feet", "textured", "bulb"]
LONG = ("elongated", "bulb")
"""Shapes with a long axis, `aspect` times the width."""
TEXTURED = ("textured", "bulb")
"""Shapes with a random texture."""
_MOST_COUNT = 10_000
"""Largest number of feet, cycles or steps."""


@dataclass(frozen=True)
class Contact:
    """A compliant object pressed on the skin; its frame has the x axis along the object's long axis."""

    shape: Shape = "airbag"
    """Pressure distribution. airbag: super-Gaussian, flat with soft edges. hertz: Hertz contact of an elastic sphere.
    elongated: an airbag `aspect` times as long as wide. feet: small airbags of different peaks. textured: an airbag
    with a smooth random texture. bulb: elongated and textured."""
    radius_m: float = 0.015
    """Radius, m; half the width of elongated and bulb; radius of one foot of feet."""
    aspect: float = 2.5
    """Ratio of length to width, of elongated and bulb."""
    peak_pa: float = 80e3
    """Largest pressure without texture, Pa."""
    feet: int = 3
    """Number of feet."""
    feet_on: Literal["ring", "disc"] = "ring"
    """Arrangement of the feet. ring: evenly on a circle. disc: evenly over the disc, without a lattice."""
    ring_m: float = 0.012
    """Radius of the ring or disc through the feet's centres, m."""
    feet_at_m: tuple[tuple[float, float], ...] = ()
    """Positions of the feet in the object's frame, m; replaces `feet`, `feet_on` and `ring_m`."""
    texture: float = 0.3
    """Standard deviation of the texture relative to the pressure, of textured and bulb."""
    wavelength_m: float = 0.012
    """Wavelength of the texture, m; wavelengths are drawn between 0.7 and 1.5 times this."""
    deform_1_m: float = 0.0
    """Deformation of the object, cycles per metre travelled: the width varies by 10 %, and the phases of the texture
    drift. 0: a rigid pattern."""

    def __post_init__(self) -> None:
        if self.shape not in get_args(Shape):
            raise ParameterInvalid("contact.shape", self.shape, f"be one of {', '.join(get_args(Shape))}")
        positive("contact.radius_m", self.radius_m)
        positive("contact.aspect", self.aspect)
        positive("contact.peak_pa", self.peak_pa)
        positive("contact.wavelength_m", self.wavelength_m)
        within("contact.feet", self.feet, 1, _MOST_COUNT)
        within("contact.texture", self.texture, 0.0, 1.0)
        not_negative("contact.ring_m", self.ring_m)
        not_negative("contact.deform_1_m", self.deform_1_m)
        _bounded("contact.feet_at_m", *(number for place in self.feet_at_m for number in place))

    @property
    def length_m(self) -> float:
        """Half the length along the object's long axis, m; radius of one foot of feet."""
        return self.radius_m * (self.aspect if self.shape in LONG else 1.0)

    @property
    def reach_m(self) -> float:
        """Distance from the object's centre to its farthest edge, m."""
        if self.shape == "feet":
            return max((hypot(*place) for place in self.feet_at_m), default=self.ring_m) + self.radius_m
        return max(self.length_m, self.radius_m)


@dataclass(frozen=True)
class Motion:
    """Motion of the object: back-and-forth strokes along a line with a rotation, or stick-slip.

    Coordinates are in the frame of the scenario's pad, or in the hand frame.
    """

    kind: Literal["strokes", "stick-slip"] = "strokes"
    """Kind of motion. strokes: back and forth; a single stroke is a pull. stick-slip: alternating random holds and
    slips."""
    speed_m_s: float = 0.025
    """Speed along the line, m/s."""
    direction_rad: float = 3.141592653589793
    """Direction of the first stroke, rad; pi (along -x) as in the paper."""
    travel_m: float = 0.175
    """Length of a stroke, m, centred at `middle_m`; 0 rotates the object in place. Stick-slip stays within half of this
    distance from the middle."""
    strokes: int = 2
    """Number of strokes; each reverses the previous one."""
    turn_rad_s: float = 0.0
    """Turn rate during strokes, rad/s; its sign alternates with the strokes. In stick-slip: largest turn rate of a
    slip."""
    turn_s: float = 2.0
    """Duration of a stroke without travel, s."""
    centre_m: tuple[float, float] | None = None
    """Centre of rotation at the middle of the line, m; it moves with the object. Default: the object's centre."""
    angle_rad: float = 0.0
    """Angle of the object's long axis at the start, rad."""
    middle_m: tuple[float, float] = (0.0, 0.005)
    """Middle of the line, m; y = 0.005 is the second row of the palm."""
    rest_s: float = 3.0
    """Duration of the rest before and after the motion, s."""
    stick_slip_s: float = 10.0
    """Duration of the stick-slip motion, s."""
    interval_s: tuple[float, float] = (0.15, 0.4)
    """Shortest and longest duration of a hold or slip, s."""
    slip_m_s: tuple[float, float] = (0.003, 0.015)
    """Lowest and highest speed of a slip, m/s."""

    def __post_init__(self) -> None:
        for name in ("speed_m_s", "turn_s", "strokes", "stick_slip_s"):
            positive(f"motion.{name}", getattr(self, name))
        for name in ("rest_s", "travel_m"):
            not_negative(f"motion.{name}", getattr(self, name))
        for name in ("direction_rad", "turn_rad_s", "angle_rad"):
            _bounded(f"motion.{name}", getattr(self, name))
        _bounded("motion.middle_m", *self.middle_m)
        _bounded("motion.centre_m", *(self.centre_m or ()))
        _ordered("motion.interval_s", self.interval_s)
        _ordered("motion.slip_m_s", self.slip_m_s)
        if self.kind == "stick-slip" and self.travel_m < 2 * self.interval_s[1] * self.slip_m_s[1]:
            duty = f"be at least {2 * self.interval_s[1] * self.slip_m_s[1]:.4g} m, twice the longest slip"
            raise ParameterInvalid("motion.travel_m", self.travel_m, duty)

    @property
    def stroke_s(self) -> float:
        """Duration of one stroke, s."""
        return self.travel_m / self.speed_m_s or self.turn_s

    @property
    def moving_s(self) -> float:
        """Duration between the two rests, s."""
        return self.stick_slip_s if self.kind == "stick-slip" else self.strokes * self.stroke_s

    @property
    def duration_s(self) -> float:
        """Duration of the recording, s."""
        return 2 * self.rest_s + self.moving_s


@dataclass(frozen=True)
class Load:
    """Normal force during the motion, and changes of the pressure without slip: tilt, roll, lifting feet, lift-off."""

    kind: Literal["constant", "ramp", "cycles"] = "constant"
    """Force over time. constant: the nominal force, which gives `contact.peak_pa`. ramp: linear from the first to the
    second multiple of it. cycles: sinusoidal between the two multiples."""
    multiples: tuple[float, float] = (1.0, 1.0)
    """First and second multiple of the nominal force, for ramp and cycles."""
    cycles: int = 3
    """Number of cycles."""
    growth: float = 0.0
    """Exponent g: the radius grows as force^g, the peak as force^(1 - 2 g); 1/3 for a Hertz contact, 0 for a constant
    radius. Ignored by the elastic solver."""
    tilt: float = 0.0
    """Relative change of the pressure at the object's edge at the end of the motion: + on one side, - on the other."""
    roll_m: float = 0.0
    """Distance by which the pressure moves as the object rolls without slip, m; the texture does not move."""
    towards_rad: float = 0.0
    """Direction of tilt and roll in the object's frame, rad."""
    steps: int = 0
    """Number of times that a foot lifts and lands during the motion, one after the other; for contact.shape feet."""
    lift_s: float = 0.0
    """Duration without contact at the start and at the end, s; at most motion.rest_s."""

    def __post_init__(self) -> None:
        for multiple in self.multiples:
            positive("load.multiples", multiple)
        within("load.cycles", self.cycles, 1, _MOST_COUNT)
        within("load.growth", self.growth, 0.0, 0.5)
        within("load.tilt", self.tilt, -1.0, 1.0)
        _bounded("load.roll_m", self.roll_m)
        _bounded("load.towards_rad", self.towards_rad)
        not_negative("load.lift_s", self.lift_s)
        within("load.steps", self.steps, 0, _MOST_COUNT)

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest multiple of the nominal force during contact."""
        return (1.0, 1.0) if self.kind == "constant" else (min(self.multiples), max(self.multiples))


@dataclass(frozen=True)
class Second:
    """A second, independent object on the same pad."""

    there: bool = False
    """Add the second object."""
    contact: Contact = field(default_factory=Contact)
    motion: Motion = field(default_factory=Motion)
    load: Load = field(default_factory=Load)


@dataclass(frozen=True)
class Sensing:
    """Properties and errors of the sensor. Defaults: the paper's sensor, with estimated errors."""

    rate_hz: float = 7.0
    """Scan rate, Hz."""
    noise_pa: float = 750.0
    """Standard deviation of the noise of a reading, Pa."""
    gain_spread: float = 0.0
    """Standard deviation of the taxels' gains, mean 1."""
    gain_wobble: float = 0.0
    """Standard deviation of a gain common to all taxels, drawn for each scan, mean 1."""
    baseline_pa: tuple[float, float] = (1e3, 4e3)
    """Smallest and largest offset of a taxel, Pa."""
    drift_pa_s: float = 0.0
    """Mean drift rate of the offsets, Pa/s; rates of taxels have a standard deviation of 30 % of it."""
    scan_share: float = 0.0
    """Share of the scan period, 0 to 1, during which the taxels are read in sequence (rolling scan); the time stamp is
    that of the start. 0: all taxels at once."""
    jitter_s: float = 0.0
    """Standard deviation of the time stamps' error, s; limited to 0.45 scan periods."""
    bits: int = 10
    """Resolution of the full scale, bits."""
    full_scale_pa: float = 140e3
    """Largest reading (full scale), Pa: readings are clipped to 0 and to this."""
    active_share: float = 0.9
    """Side of a taxel's sensitive area divided by the pitch, above 0 and at most 1."""
    dead: tuple[int, ...] = ()
    """Numbers of dead taxels in the scan, which read offset and noise only."""

    def __post_init__(self) -> None:
        numeric(self, "sensing.")
        positive("sensing.rate_hz", self.rate_hz)
        positive("sensing.full_scale_pa", self.full_scale_pa)
        for name in ("noise_pa", "gain_spread", "gain_wobble", "jitter_s"):
            not_negative(f"sensing.{name}", getattr(self, name))
        _bounded("sensing.drift_pa_s", self.drift_pa_s)
        low, high = self.baseline_pa
        if not float("-inf") < low <= high < float("inf"):
            raise ParameterInvalid("sensing.baseline_pa", self.baseline_pa, "be two numbers in Pa, smaller first")
        within("sensing.scan_share", self.scan_share, 0.0, 1.0)
        within("sensing.bits", self.bits, 1, 32)
        if not 0 < self.active_share <= 1:
            raise ParameterInvalid("sensing.active_share", self.active_share, "be above 0 and at most 1")


def _bounded(name: str, *numbers: float) -> None:
    """Each a number of either sign, none absurdly large."""
    for number in numbers:
        within(name, number, -LARGEST, LARGEST)


def _ordered(name: str, span: tuple[float, float]) -> None:
    if not 0 < span[0] <= span[1]:
        raise ParameterInvalid(name, span, "be two numbers above 0, smaller first")
