"""The protocol of a controller, and its input in each scan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


@dataclass(frozen=True, slots=True)
class Touch:
    """Estimates of the pads of a grip in one scan.

    The grip's frame of two facing pads is that of the first: x to its right, y up; the second pad's motion is mirrored
    into it. That of a hand is the hand's frame in space.
    t_s, dt_s: time, and time since the scan before. pressure: of all taxels, Pa, (2, taxels) of facing pads. force_n:
    half of all pads' normal forces: with facing pads the mean of both. slipping: (pads,), by the slip detector.
    velocity: (pads, 3), of the object along each pad, m/s, m/s, rad/s; NaN where unknown. axes: (pads, 2, n), the
    directions of its first two components in the grip's frame, n = 2 for facing pads and 3 for a hand.
    covariance: (pads, 3, 3), of the velocity of an object at rest, by the noise of the readings alone.
    detail_m: (pads,), how far the object has to move along its load to change a pad's image by as much as the image
    itself, NaN where unknown; if the load's direction is unknown, in the direction in which that is least.
    place_m: (pads, 2), place on the pad of the point of the object whose velocity is given; NaN where unknown.
    ready: False while the conditioner learns noise and tare.
    """

    t_s: float
    dt_s: float
    pressure: Floats
    force_n: float
    slipping: Bools
    velocity: Floats
    axes: Floats
    covariance: Floats
    detail_m: Floats
    place_m: Floats
    ready: bool = True

    def of_point(self, point_m: Floats) -> Touch:
        """Velocities of facing pads at another point (2,) of the object, m, which differ where it turns.

        Each pad is moved by its own turn, so that errors stay independent; where it has none, by that of the other.
        Unchanged where no turn is known, and for a hand, whose pads lie in different planes.
        """
        turn, known = self.velocity[:, 2], np.isfinite(self.velocity[:, 2])
        if self.axes.shape[-1] != 2 or not known.any():
            return self
        turn = np.where(known, turn, turn[known].mean())
        x, y = np.nan_to_num(point_m - self.place_m).T
        velocity, lever = self.velocity.copy(), np.tile(np.eye(3), (len(turn), 1, 1))
        velocity[:, :2] += turn[:, np.newaxis] * np.stack([-y, x], axis=1)
        lever[:, 0, 2], lever[:, 1, 2] = -y, x
        covariance = np.where(np.isfinite(self.covariance), self.covariance, 0.0)  # of a turn that is not known
        moved = np.where(
            known[:, np.newaxis, np.newaxis], lever @ covariance @ lever.transpose(0, 2, 1), self.covariance
        )
        return replace(self, velocity=velocity, covariance=moved)


class ControlSession(Protocol):
    """A controller at work."""

    def step(self, touch: Touch) -> float:
        """The force to command until the next scan, in the sense of `Touch.force_n`, N."""
        ...


class Controller(Protocol):
    """A controller's parameters."""

    @property
    def method(self) -> str | None:
        """The estimator whose velocities it needs; None if it needs none."""
        ...

    def start(self, force_n: float, most_n: float) -> ControlSession:
        """Take over a grip of `force_n`, with a gripper or hand that gives `most_n` at most."""
        ...
