"""Let an object slide by a distance, or turn by an angle: loosen until it moves, hold its speed, close in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import radians

import numpy as np

from taxelflow.control.base import Touch
from taxelflow.messages import Floats


@dataclass(frozen=True)
class Loosening:
    """How a motion is let happen. Speeds are in units of the motion's own speed, so that slide and pivot are alike."""

    loosen_1_s: float
    """Rate at which the force comes down until the object moves, 1/s."""
    brake: float
    """Share of force added for a speed of twice the wanted one."""
    adapt_1_s: float
    """Growth of the force for a speed of twice the wanted one, 1/s."""
    ahead_s: float = 0.03
    """Time that the gripper takes to close: the object moves on that long."""
    near_s: float = 0.2
    """Time before the end from which on the speed comes down, to that share of it that `slow` says."""
    slow: float = 0.3
    """Share of the speed at the end."""
    shut: float = 1.6
    """Factor on the force that closes."""
    smooth: float = 0.4
    """Weight of a new scan in the speed that is compared."""


@dataclass(frozen=True)
class Slide:
    """Let the object slide down by a distance."""

    by_m: float = 0.005
    speed_m_s: float = 0.015
    loosening: Loosening = Loosening(loosen_1_s=0.15, brake=0.03, adapt_1_s=0.09)
    method: str = "registration"

    def start(self, force_n: float, most_n: float) -> LetMove:
        """Take over a grip that holds."""
        return LetMove(self.loosening, lambda v: -v[:, 1], (self.by_m, self.speed_m_s), force_n, most_n)


@dataclass(frozen=True)
class Pivot:
    """Let the object turn between the pads by an angle, in the sense in which its weight turns it."""

    by_rad: float = radians(45.0)
    speed_rad_s: float = 0.8
    loosening: Loosening = Loosening(loosen_1_s=0.3, brake=0.05, adapt_1_s=0.4, shut=2.0)
    method: str = "registration"

    def start(self, force_n: float, most_n: float) -> LetMove:
        """Take over a grip that holds."""
        return LetMove(self.loosening, lambda v: v[:, 2], (self.by_rad, self.speed_rad_s), force_n, most_n)


class LetMove:
    """Hold, move, shut: one after the other. `felt` is the motion so far, `shut` whether it has ended."""

    def __init__(
        self,
        parameters: Loosening,
        component: Callable[[Floats], Floats],
        wanted: tuple[float, float],
        force_n: float,
        most_n: float,
    ) -> None:
        self._p, self._component, (self._goal, self._wanted) = parameters, component, wanted
        self._base_n, self._most_n = force_n, most_n
        self._moves, self._speed = False, 0.0
        self.shut, self.felt = False, 0.0

    def step(self, touch: Touch) -> float:
        """The force to command, N."""
        p, speeds = self._p, self._component(touch.velocity)
        now = float(speeds[np.isfinite(speeds)].mean()) if np.isfinite(speeds).any() else self._speed
        now = float(np.clip(now, -30.0 * self._wanted, 30.0 * self._wanted))
        self.felt += now * touch.dt_s
        self._speed += p.smooth * (now - self._speed)
        if self.shut:
            return self._base_n
        if not self._moves:
            self._moves = abs(self._speed) > 0.2 * self._wanted
            self._base_n *= 1.0 - p.loosen_1_s * touch.dt_s
            return self._base_n
        if abs(self.felt) + abs(self._speed) * p.ahead_s >= self._goal:
            self.shut, self._base_n = True, min(p.shut * self._base_n, self._most_n)
            return self._base_n
        left_s = (self._goal - abs(self.felt)) / self._wanted
        excess = abs(now) / (self._wanted * float(np.clip(left_s / p.near_s, p.slow, 1.0))) - 1.0
        self._base_n *= 1.0 + float(np.clip(p.adapt_1_s * excess * touch.dt_s, -0.004, 0.02))
        return min(self._base_n * (1.0 + float(np.clip(p.brake * excess, -0.03, 0.4))), self._most_n)
