"""Whether pads can observe a slip: a flat face over the whole pad, or a smooth can, gives the same image anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.runtime.checks import positive

if TYPE_CHECKING:
    from taxelflow.control.base import Touch


@dataclass(frozen=True)
class Blindness:
    """When pads are blind: their images then change by a tilt of the load, or by noise, as much as by motion."""

    detail_m: float = 0.025
    """Pads are blind if an object must move farther than this, along its load, to change their images by as much as the
    images themselves. Measured at rest, in mm: a plate 31 to 32, a can along its axis 46; a box whose edges lie on the
    pads 15 to 21, all else 1 to 5. This is the geometric mean of 21 and 31."""
    memory_s: float = 0.05
    """Time constant of the mean: short, because an edge may slide off its pad."""

    def __post_init__(self) -> None:
        for name in ("detail_m", "memory_s"):
            positive(f"blindness.{name}", getattr(self, name))

    def start(self) -> BlindnessSession:
        """Begin with pads that are not blind; they stay so while they have no image."""
        return BlindnessSession(self)


class BlindnessSession:
    """The mean detail of both pads' images. blind: whether it is too low now."""

    def __init__(self, parameters: Blindness) -> None:
        self._p, self._details_1_m = parameters, float("nan")
        self.blind = False

    def step(self, touch: Touch) -> bool:
        """Whether the pads are blind up to this scan."""
        known = touch.detail_m[np.isfinite(touch.detail_m)]
        if len(known):
            now = float((1.0 / np.maximum(known, 1e-6)).max())
            share = 1.0 if np.isnan(self._details_1_m) else min(touch.dt_s / self._p.memory_s, 1.0)
            self._details_1_m = now if share >= 1.0 else self._details_1_m + share * (now - self._details_1_m)
            self.blind = self._details_1_m * self._p.detail_m < 1.0
        return self.blind
