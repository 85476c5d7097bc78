"""Parameters of the rig: what touches the skin, how it moves, how hard it is pressed, what the sensor does to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot
from typing import Literal, get_args

from taxelflow.errors import ParameterInvalid

Shape = Literal["airbag", "hertz", "elongated", "feet", "textured", "bulb"]
LONG = ("elongated", "bulb")
TEXTURED = ("textured", "bulb")


@dataclass(frozen=True)
class Contact:
    """A compliant object pressed on the skin: its pressure, in a frame whose x axis is the object's long one."""

    shape: Shape = "airbag"
    """airbag: super-Gaussian, flat with soft edges. hertz: the dome of an elastic sphere. elongated: an airbag whose
    length is `aspect` times its width. feet: small soft domes, unequally high. textured: an airbag with a random smooth
    texture. bulb: elongated and textured."""
    radius_m: float = 0.015
    """Radius, or half the width of a long contact, or the radius of one foot, m."""
    aspect: float = 2.5
    """Length over width of a long contact (elongated, bulb)."""
    peak_pa: float = 80e3
    """Largest pressure, Pa; a texture comes on top."""
    feet: int = 3
    """Number of feet."""
    feet_on: Literal["ring", "disc"] = "ring"
    """ring: feet evenly around the object's centre. disc: spread evenly over the whole disc, in no lattice."""
    ring_m: float = 0.012
    """Radius of the ring or disc on which the feet's centres lie, m."""
    feet_at_m: tuple[tuple[float, float], ...] = ()
    """Places of the feet in the object's frame, m; if given, number and ring count for nothing."""
    texture: float = 0.3
    """Standard deviation of the texture (textured, bulb) over the pressure without it."""
    wavelength_m: float = 0.012
    """Typical wavelength of the texture, m; the seed draws waves between 0.7 and 1.5 times it."""
    deform_1_m: float = 0.0
    """Cycles of deformation per metre travelled: the width swings by 10 % and the texture's waves drift through their
    phases; 0 is an object whose pattern never changes."""

    def __post_init__(self) -> None:
        if self.shape not in get_args(Shape):
            raise ParameterInvalid("contact.shape", self.shape, f"be one of {', '.join(get_args(Shape))}")
        _positive("contact.radius_m", self.radius_m)
        _positive("contact.aspect", self.aspect)
        _positive("contact.peak_pa", self.peak_pa)
        _positive("contact.wavelength_m", self.wavelength_m)
        _within("contact.feet", self.feet, 1, 10_000)
        _within("contact.texture", self.texture, 0.0, 1.0)
        _not_negative("contact.ring_m", self.ring_m)
        _not_negative("contact.deform_1_m", self.deform_1_m)

    @property
    def length_m(self) -> float:
        """Half the length along the object's long axis; of one foot, its radius."""
        return self.radius_m * (self.aspect if self.shape in LONG else 1.0)

    @property
    def reach_m(self) -> float:
        """From the object's centre to its furthest edge."""
        if self.shape == "feet":
            return max((hypot(*place) for place in self.feet_at_m), default=self.ring_m) + self.radius_m
        return max(self.length_m, self.radius_m)


@dataclass(frozen=True)
class Motion:
    """A robot moves the object: strokes to and fro along a line, turning it as it goes, or stick and slip.

    Coordinates are those of the scenario's pad, or of the hand.
    """

    kind: Literal["strokes", "stick-slip"] = "strokes"
    """strokes: to and fro; one stroke is a pull. stick-slip: holds and slips take turns, drawn from the seed."""
    speed_m_s: float = 0.025
    """Speed along the line, m/s."""
    direction_rad: float = 3.141592653589793
    """Direction of the first stroke, rad; pi is along -x, as in the paper."""
    travel_m: float = 0.175
    """Length of a stroke, m, centred on the line's middle; 0 turns the object in place. Stick and slip stay within
    half of it from the middle."""
    strokes: int = 2
    """Strokes, each back along the one before."""
    turn_rad_s: float = 0.0
    """Rate of turn during the strokes, rad/s; it changes sign with the stroke. A slip's rate is drawn up to it."""
    turn_s: float = 2.0
    """Duration of a stroke without travel, s."""
    centre_m: tuple[float, float] | None = None
    """The object turns about this point, which slides along with it, m; about its own centre if left out."""
    angle_rad: float = 0.0
    """Angle of the object's long axis at the start, rad."""
    middle_m: tuple[float, float] = (0.0, 0.005)
    """Middle of the line, m; y = 5 mm is the palm's second row."""
    rest_s: float = 3.0
    """Rest before the motion and after it, s."""
    stick_slip_s: float = 10.0
    """Duration of stick and slip, s."""
    interval_s: tuple[float, float] = (0.15, 0.4)
    """Shortest and longest hold or slip, s."""
    slip_m_s: tuple[float, float] = (0.003, 0.015)
    """Slowest and fastest slip, m/s."""

    def __post_init__(self) -> None:
        for name in ("speed_m_s", "turn_s", "strokes", "stick_slip_s"):
            _positive(f"motion.{name}", getattr(self, name))
        for name in ("rest_s", "travel_m"):
            _not_negative(f"motion.{name}", getattr(self, name))
        for number in (self.direction_rad, self.turn_rad_s, self.angle_rad, *self.middle_m):
            _within("each of motion.direction_rad, turn_rad_s, angle_rad and middle_m", number, -1e6, 1e6)
        _ordered("motion.interval_s", self.interval_s)
        _ordered("motion.slip_m_s", self.slip_m_s)
        if self.kind == "stick-slip" and self.travel_m < 2 * self.interval_s[1] * self.slip_m_s[1]:
            duty = f"be at least {2 * self.interval_s[1] * self.slip_m_s[1]:.4g} m, twice the longest slip"
            raise ParameterInvalid("motion.travel_m", self.travel_m, duty)

    @property
    def stroke_s(self) -> float:
        """Duration of one stroke."""
        return self.travel_m / self.speed_m_s or self.turn_s

    @property
    def moving_s(self) -> float:
        """Duration between the two rests."""
        return self.stick_slip_s if self.kind == "stick-slip" else self.strokes * self.stroke_s

    @property
    def duration_s(self) -> float:
        """From the first scan to the last."""
        return 2 * self.rest_s + self.moving_s


