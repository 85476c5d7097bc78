"""The protocol of a controller, and its input in each scan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats

_LONGEST_S = 0.5
"""Time from one scan to the next for which a force is relaxed, at most."""


@dataclass(frozen=True, slots=True)
class Touch:
    """Estimates of the pads of a grip in one scan.

    The grip's frame of two facing pads is that of the first: x to its right, y up; the second pad's motion is mirrored
    into it. That of a hand is the hand's frame in space.
    t_s, dt_s: time, and time since the scan before. pressure: of all taxels, Pa, (2, taxels) of facing pads. force_n:
    half of all pads' normal forces: with facing pads the mean of both. slipping: (pads,), by the slip detector; where
    the pose decides, also slips that are only suspected: the object may fall. velocity: (pads, 3), of the object along
    each pad, m/s, m/s, rad/s; NaN where unknown. axes: (pads, 2, n), the directions of its first two components in the
    grip's frame, n = 2 for facing pads and 3 for a hand. covariance: (pads, 3, 3), of the velocity of an object at
    rest, by the noise of the readings alone. detail_m: (pads,), how far the object has to move along its load to change
    a pad's image by as much as the image itself, NaN where unknown; if the load's direction is unknown, in the
    direction in which that is least. place_m: (pads, 2), place on the pad of the point of the object whose velocity is
    given; NaN where unknown. ready: False while the conditioner learns noise and tare. place_std_m: (pads,), standard
    deviation of that place along each axis; None for 0. joint: (pads, 3, pads, 3), covariance of all velocities, whose
    diagonal blocks are `covariance`; None if the pads are independent of each other. by_taxel_m2: (pads, 2, 2),
    covariance of how far an object at rest seems to move if each reading changes by as much as it is, independently of
    the others; NaN where unknown. It is the square of the detail in each direction, over the number of loaded taxels.
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
    place_std_m: Floats | None = None
    joint: Floats | None = None
    by_taxel_m2: Floats | None = None

    def of_point(self, point_m: Floats) -> Touch:
        """Velocities of facing pads at another point (2,) of the object, m, which differ where it turns.

        Each pad is moved by its own turn, so that errors stay independent; where it has none, by that of the other:
        then both have the errors of that turn, and `joint` their covariance.
        Unchanged where no turn is known, and for a hand, whose pads lie in different planes.
        """
        pads, known = len(self.velocity), np.isfinite(self.velocity[:, 2])
        if self.axes.shape[-1] != 2 or not known.any():
            return self
        share = np.where(known[:, np.newaxis], np.eye(pads), known / known.sum())  # of the turn of each pad
        turn = share @ np.where(known, self.velocity[:, 2], 0.0)
        x, y = np.nan_to_num(point_m - self.place_m).T
        across = np.stack([-y, x], axis=1)
        velocity = self.velocity.copy()
        velocity[:, :2] += turn[:, np.newaxis] * across
        moves = np.einsum("pq,ab->paqb", np.eye(pads), np.eye(3))
        moves[:, :2, :, 2] += across[:, :, np.newaxis] * share[:, np.newaxis, :]
        own = np.where(np.isfinite(self.covariance), self.covariance, 0.0)
        joint = np.einsum("paqb,qbc,rdqc->pard", moves, own, moves)
        if self.place_std_m is not None:
            anywhere = (turn**2 + share**2 @ own[:, 2, 2]) * np.nan_to_num(self.place_std_m) ** 2
            joint[:, :2, :, :2] += np.einsum("p,pq,ab->paqb", anywhere, np.eye(pads), np.eye(2))
        unknown = ~np.isfinite(self.covariance.diagonal(axis1=1, axis2=2))
        joint[unknown], joint[:, :, unknown] = np.nan, np.nan
        covariance = joint[np.arange(pads), :, np.arange(pads)]
        return replace(self, velocity=velocity, covariance=covariance, joint=joint)

    def plane_covariance(self) -> Floats:
        """(pads, 2, pads, 2), of the first two components of all pads' velocities."""
        if self.joint is not None:
            return self.joint[:, :2, :, :2]
        apart: Floats = np.einsum("pq,pab->paqb", np.eye(len(self.covariance)), self.covariance[:, :2, :2])
        return apart


def relaxed(force_n: float, rate_1_s: float, dt_s: float) -> float:
    """A force that comes down at a rate, 1/s, after the time from scan to scan, s.

    A pause without scans counts as `_LONGEST_S`: nobody saw how the object took it. A step in proportion to all of it
    would open the grip, or ask for a force below 0.
    """
    return force_n * (1.0 - rate_1_s * min(dt_s, _LONGEST_S))


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
