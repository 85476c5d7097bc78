"""Centroid and principal axis of the pressure: image moments, the usual baseline with rotation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True)
class PrincipalAxis:
    """Position = centroid of the pressure, undelayed; theta = turn of its long axis since a contact first shows it.

    No theta where the contact is too round to have a long axis. Sampling by few taxels is not in its deviation.
    """

    most_std_rad: float = 0.1
    """Theta is left unknown in scans in which noise makes the axis less sure than this, rad."""
    sigmas: float = 5.0
    """... or in which the anisotropy is less than this many of its standard deviations above 0."""
    least_anisotropy: float = 0.05
    """... or in which the anisotropy itself, the difference of the principal second moments over their sum (0 round,
    1 a line), is less than this: the grid of taxels alone makes that much of a round contact."""

    def __post_init__(self) -> None:
        if not 0 < self.most_std_rad < float("inf"):
            raise ParameterInvalid("most_std_rad", self.most_std_rad, "be a finite number above 0, in rad")
        if not 0 <= self.sigmas < float("inf"):
            raise ParameterInvalid("sigmas", self.sigmas, "be 0 or more")
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
