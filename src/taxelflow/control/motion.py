"""Let an object slide by a distance, or turn by an angle: loosen until it moves, hold its speed, close in time.

The speed is held by the balance that `hold` uses: the force that carries the load is weighed from scan to scan, and a
wrong speed is corrected by the acceleration that a share of that force gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Protocol

import numpy as np

from taxelflow.control.agreement import Agreement
from taxelflow.control.balance import Balance
from taxelflow.control.base import Touch, relaxed
from taxelflow.numerics.gravity import G_M_S2
from taxelflow.numerics.robust import OUTLIER

_RATIO_S = 0.2
"""Time over which the ratio of a commanded force to a felt one is learned."""
_LEAST_RAD2_S2 = 1e-8
"""Least variance of a turn, so that none is certain."""


@dataclass(frozen=True)
class Loosening:
    """How a motion is let happen. Speeds are in units of the motion's own speed, so that slide and pivot are alike."""

    loosen_1_s: float
    """Rate at which the force comes down until the object moves, and while it is too slow, 1/s."""
    free: float
    """Acceleration of the object if it were let go, m/s^2 or rad/s^2."""
    correct_s: float = 0.03
    """Time in which a wrong speed is corrected."""
    catch_s: float = 0.01
    """Time in which what exceeds twice the speed is corrected: the object gets away."""
    weigh_s: float = 0.02
    """Time over which the force that carries the load is averaged."""
    ahead_s: float = 0.02
    """Time that the object coasts on at its speed while the gripper closes."""
    near_s: float = 0.2
    """Time before the end from which on the speed comes down, to the share of it that `slow` is."""
    slow: float = 0.3
    """Share of the speed at the end."""
    shut: float = 1.6
    """Factor on the force that closes."""
    too_long: float = 1.035
    """What is felt over what is true: `registration` reads steps far below a pitch too long, slides more than turns."""
    smooth: float = 0.4
    """Weight of a new scan in the speed that begins and ends the motion."""


@dataclass(frozen=True)
class Slide:
    """Let the object slide down by a distance."""

    by_m: float = 0.005
    speed_m_s: float = 0.015
    loosening: Loosening = Loosening(loosen_1_s=0.15, free=G_M_S2, too_long=1.045)
    method: str = "registration"

    def start(self, force_n: float, most_n: float) -> LetMove:
        """Take over a grip that holds."""
        return LetMove(self.loosening, Slid(), (self.by_m, self.speed_m_s), force_n, most_n)


@dataclass(frozen=True)
class Pivot:
    """Let the object turn between the pads by an angle, in the sense in which its weight turns it."""

    by_rad: float = radians(45.0)
    speed_rad_s: float = 0.8
    loosening: Loosening = Loosening(loosen_1_s=0.3, free=170.0, shut=2.0)
    """free: of an object whose weight hangs 30 mm beside the pads, and whose radius of gyration is as large."""
    method: str = "registration"

    def start(self, force_n: float, most_n: float) -> LetMove:
        """Take over a grip that holds."""
        return LetMove(self.loosening, Turned(), (self.by_rad, self.speed_rad_s), force_n, most_n)


class Followed(Protocol):
    """A motion that is followed."""

    def step(self, touch: Touch) -> float:
        """Add a scan; the speed of the motion, the last one where no pad knows it."""
        ...

    def so_far(self) -> float:
        """Size of the motion."""
        ...


class Slid:
    """The way of the point of the object that lay between the pads' middles at the start.

    A pad knows the velocity at its contact. Where the object turns meanwhile, its middle moves otherwise, by the lever
    to it.
    """

    def __init__(self) -> None:
        self._way_m, self._both = np.zeros(2), Agreement().start()

    def step(self, touch: Touch) -> float:
        """Add a scan; the speed downwards, m/s."""
        now = self._both.step(touch.of_point(self._way_m)).velocity
        self._way_m = self._way_m + now * touch.dt_s
        return -float(now[1])

    def so_far(self) -> float:
        """Distance, m."""
        return float(np.linalg.norm(self._way_m))


