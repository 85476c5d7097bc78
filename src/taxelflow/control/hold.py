"""Hold an object with the least force: measure it from the acceleration of a slip, stop the slip, keep a margin.

`balance` estimates the least force from a slip. Pads that a flat face covers cannot observe a slip (`blindness`). Then
the force is raised once, by the factor that the load may grow by.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import exp, log

import numpy as np

from taxelflow.control.agreement import Agreement
from taxelflow.control.balance import Balance, Shown
from taxelflow.control.base import Touch, relaxed
from taxelflow.control.blindness import Blindness
from taxelflow.control.slipped_force import SlippedForce
from taxelflow.numerics.gravity import G_M_S2

_MIDDLE = np.zeros(2)
"""Point of the object whose motion is evaluated, on facing pads: their middle, near the object's centre of mass."""


@dataclass(frozen=True)
class Hold:
    """Raise the grip on slip by what the slip shows, and relax slowly."""

    stop_s: float = 0.0154
    """Time in which a slip is to be stopped."""
    least_m_s2: float = 0.5
    """Least deceleration asked for."""
    margin: float = 1.07
    """Force held after a slip, over the least force that the slip has shown."""
    settle_s: float = 0.3
    """Time constant with which the force comes down to that after a slip."""
    memory_s: float = 0.05
    """Time with which what a scan of a slip has shown of the least force fades."""
    foresee_s: float = 0.165
    """How far ahead the growth of the least force from slip to slip is extrapolated."""
    calm_s: float = 1.0
    """Time without slip after which the force is relaxed."""
    relax_1_s: float = 0.0752
    """Rate of that relaxation, 1/s."""
    again_s: float = 10.0
    """Time without slip after which a force that has slipped is tried again; twice that if it slips again."""
    blind_times: float = 4.0
    """Force over the first one where the pads cannot detect a slip: the growth of the load that is to be borne."""
    agreement: Agreement = field(default_factory=Agreement)
    blindness: Blindness = field(default_factory=Blindness)
    method: str = "registration"
    """Estimator."""

    def start(self, force_n: float, most_n: float) -> HoldSession:
        """Take over a grip of `force_n` per pad."""
        return HoldSession(self, force_n, most_n)


class HoldSession:
    """The force, the present slip, and the least force by earlier slips."""

    def __init__(self, parameters: Hold, force_n: float, most_n: float) -> None:
        self._p, self._force_n, self._most_n = parameters, force_n, most_n
        self._both = parameters.agreement.start()
        self._balance, self._shown, self._slips = Balance(), Shown(parameters.memory_s), False
        self._blindness = parameters.blindness.start()
        self._quiet_s = 0.0  # since the slip detector alarmed
        self._last_shown: tuple[float, float] | None = None  # time and least force of the last slip
        self._target_n, self._calm_s = force_n, 0.0
        self._slipped, self._before_n = SlippedForce(parameters.again_s), force_n
        self._blind_n = min(parameters.blind_times * force_n, most_n)

    def step(self, touch: Touch) -> float:
        """The force to command, N."""
        p, was, was_quiet_s = self._p, self._slips, self._quiet_s
        observes = ~(touch.detail_m > p.blindness.detail_m)  # the slip detector of a pad without detail is not used
        seen = replace(touch, slipping=touch.slipping & observes)
        self._quiet_s = 0.0 if seen.slipping.any() else was_quiet_s + touch.dt_s
        motion = self._both.step(seen.of_point(_MIDDLE))
        if self._blindness.step(touch):
            self._target_n, self._force_n = max(self._target_n, self._blind_n), max(self._force_n, self._blind_n)
            self._calm_s = 0.0
        if motion.known:
            self._balance.add(touch.t_s, motion.speed_m_s, touch.force_n)
        elif motion.slipping:  # a lost contact bears no load, whatever the object needs
            return self._force_n
        self._slips = motion.slipping
        if motion.slipping:
            least_n, agreed = self._balance.least_n(), motion.sigmas > p.agreement.sigmas
            if agreed and least_n > touch.force_n:
                self._slipped.add(touch.t_s, touch.force_n)
            self._shown.add(touch.t_s, motion.speed_m_s, least_n)
            sure = 1.0 if agreed else max(1.0 - 2.0 / max(motion.sigmas, 2.0), 0.0)
            slow_m_s2 = max(sure * motion.speed_m_s / p.stop_s, p.least_m_s2)
            braking_n = least_n * (1.0 + min(slow_m_s2 / G_M_S2, 1.0))
            self._force_n = min(max(braking_n, self._force_n), self._most_n)
            return self._force_n
        if was:
            self._learn(touch.t_s)
        self._calm_s += touch.dt_s
        if self._calm_s > p.calm_s:
            self._relax(touch, begins=self._quiet_s == 0.0 and was_quiet_s > p.calm_s)
        else:
            self._before_n = self._target_n
        self._force_n += (self._target_n - self._force_n) * min(touch.dt_s / p.settle_s, 1.0)
        return self._force_n

    def _relax(self, touch: Touch, *, begins: bool) -> None:
        """Lower the force, but not to one that has slipped. begins: the slip detector alarms after a time of calm."""
        p = self._p
        if begins and self._target_n < self._before_n:
            self._slipped.add(touch.t_s, touch.force_n)
            self._target_n = max(self._target_n, min(p.margin * touch.force_n, self._before_n))
            self._force_n, self._calm_s = max(self._force_n, self._target_n), 0.0
        elif touch.force_n > p.margin * self._slipped.force_n(touch.t_s):
            self._target_n = relaxed(self._target_n, p.relax_1_s, touch.dt_s)

    @property
    def blind(self) -> bool:
        """Whether the pads cannot detect a slip now."""
        return self._blindness.blind

    def _learn(self, t_s: float) -> None:
        """A slip has ended: hold its least force with a margin, and more while it grows from slip to slip."""
        growth_1_s, least_n = 0.0, self._shown.least_n()
        if self._last_shown is not None and least_n > self._last_shown[1] > 0.0:
            growth_1_s = log(least_n / self._last_shown[1]) / max(t_s - self._last_shown[0], 0.05)
        self._last_shown = (t_s, least_n)
        ahead = exp(min(growth_1_s * self._p.foresee_s, 0.5))
        self._target_n = min(self._p.margin * least_n * ahead, self._most_n)
        self._calm_s = 0.0
