"""The protocol of a controller, and what it is told of each scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


@dataclass(frozen=True, slots=True)
class Touch:
    """What two facing pads tell of one scan.

    The grip's frame is that of the first pad: x to its right, y up. The second pad's motion is mirrored into it.
    t_s, dt_s: time, and time since the scan before. pressure: (2, taxels), Pa. force_n: mean of both pads' normal
    forces. slipping: (2,), by the slip detector. velocity: (2, 3), of the object, m/s, m/s, rad/s; NaN where unknown.
    covariance: (2, 3, 3), of the velocity of an object at rest, by the noise of the readings alone.
    detail_m: (2,), how far the object has to move, in the direction in which that is least, to change a pad's image by
    as much as the image itself; NaN where unknown.
    ready: False while the conditioner learns noise and tare.
    """

    t_s: float
    dt_s: float
    pressure: Floats
    force_n: float
    slipping: Bools
    velocity: Floats
    covariance: Floats
    detail_m: Floats
    ready: bool = True


class ControlSession(Protocol):
    """A controller at work."""

    def step(self, touch: Touch) -> float:
        """The force per pad to command until the next scan, N."""
        ...


class Controller(Protocol):
    """A controller's parameters."""

    @property
    def method(self) -> str | None:
        """The estimator whose velocities it needs; None if it needs none."""
        ...

    def start(self, force_n: float, most_n: float) -> ControlSession:
        """Take over a grip of `force_n` per pad, with a gripper that gives `most_n` at most."""
        ...
