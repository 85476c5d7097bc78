"""Parameters of the object's motion in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import ExtraMissing
from taxelflow.fusion.observability import BLIND
from taxelflow.numerics.rounding import BLIND_M
from taxelflow.runtime.checks import not_negative, positive

if TYPE_CHECKING:
    from taxelflow.fusion.spatial.session import SpatialSession
    from taxelflow.messages import Joints
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True)
class SpatialField:
    """The object's twist and pose in space, for pads whose place in space is known."""

    window_s: float = 0.25
    """Window of the twist, s: a straight line through the poses of each contact. 0: displacements of single scans."""
    blind_m_s: float = BLIND.m_s
    """Standard deviation of the twist beyond which a direction is not observable, m/s (turns: times `length_m`)."""
    blind_m: float = BLIND_M
    """Standard deviation of the pose beyond which a direction is not observable, m (turns: times `length_m`)."""
    length_m: float = 0.05
    """Length by which rotations are compared with translations, about the object's radius, m."""
    edge_doubt: float = 0.3
    """Share that is added for ambiguous poses at a pad's border, as in `fusion`; of a pitch, too, where a contact is
    anchored in a scan whose pose is not resolved."""

    def __post_init__(self) -> None:
        for name in ("window_s", "edge_doubt"):
            not_negative(f"spatial.{name}", getattr(self, name))
        for name in ("blind_m_s", "blind_m", "length_m"):
            positive(f"spatial.{name}", getattr(self, name))

    def begin(self, sensor: Sensor, joints: Joints | None) -> tuple[SpatialSession | None, list[str]]:
        """As `start`, but a note to the user where there is no session for lack of MuJoCo or of joint angles.

        Raises HandModelInvalid.
        """
        try:
            session = self.start(sensor, joints)
        except ExtraMissing as error:
            return None, [f"no motion in space: {error}"]
        if session is None and sensor.hand is not None and any(pad.link is not None for pad in sensor.pads):
            known = ", ".join(["JOINT=ANGLE pairs", *(pose.split(":", 1)[0] for pose in sensor.hand.poses)])
            remedy = f"give `estimate` --joints ({known}, or a csv), or write joints in [hand] of the sensor file"
            return None, [f"no motion in space: the pads are on links, and there are no joint angles; {remedy}"]
        return session, []

    def applies(self, sensor: Sensor, joints: Joints | None) -> bool:
        """Whether any pad has a place in space."""
        if any(pad.link is not None for pad in sensor.pads):
            return joints is not None
        return any(pad.pose is not None for pad in sensor.pads)

    def start(self, sensor: Sensor, joints: Joints | None) -> SpatialSession | None:
        """Begin a session; None where no pad has a place in space: no `pose`, or a `link` without joint angles.

        Raises HandModelInvalid, and ExtraMissing for pads on links without MuJoCo.
        """
        if not self.applies(sensor, joints):
            return None
        from taxelflow.fusion.spatial.session import SpatialSession
        from taxelflow.fusion.spatial.twist import Limits

        limits = Limits(self.blind_m_s, self.blind_m, self.length_m)
        return SpatialSession(sensor, joints, limits, window_s=self.window_s, edge_doubt=self.edge_doubt)
