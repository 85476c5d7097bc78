"""Results to ROS 2 without ROS, by cyclonedds: `ros2:`. Experimental.

/taxelflow/object: geometry_msgs/TwistWithCovarianceStamped, the object's motion where it is known, in the frame `hand`;
unknown axes as in `six_axes`.
/taxelflow/object3d: the same in space, and /taxelflow/pose3d: geometry_msgs/PoseWithCovarianceStamped, since first
contact, where pads have places in space.
/taxelflow/scans: tactile_msgs/TactileState, a channel for each pad. /taxelflow/events: std_msgs/String, JSON.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.acquire.devices.dds import cyclonedds, dds_type, domain_of, quality_of_service
from taxelflow.acquire.ros.decode import store_of
from taxelflow.acquire.ros.kinds import kind_of
from taxelflow.numerics.clock import nanoseconds
from taxelflow.publish.sinks.lines import event_row
from taxelflow.publish.sinks.six_axes import over_skin, usable
from taxelflow.sensors.channels import plausible

if TYPE_CHECKING:
    from taxelflow.messages import Floats, RawScans, SpatialMotions
    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.runtime.addresses import Address

_LAST_S = 2.0**31 - 1.0
"""Latest time of a header: its seconds have 32 bits."""


class Ros2Types:
    """Classes of the messages that are published: a field for each topic's type, and by name the types inside them."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}
        self.twist_type = self._make("geometry_msgs/msg/TwistWithCovarianceStamped")
        self.pose_type = self._make("geometry_msgs/msg/PoseWithCovarianceStamped")
        self.touch_type = self._make("tactile_msgs/msg/TactileState")
        self.text_type = self._make("std_msgs/msg/String")

    def _make(self, name: str) -> Any:
        kind = kind_of(name)
        return dds_type(store_of(name, "", "", "" if kind is None else kind.definition), name, self._made)

    def __getitem__(self, name: str) -> Any:
        """The class of `package/msg/Name`."""
        return self._made[name]

    def header(self, t_s: float) -> Any:
        """A header of the frame `hand`."""
        sec, nanosec = divmod(nanoseconds(min(t_s, _LAST_S)) or 1, 10**9)  # a stamp of 0 is one that is not set
        stamp = self["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        return self["std_msgs/msg/Header"](stamp=stamp, frame_id="hand")

    def touch(self, t_s: float, channels: dict[str, list[float]]) -> Any:
        """A tactile_msgs/TactileState."""
        channel = self["sensor_msgs/msg/ChannelFloat32"]
        sensors = [channel(name=name, values=values) for name, values in channels.items()]
        return self.touch_type(header=self.header(t_s), sensors=sensors)

    def twist(self, t_s: float, velocity: Floats, covariance: Floats) -> Any:
        """A geometry_msgs/TwistWithCovarianceStamped from (6,) and (6, 6), NaN where unknown."""
        vector = self["geometry_msgs/msg/Vector3"]
        velocity, whole = usable(velocity, covariance)
        vx, vy, vz, wx, wy, wz = velocity.tolist()
        twist = self["geometry_msgs/msg/Twist"](linear=vector(x=vx, y=vy, z=vz), angular=vector(x=wx, y=wy, z=wz))
        known = self["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=whole.ravel().tolist())
        return self.twist_type(header=self.header(t_s), twist=known)

    def pose(self, t_s: float, pose: Floats, covariance: Floats) -> Any:
        """A geometry_msgs/PoseWithCovarianceStamped from (7,), see `SpatialMotions`, and (6, 6), NaN where unknown."""
        _, whole = usable(np.zeros(6), covariance)
        x, y, z, qx, qy, qz, qw = pose.tolist()
        point, turn = self["geometry_msgs/msg/Point"], self["geometry_msgs/msg/Quaternion"]
        placed = self["geometry_msgs/msg/Pose"](position=point(x=x, y=y, z=z), orientation=turn(x=qx, y=qy, z=qz, w=qw))
        known = self["geometry_msgs/msg/PoseWithCovariance"](pose=placed, covariance=whole.ravel().tolist())
        return self.pose_type(header=self.header(t_s), pose=known)

    def text(self, content: object) -> Any:
        """A std_msgs/String of JSON."""
        return self.text_type(data=msgspec.json.encode(content).decode())


class Ros2Sink:
    """Publishes to reliable and best-effort subscribers; who is slow misses messages."""

    lossless = False
    raw = True
    dropped = 0
    gathers_s = 0.0

    def __init__(self, domain: int) -> None:
        self._domain, self._dds = domain, cyclonedds()

    def open(self, head: Head) -> None:
        """See `Sink`."""
        self._types, self._head = Ros2Types(), head
        participant = self._dds.domain.DomainParticipant(self._domain)

        def writer(topic: str, message_type: Any) -> Any:
            made = self._dds.topic.Topic(participant, f"rt/taxelflow/{topic}", message_type)
            return self._dds.pub.DataWriter(participant, made, qos=quality_of_service(reliable=True))

        self._object3d = writer("object3d", self._types.twist_type)
        self._pose3d = writer("pose3d", self._types.pose_type)
        self._object = writer("object", self._types.twist_type)
        self._scans = writer("scans", self._types.touch_type)
        self._events = writer("events", self._types.text_type)

    def write_raw(self, scans: RawScans, *, late: bool) -> None:
        """See `Sink`."""
        if late:
            return
        sensor, layout = self._head.sensor, self._head.sensor.layout
        readings = sensor.channel_map.to_readings(plausible(scans.values))
        for t_s, values in zip(scans.t_s.tolist(), readings, strict=True):
            pads = {layout.pads[pad]: values[layout.of_pad(pad)].tolist() for pad in range(layout.pad_count)}
            self._scans.write(self._types.touch(t_s, pads))

    def write(self, update: Update) -> None:
        """See `Sink`."""
        motions = update.output.motions
        for scan, t_s in enumerate(motions.t_s.tolist()):
            if np.isfinite(motions.velocity[scan, :2]).all():
                moved = over_skin(motions.velocity[scan], motions.velocity_covariance[scan])
                self._object.write(self._types.twist(t_s, *moved))
        if update.output.spatial is not None:
            self._write_spatial(update.output.spatial)
        for event in update.output.events:
            self._events.write(self._types.text(event_row(event)))

    def _write_spatial(self, motions: SpatialMotions) -> None:
        for scan, t_s in enumerate(motions.t_s.tolist()):
            twist, pose = motions.twist[scan], motions.pose[scan]
            if np.isfinite(twist).any():
                self._object3d.write(self._types.twist(t_s, twist, motions.twist_covariance[scan]))
            if np.isfinite(pose).all():
                self._pose3d.write(self._types.pose(t_s, pose, motions.pose_covariance[scan]))

    def tick(self) -> None:
        """Nothing is held."""

    def hurry(self) -> None:
        """Nothing is waited for."""

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        del self._object, self._object3d, self._pose3d, self._scans, self._events


def write(address: Address) -> Ros2Sink:
    """`ros2:?domain=0`. Raises AddressInvalid, ExtraMissing."""
    address.check_options(("domain",))
    address.refuse_path("ros2: alone; its topics begin with /taxelflow")
    return Ros2Sink(domain_of(address))
