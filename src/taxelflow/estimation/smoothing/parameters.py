"""Smoothing of poses by a constant-velocity prior: information from an object's inertia, not from the scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid
from taxelflow.runtime.checks import numeric

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode, SlipSource
    from taxelflow.sensors.layout import Layout

NOTE = (
    "smoothed: poses and displacements contain the prior of a constant velocity, information that is not in the scans"
)


@dataclass(frozen=True)
class Smoothing:
    """Constant velocity with white acceleration, over the poses of any method that gives them with a covariance.

    stream: a Kalman filter. batch: a Rauch-Tung-Striebel smoother over each contact, which is held back until it ends.
    """

    acceleration_m_s2: float = 0.0
    """Standard deviation of the change of velocity within one second, m/s; sqrt(T) times that within T seconds. That of
    a rotation is as of a point at the pad's radius of gyration. 0: no smoothing."""

    def __post_init__(self) -> None:
        numeric(self, "smooth.")
        if not 0 <= self.acceleration_m_s2 < float("inf"):
            duty = "be 0 (no smoothing) or more, in m/s^2"
            raise ParameterInvalid("smooth.acceleration_m_s2", self.acceleration_m_s2, duty)

    def around(self, session: SlipSource, layout: Layout, mode: Mode) -> SlipSource:
        """The source with its poses smoothed; itself if there is no smoothing."""
        if not self.acceleration_m_s2:
            return session
        from taxelflow.estimation.smoothing.session import FilterSession, SmootherSession

        kind = SmootherSession if mode == "batch" else FilterSession
        return kind(session, layout, self.acceleration_m_s2)
