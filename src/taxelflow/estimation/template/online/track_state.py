"""State of a pad's track from scan to scan."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from taxelflow.messages import Floats
from taxelflow.numerics.records import Vector

StateVector = Annotated[Floats, 5]
"""A state, see `bspline`."""
StateMatrix = Annotated[Floats, 5, 5]


class _Keyframes(NamedTuple):
    """Keyframes of a map."""

    most: int = 60
    """Keyframes at most: more of them cost memory and time."""
    young: int = 12
    """A map of fewer keyframes is young: it is adopted sooner, and learns from every scan that does not fit."""
    near: float = 0.25
    """Scans whose places on the map are closer than this, in pitches, show the same, ..."""
    louder: float = 0.5
    """... as those whose gains' logarithms are closer than this; ..."""
    same: int = 5
    """... and this many keyframes that show the same are enough."""
    far: float = 1.0
    """In place of `near` for contacts whose size varies: what the size leaves unexplained seems to move them."""
    compared: int = 4
    """Keyframes from which hypotheses are compared."""
    more: float = 1.5
    """Factor of keyframes after which work on them is worth repeating."""


KEYFRAMES = _Keyframes()
FAINT = 3.0
"""A pattern from scans fainter by this factor is not worth keeping."""
NOTHING, NOVEL, GONE = range(3)
"""What a scan calls for: nothing, to be learned from, a new start."""


class Track:
    """One pad's contact as the stream follows it; lengths in pitches, angles in rad."""

    active: bool
    """Whether the pad has a pattern."""
    lattice: Vector
    """Of the pattern: knot spacing, x and y of knot (0, 0)."""
    state: StateVector
    """Of the object in the last scan."""
    origin: Annotated[Floats, 2]
    """Added to the state's x and y in what is reported."""
    information: StateMatrix
    """Of the state, the pattern held."""
    doubted: StateMatrix
    """The same, with the error that the sensor may have unseen."""
    step: StateMatrix
    """Information on how far the state is from that of the scan before."""
    error: float
    """Of a reading, as a share of the contact's largest."""
    amplitude: float
    """Largest reading of the keyframes."""
    usual: float
    """Chi-square per reading that its scans usually leave."""
    turns: bool
    """Whether theta may move; else it is held."""
    gain_std: float
    """How far the gain may, as a share of it."""
    chi: float
    """Chi-square per reading of the last scan."""
    count: float
    """Readings in it."""
    unexplained: float
    """Share of the last scan's readings, squared, that the pattern leaves."""
    strange: bool
    """Whether it leaves more of them than the error that the sensor may have unseen."""
    speed: Vector
    """From the scan before to the last one, per s."""
    persistence: Annotated[Floats, 2]
    """Products of a step and the one before it, and squares of the latter: sums that fade within about a second."""
    last_t: float
    """Time of the last registered scan, s."""
    centroid: Annotated[Floats, 2]
    load: float
    """Of the last scan: place and sum of the loaded readings."""
    border: float
    """Share of them at the pad's border."""
    centroid_covariance: Annotated[Floats, 9]
    """See `numerics.centroid`."""
    hidden: Annotated[Floats, 4]
    """What the border hides of a motion from that place, see `numerics.cut`."""
    open: Annotated[Floats, 2]
    """How far the place may be off, in pitches, along the direction in which no reading shows a motion; 0 if none."""
    undecided: bool
    """Whether the pattern is still to show if there is such a direction."""
    reach: float
    """See `observations.reach`."""
    arm: Annotated[Floats, 2]
    """From the place of the state to the point of the object that is reported, when it was at angle 0."""
    gauge: Annotated[Floats, 2]
    """Added to the arm in what is reported, see `gauge`."""
    inside: Annotated[Floats, 2]
    """From the place of the state to the centre of the pressure that the pattern shows where no border cuts it, when it
    was at angle 0; NaN before keyframes were adjusted."""
    shift: Annotated[Floats, 2]
    """By how much the border moves that centre in the last scan."""
    sure: Annotated[Floats, 2]
    """What of it is more than errors explain."""
    arm_load: float
    """Sum of the loads of the scans whose centre of pressure that point is."""
    start: Annotated[Floats, 2]
    """Where that was when the contact began."""
    radius: float
    """Of gyration of the pattern."""
    seen: bool
    """Whether theta is reported."""
    theta_0: float
    """Where it counts from."""
    poor: float
    """Scans in a row that do not fit, ..."""
    poor_s: float
    """... and the time of the first of them, s."""
    learned_s: float
    """Time of the newest scan that the pattern has been learned from, s."""
    continues: bool
    """Whether the scan before was registered, on this pattern."""
    slack: float
    slack_t: float
    """Variance of x and y, and of theta, from errors of the pattern."""
    tilt: Annotated[Floats, 3]
    """See `LocalMap`."""
    broken: float
    """Variance of x and y since the contact began, where it was lost."""
    wander: float
    """Variance of x and y by the frames of maps: how far keyframes were reported from where the map has them, beyond
    the variance that they were reported with."""
    cut: bool
    """Whether this contact has ever been cut by the border."""
    probation: float
    """Scans for which a recognised pattern is looked for all over the pad."""
    grows: bool
    """Whether the contact has been seen to grow with the load."""
    away: float
    """How far the object has been from its first keyframe."""
    turned: bool
    """Whether a scan was explained by a turn although theta was fixed."""
    place: Vector
    """Where the object has been lately."""
    shifted: Vector
    """By how much a new pattern has moved its newest keyframe: from there, too, the last scan is registered again."""
    carries: bool
    """Whether a rest is carried from scan to scan, see `residual_process`."""
    changing: bool
    """Whether the pattern does not stay: every scan is learned from, and the old forgotten."""
    across: Annotated[Floats, 2]
    """How far x and y may be off where they lead across a line of taxels; 0 where they are observed."""
    flag: int
    """What the last scan calls for."""
    before: Vector
    """Pose given out before on the same pattern, m and rad."""
    before_covariance: Annotated[Floats, 3, 3]
    before_centre: Annotated[Floats, 5]
    """Where the centre of pressure was then, m, and xx, xy and yy of that by noise, m^2."""
    before_t: float
    keyframes: int
    keyframe: Annotated[Floats, KEYFRAMES.most, 5]
    """States of the scans that the pattern is learned from."""