@dataclass(frozen=True)
class Load:
    """How hard the object is pressed between the two rests, and how its pressure shifts without any slip."""

    kind: Literal["constant", "ramp", "cycles"] = "constant"
    """constant: the force that gives the contact's peak. ramp: from the first to the second multiple of that force.
    cycles: to and fro between them."""
    multiples: tuple[float, float] = (1.0, 1.0)
    """Multiples of the force for ramp and cycles."""
    cycles: int = 3
    """Number of cycles."""
    growth: float = 0.0
    """The contact's radius grows as the force to this power, 1/3 for a Hertz contact, and its peak as what is left of
    it; 0 leaves all to the peak. The elastic solver finds its own."""
    tilt: float = 0.0
    """Tilt at the end: pressure at the contact's edge rises by this share on one side and falls on the other."""
    roll_m: float = 0.0
    """The object rolls without slip, and its pressure moves this far; a texture stays where it touches, m."""
    towards_rad: float = 0.0
    """Direction of tilt and roll, from the object's long axis, rad."""
    steps: int = 0
    """Feet (of a contact of feet) lift one by one and come down again, the first one first, so many in all while the
    object moves; it stays rigid."""
    lift_s: float = 0.0
    """Time at the start and at the end during which the object is off the skin, s; the sensor is idle then."""

    def __post_init__(self) -> None:
        for multiple in self.multiples:
            _positive("load.multiples", multiple)
        _within("load.cycles", self.cycles, 1, 10_000)
        _within("load.growth", self.growth, 0.0, 0.5)
        _within("load.tilt", self.tilt, -1.0, 1.0)
        _not_negative("load.lift_s", self.lift_s)
        _within("load.steps", self.steps, 0, 10_000)

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest multiple of the force while in contact."""
        return (1.0, 1.0) if self.kind == "constant" else (min(self.multiples), max(self.multiples))


@dataclass(frozen=True)
class Second:
    """A second object on the same pad, which moves as it likes."""

    there: bool = False
    """Whether there is one."""
    contact: Contact = field(default_factory=Contact)
    motion: Motion = field(default_factory=Motion)
    load: Load = field(default_factory=Load)


@dataclass(frozen=True)
class Sensing:
    """What the sensor makes of the pressure. Defaults are those of the paper's kit, its faults estimated."""

    rate_hz: float = 7.0
    """Scans per second."""
    noise_pa: float = 750.0
    """Standard deviation of a reading, Pa."""
    gain_spread: float = 0.0
    """Standard deviation of the taxels' gains around 1."""
    gain_wobble: float = 0.0
    """Standard deviation, from scan to scan, of a gain that all taxels share."""
    baseline_pa: tuple[float, float] = (1e3, 4e3)
    """Range of the taxels' offsets, Pa."""
    drift_pa_s: float = 0.0
    """Drift of the offsets, Pa/s; each taxel has a rate of its own, 30 % around it."""
    scan_share: float = 0.0
    """Share of the scan period over which the taxels are read one after the other; times are those of the scan's
    start. 0 reads all at once."""
    jitter_s: float = 0.0
    """Standard deviation of the reported times around the true ones, s; never beyond 0.45 of a period."""
    bits: int = 10
    """Resolution over the full scale."""
    full_scale_pa: float = 140e3
    """Readings saturate here, Pa, and at 0."""
    active_share: float = 0.9
    """Share of the pitch that is sensitive, along each axis."""
    dead: tuple[int, ...] = ()
    """Taxels, by their number in the scan, that read only noise around their offset."""

    def __post_init__(self) -> None:
        _positive("sensing.rate_hz", self.rate_hz)
        _positive("sensing.full_scale_pa", self.full_scale_pa)
        for name in ("noise_pa", "gain_spread", "gain_wobble", "jitter_s"):
            _not_negative(f"sensing.{name}", getattr(self, name))
        low, high = self.baseline_pa
        if not float("-inf") < low <= high < float("inf"):
            raise ParameterInvalid("sensing.baseline_pa", self.baseline_pa, "be two numbers in Pa, smaller first")
        _within("sensing.scan_share", self.scan_share, 0.0, 1.0)
        _within("sensing.bits", self.bits, 1, 32)
        if not 0 < self.active_share <= 1:
            raise ParameterInvalid("sensing.active_share", self.active_share, "be above 0 and at most 1")


def _positive(name: str, value: float) -> None:
    if not 0 < value < float("inf"):
        raise ParameterInvalid(name, value, "be a finite number above 0")


def _not_negative(name: str, value: float) -> None:
    if not 0 <= value < float("inf"):
        raise ParameterInvalid(name, value, "be 0 or more")


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ParameterInvalid(name, value, f"be between {low:g} and {high:g}")


def _ordered(name: str, span: tuple[float, float]) -> None:
    if not 0 < span[0] <= span[1]:
        raise ParameterInvalid(name, span, "be two numbers above 0, smaller first")
