"""Scenarios of the rig: what touches which pad, how it moves, and what is wrong with the sensor."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from taxelflow.errors import ParameterInvalid


@dataclass(frozen=True)
class Contact:
    """A compliant object pressed on a pad: its pressure over the skin."""

    shape: Literal["airbag", "hertz", "elongated"] = "airbag"
    """airbag: super-Gaussian, flat with soft edges. hertz: the dome of an elastic sphere. elongated: an airbag whose
    length is `aspect` times its width."""
    radius_m: float = 0.015
    """Radius, or half the width of an elongated contact, m."""
    aspect: float = 2.5
    """Length over width of an elongated contact."""
    peak_pa: float = 80e3
    """Largest pressure, Pa."""

    def __post_init__(self) -> None:
        _positive("contact radius_m", self.radius_m)
        _positive("contact aspect", self.aspect)
        _positive("contact peak_pa", self.peak_pa)


@dataclass(frozen=True)
class Motion:
    """A robot moves the object to and fro along a straight line, turning it as it goes."""

    speed_m_s: float = 0.025
    """Speed along the line, m/s."""
    direction_rad: float = 3.141592653589793
    """Direction of the first stroke in the pad's frame, rad; pi is along -x, as in the paper."""
    travel_m: float = 0.175
    """Length of a stroke, m, centred on the line's middle; 0 turns the object in place."""
    strokes: int = 2
    """Strokes, each back along the one before."""
    turn_rad_s: float = 0.0
    """Rate of turn during the strokes, rad/s; it changes sign with the stroke."""
    turn_s: float = 2.0
    """Duration of a stroke that only turns, s."""
    angle_rad: float = 0.0
    """Angle of the object's long axis at the start, rad."""
    middle_m: tuple[float, float] = (0.0, 0.005)
    """Middle of the line in the pad's frame, m; y = 5 mm is the palm's second row."""
    rest_s: float = 3.0
    """Rest before the first stroke and after the last, s."""

    def __post_init__(self) -> None:
        _positive("motion speed_m_s", self.speed_m_s)
        _positive("motion turn_s", self.turn_s)
        _positive("motion strokes", self.strokes)
        if self.rest_s < 0 or self.travel_m < 0:
            raise ParameterInvalid("motion rest_s or travel_m", min(self.rest_s, self.travel_m), "both are 0 or more")

    @property
    def stroke_s(self) -> float:
        """Duration of one stroke."""
        return self.travel_m / self.speed_m_s or self.turn_s

    @property
    def duration_s(self) -> float:
        """From the first scan to the last."""
        return 2 * self.rest_s + self.strokes * self.stroke_s


@dataclass(frozen=True)
class Sensing:
    """What the sensor makes of the pressure. Defaults are those of the paper's kit, its faults estimated."""

    rate_hz: float = 7.0
    """Scans per second."""
    noise_pa: float = 750.0
    """Standard deviation of a reading, Pa."""
    gain_spread: float = 0.0
    """Standard deviation of the taxels' gains around 1."""
    baseline_pa: tuple[float, float] = (1e3, 4e3)
    """Range of the taxels' offsets, Pa."""
    bits: int = 10
    """Resolution over the full scale."""
    full_scale_pa: float = 140e3
    """Readings saturate here, Pa, and at 0."""
    active_share: float = 0.9
    """Share of the pitch that is sensitive, along each axis."""
    dead: tuple[int, ...] = ()
    """Taxels, by their number in the scan, that read only noise around their offset."""

    def __post_init__(self) -> None:
        _positive("sensing rate_hz", self.rate_hz)
        _positive("sensing full_scale_pa", self.full_scale_pa)
        if self.noise_pa < 0 or self.gain_spread < 0:
            raise ParameterInvalid(
                "sensing noise_pa or gain_spread", min(self.noise_pa, self.gain_spread), "both are 0 or more"
            )
        if not 1 <= self.bits <= 32:
            raise ParameterInvalid("sensing bits", self.bits, "it lies between 1 and 32")
        if not 0 < self.active_share <= 1:
            raise ParameterInvalid("sensing active_share", self.active_share, "it lies above 0, up to 1")


@dataclass(frozen=True)
class Scenario:
    """One simulated recording; the seed makes it repeatable."""

    sensor: str = "barretthand-162"
    """A built-in sensor or a TOML file."""
    pad: str = "palm"
    """The pad that is touched; all others see their offsets and noise."""
    seed: int = 0
    contact: Contact = field(default_factory=Contact)
    motion: Motion = field(default_factory=Motion)
    sensing: Sensing = field(default_factory=Sensing)


def _positive(name: str, value: float) -> None:
    if not value > 0:
        raise ParameterInvalid(name, value, "it is above 0")


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

SCENARIOS = {
    "stroke": _PAPER,
    "fast-stroke": replace(_PAPER, motion=replace(_PAPER.motion, speed_m_s=0.050)),
    "hertz-stroke": replace(_PAPER, contact=Contact("hertz", radius_m=0.017)),
    "turn": replace(_SDH, motion=replace(_SDH.motion, travel_m=0.0, turn_rad_s=1.0)),
    "slide-and-turn": replace(_SDH, motion=replace(_SDH.motion, turn_rad_s=0.8)),
}

DESCRIPTIONS = {
    "stroke": "The paper's experiment: an airbag slid back and forth over the palm at 25 mm/s.",
    "fast-stroke": "The same at 50 mm/s.",
    "hertz-stroke": "The same with an elastic sphere, whose pressure is a Hertz dome.",
    "turn": "An elongated object turned in place on a Schunk finger.",
    "slide-and-turn": "The same, turned while it slides.",
}