class Turned:
    """The angle that the object has turned between the pads."""

    def __init__(self) -> None:
        self._angle_rad, self._rate_rad_s = 0.0, 0.0

    def step(self, touch: Touch) -> float:
        """Add a scan; the rate of rotation in the sense of the turn so far, rad/s."""
        known = np.isfinite(touch.velocity[:, 2])
        turns, variances = touch.velocity[known, 2], touch.covariance[known, 2, 2]
        if len(turns) and np.ptp(turns) ** 2 > OUTLIER * variances.sum():  # one of them has jumped
            nearer = [np.abs(turns - self._rate_rad_s).argmin()]
            turns, variances = turns[nearer], variances[nearer]
        if len(turns):  # a pad that has jumped by less knows that it is less certain
            self._rate_rad_s = float(np.average(turns, weights=1.0 / np.maximum(variances, _LEAST_RAD2_S2)))
        self._angle_rad += self._rate_rad_s * touch.dt_s
        return self._rate_rad_s if self._angle_rad >= 0.0 else -self._rate_rad_s

    def so_far(self) -> float:
        """Angle, rad."""
        return abs(self._angle_rad)


class LetMove:
    """Hold, move, shut: one after the other. `felt` is the motion so far, `shut` whether it has ended."""

    def __init__(
        self, parameters: Loosening, motion: Followed, wanted: tuple[float, float], force_n: float, most_n: float
    ) -> None:
        self._p, self._motion, (self._goal, self._wanted) = parameters, motion, wanted
        self._most_n, self._force_n, self._least_n = most_n, force_n, force_n
        self._balance, self._ratio = Balance(parameters.free), 1.0
        self._moves, self._speed, self._now = False, 0.0, 0.0
        self.shut = False

    @property
    def felt(self) -> float:
        """Size of the motion so far."""
        return self._motion.so_far() / self._p.too_long

    def step(self, touch: Touch) -> float:
        """The force to command, N."""
        p, self._now = self._p, self._motion.step(touch)
        self._speed += p.smooth * (self._now - self._speed)
        self._balance.add(touch.t_s, self._now, touch.force_n)
        if touch.force_n > 0.0:
            self._ratio += min(touch.dt_s / _RATIO_S, 1.0) * (self._force_n / touch.force_n - self._ratio)
        if self.shut:
            if abs(self._now) > p.slow * self._wanted:  # it needs more than was weighed while it was let move
                self._force_n = max(self._force_n, min(p.shut * self._ratio * self._balance.least_n(), self._most_n))
            return self._force_n
        if not self._moves:
            self._moves = abs(self._speed) > 0.2 * self._wanted
            self._force_n = relaxed(self._force_n, p.loosen_1_s, touch.dt_s)
            self._least_n = self._force_n / self._ratio
        elif self.felt + self._coasting() >= self._goal:
            self.shut, self._force_n = True, min(p.shut * self._ratio * self._least_n, self._most_n)
        else:
            self._force_n = min(self._ratio * self._regulated(touch.dt_s), self._most_n)
        return self._force_n

    def _coasting(self) -> float:
        """How far the object moves on while the gripper closes: at its speed at first, then braked.

        The smoothed speed lags behind that of an object that got away and is being caught: it would stop short.
        """
        speed = min(abs(self._speed), abs(self._now))
        return speed * self._p.ahead_s + speed**2 / (2.0 * self._p.free * (self._p.shut - 1.0))

    def _regulated(self, dt_s: float) -> float:
        """Force to be felt: what carries the load, and the share of it that brings the speed to the wanted one."""
        p = self._p
        weighed_n = self._least_n + min(dt_s / p.weigh_s, 1.0) * (self._balance.least_n() - self._least_n)
        self._least_n = max(weighed_n, relaxed(self._least_n, p.loosen_1_s, dt_s))
        left_s = (self._goal - self.felt) / self._wanted
        wanted = self._wanted * float(np.clip(left_s / p.near_s, p.slow, 1.0))
        away = max(self._now - 2.0 * self._wanted, 0.0)
        share = ((self._now - wanted) / p.correct_s + away / p.catch_s) / p.free
        return self._least_n * (1.0 + float(np.clip(share, -1.0, 1.0)))
