"""Grips without slip estimation: constant force, a threshold on the pressure image, one on the centroid's speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taxelflow.control.base import Touch, relaxed


@dataclass(frozen=True)
class Constant:
    """Hold a constant force."""

    times: float = 2.48
    """Factor on the first force."""
    method: None = None

    def start(self, force_n: float, most_n: float) -> ConstantSession:
        """Take over a grip."""
        return ConstantSession(min(self.times * force_n, most_n))


class ConstantSession:
    """One number."""

    def __init__(self, force_n: float) -> None:
        self._force_n = force_n

    def step(self, _touch: Touch) -> float:
        """The force to command, N."""
        return self._force_n


@dataclass(frozen=True)
class Threshold:
    """Squeeze when the pressure image changes by more than a share of itself."""

    change: float = 0.0358
    """Sum of the changes of all taxels since the scan before, each as a share of its pad's total."""
    up: float = 1.08
    """Factor on the force in each scan above the threshold."""
    relax_1_s: float = 0.0121
    """Rate at which the force comes down otherwise, 1/s."""
    method: None = None

    def start(self, force_n: float, most_n: float) -> ThresholdSession:
        """Take over a grip."""
        return ThresholdSession(self, force_n, most_n)


class ThresholdSession:
    """The force and the last image."""

    def __init__(self, parameters: Threshold, force_n: float, most_n: float) -> None:
        self._p, self._force_n, self._most_n = parameters, force_n, most_n
        self._last = np.zeros(0)

    def step(self, touch: Touch) -> float:
        """The force to command, N."""
        image = touch.pressure / max(float(touch.pressure.sum()), 1.0)
        changed = float(np.abs(image - self._last).sum()) if len(self._last) else 0.0
        self._last = image
        slips = changed > self._p.change
        self._force_n = min(_changed(self._force_n, self._p, touch.dt_s, slips=slips), self._most_n)
        return self._force_n


@dataclass(frozen=True)
class CentroidSpeed:
    """Squeeze when a pad's centre of pressure moves faster than a threshold (as mas-group/tactile_slip_detector)."""

    speed_m_s: float = 0.0112
    """Threshold on the speed of the paper's method II."""
    up: float = 1.08
    """Factor on the force in each scan above the threshold."""
    relax_1_s: float = 0.0121
    """Rate at which the force comes down otherwise, 1/s."""
    method: str = "convolution"

    def start(self, force_n: float, most_n: float) -> CentroidSpeedSession:
        """Take over a grip."""
        return CentroidSpeedSession(self, force_n, most_n)


class CentroidSpeedSession:
    """The force."""

    def __init__(self, parameters: CentroidSpeed, force_n: float, most_n: float) -> None:
        self._p, self._force_n, self._most_n = parameters, force_n, most_n

    def step(self, touch: Touch) -> float:
        """The force to command, N."""
        speeds = np.hypot(touch.velocity[:, 0], touch.velocity[:, 1])
        slips = bool((speeds[np.isfinite(speeds)] > self._p.speed_m_s).any())
        self._force_n = min(_changed(self._force_n, self._p, touch.dt_s, slips=slips), self._most_n)
        return self._force_n


def _changed(force_n: float, parameters: Threshold | CentroidSpeed, dt_s: float, *, slips: bool) -> float:
    """The force after a scan: more if the object slips, else a little less."""
    return force_n * parameters.up if slips else relaxed(force_n, parameters.relax_1_s, dt_s)
