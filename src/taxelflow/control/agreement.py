"""Whether and how fast an object slips between two pads: what both report, weighed by what each can know.

Pads that face each other touch one rigid object: both see the same velocity. Where they differ, at least one is wrong
by the difference, whether the object moves or not. So the difference measures the noise of the velocities even during
a slip, and a velocity counts as a slip when it is many standard deviations of that noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.control.base import Touch
    from taxelflow.messages import Floats

_MOST = 25.0
"""Largest chi-square by which one scan counts in the learned noise."""


@dataclass(frozen=True)
class Agreement:
    """When the velocity of both pads is a slip."""

    slip_m_s: float = 0.004
    """Least speed of a slip: apparent motion as the load changes stays below."""
    sigmas: float = 4.0
    """Standard deviations of the velocity from rest that are a slip."""
    alerted_sigmas: float = 2.5
    """The same while the slip detector of a pad says slip."""
    acceleration_m_s2: float = 2.0
    """Standard deviation of the object's acceleration: how much a velocity tells of the next."""
    noise_m_s: float = 0.001
    """Least standard deviation of a pad's velocity."""
    memory_s: float = 0.2
    """Time over which the noise is learned."""

    def __post_init__(self) -> None:
        for name in ("sigmas", "alerted_sigmas", "acceleration_m_s2", "noise_m_s", "memory_s"):
            if not 0 < getattr(self, name) < float("inf"):
                raise ParameterInvalid(f"agreement.{name}", getattr(self, name), "be a finite number above 0")

    def start(self) -> AgreementSession:
        """Begin at rest, with the noise that the pads report."""
        return AgreementSession(self)


@dataclass(frozen=True, slots=True)
class Motion:
    """What both pads say. velocity: (2,), of the object along the pads in the grip's frame, m/s. sigmas: from rest."""

    slipping: bool
    velocity: Floats
    sigmas: float

    @property
    def speed_m_s(self) -> float:
        """Size of the velocity."""
        return float(np.hypot(self.velocity[0], self.velocity[1]))


class AgreementSession:
    """A Kalman filter of the object's velocity, whose measurement noise is learned from the pads' difference."""

    def __init__(self, parameters: Agreement) -> None:
        self._p = parameters
        self._velocity, self._covariance = np.zeros(2), 1e-12 * np.eye(2)
        self._excess = 1.0

    def step(self, touch: Touch) -> Motion:
        """The motion of the object up to this scan."""
        p = self._p
        self._covariance = self._covariance + (p.acceleration_m_s2 * touch.dt_s) ** 2 * np.eye(2)
        known = np.isfinite(touch.velocity[:, :2]).all(axis=1)
        known &= np.isfinite(touch.covariance[:, :2, :2]).all(axis=(1, 2))
        velocity, noise = touch.velocity[known, :2], touch.covariance[known, :2, :2] + p.noise_m_s**2 * np.eye(2)
        now = self._excess
        if len(velocity) == 2:
            apart = velocity[0] - velocity[1]
            chi_square = float(apart @ np.linalg.solve(noise[0] + noise[1], apart)) / 2.0
            share = min(touch.dt_s / p.memory_s, 1.0)
            self._excess += share * (max(min(chi_square, _MOST), 1.0) - self._excess)
            now = max(self._excess, chi_square)
        for measured, own in zip(velocity, now * noise, strict=True):
            gain = self._covariance @ np.linalg.inv(self._covariance + own)
            self._velocity = self._velocity + gain @ (measured - self._velocity)
            self._covariance = self._covariance - gain @ self._covariance
        sigmas = float(np.sqrt(self._velocity @ np.linalg.solve(self._covariance, self._velocity)))
        needed = p.alerted_sigmas if touch.slipping.any() else p.sigmas
        speed = float(np.hypot(self._velocity[0], self._velocity[1]))
        return Motion(bool(sigmas > needed and speed > p.slip_m_s), self._velocity, sigmas)
