"""Centroid and principal axis of the pressure: image moments, the usual baseline with rotation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import not_negative, numeric

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class PrincipalAxis:
    """Estimate position as the centroid of the pressure, and theta as the rotation of its long axis.

    Theta counts from the first scan that shows the axis, and is empty where the contact is too round. Its standard
    deviation does not contain the error of sampling by few taxels.
    """

    most_std_rad: float = 0.1
    """Largest standard deviation of theta, rad; theta is left empty above it."""
    sigmas: float = 5.0
    """Smallest anisotropy in standard deviations of its noise; theta is left empty below it."""
    least_anisotropy: float = 0.05
    """Smallest anisotropy, a ratio: difference of the principal second moments over their sum, from 0 (round) to 1
    (line). Theta is left empty below it. The grid of taxels alone gives a round contact about 0.05."""

    def __post_init__(self) -> None:
        numeric(self)
        if not 0 < self.most_std_rad < float("inf"):
            raise ParameterInvalid("most_std_rad", self.most_std_rad, "be a finite number above 0, in rad")
        not_negative("sigmas", self.sigmas)
        if not 0 <= self.least_anisotropy < 1:
            raise ParameterInvalid("least_anisotropy", self.least_anisotropy, "be at least 0 and below 1")

    def start(self, layout: Layout, mode: Mode) -> CentroidSession:
        """Begin a session."""
        from taxelflow.estimation.centroid.principal_axis_kernel import Bounds, Memory, axis_motion
        from taxelflow.estimation.centroid.session import CentroidSession
        from taxelflow.numerics.records import records

        bounds = records(Bounds, 1)
        bounds[0] = (self.most_std_rad, self.sigmas, self.least_anisotropy)
        return CentroidSession(layout, axis_motion, Memory, bounds)
