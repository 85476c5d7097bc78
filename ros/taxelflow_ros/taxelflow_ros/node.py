"""The node `slip`: a topic of tactile scans in; the object's twist, slips and events out.

Parameters: sensor, topic, type, method, and the fields of taxelflow's dataclasses by their names, as in
`condition.contact_on` or `monitor.alarms_per_hour`. Publishes ~/object (geometry_msgs/TwistWithCovarianceStamped) and
~/slips, ~/events (std_msgs/String, JSON as on `taxelflow run --to jsonl:-`). Where the places of the pads in space are
known: ~/object3d, the twist in space, and ~/pose3d (geometry_msgs/PoseWithCovarianceStamped), since first contact.
"""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from typing import Any

import msgspec
import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from taxelflow import Conditioner, Live, SlipMonitor
from taxelflow.acquire.ros.columns import columns_of
from taxelflow.acquire.ros.decode import follow, parts_of
from taxelflow.acquire.ros.kinds import Kind, kind_of, known_types, ros2_name
from taxelflow.acquire.ros.units import in_unit_of
from taxelflow.errors import NameUnknown, ParameterInvalid, TaxelflowError
from taxelflow.pipeline.live.loop import update_of
from taxelflow.publish.sinks.lines import event_row, json_lines
from taxelflow.publish.sinks.six_axes import over_skin, usable
from taxelflow.runtime.signals import Signals
from taxelflow.sensors.catalogue import load_sensor

_USUAL = {
    "sensor": "barretthand-162",
    "topic": "/touch",
    "type": "tactile_msgs/msg/TactileState",
    "method": "convolution",
}
_STAGES = {"condition": Conditioner, "monitor": SlipMonitor}


class SlipNode(Node):  # type: ignore[misc]  # rclpy has no types
    """Steps a `Live` with every message."""

    def __init__(self) -> None:
        super().__init__("taxelflow")
        asked = {name: self.declare_parameter(name, usual).value for name, usual in _USUAL.items()}
        self._kind, message = _message(asked["type"])
        stages = {name: kind(**self._stage(name, kind)) for name, kind in _STAGES.items()}
        self.live = Live(in_unit_of(self._kind, load_sensor(asked["sensor"])), asked["method"], **stages)
        self._stamp = self.get_clock().now().to_msg()
        self._object = self.create_publisher(TwistWithCovarianceStamped, "~/object", 10)
        self._object3d = self.create_publisher(TwistWithCovarianceStamped, "~/object3d", 10)
        self._pose3d = self.create_publisher(PoseWithCovarianceStamped, "~/pose3d", 10)
        self._slips = self.create_publisher(String, "~/slips", 10)
        self._events = self.create_publisher(String, "~/events", 10)
        self.create_subscription(message, asked["topic"], self.scan, qos_profile_sensor_data)

    def _stage(self, stage: str, kind: Any) -> dict[str, Any]:
        """Parameters of a stage, a field each."""
        found = {}
        for one in fields(kind):
            usual = one.default
            if isinstance(usual, bool | int | float | str):
                found[one.name] = self.declare_parameter(f"{stage}.{one.name}", usual).value
        return found

    def scan(self, message: Any) -> None:
        """One message."""
        items = [np.asarray(item, np.float64) for path in self._kind.values for item in follow(message, path)]
        parts = parts_of(items)
        named = follow(message, self._kind.names) if self._kind.names else ()
        columns = columns_of(self.live.recording.sensor, self._kind, [len(part) for part in parts], named)
        if columns is None:
            self.get_logger().warning("a message does not fit the sensor and is left out", once=True)
            return
        now = self.get_clock().now()
        stamp = follow(message, self._kind.stamp)[0] if self._kind.stamp else None
        sent_s = stamp.sec + 1e-9 * stamp.nanosec if hasattr(stamp, "nanosec") else stamp
        header = getattr(message, "header", None)
        self._stamp = header.stamp if header is not None and sent_s else now.to_msg()
        self._publish(self.live.step(sent_s or now.nanoseconds * 1e-9, np.concatenate(parts)[columns]))

    def finish(self) -> None:
        """Publish what was held back, at the end."""
        self._publish(self.live.finish())

    def _publish(self, output: Any) -> None:
        if len(output):
            for line in json_lines(update_of(output), self.live.pads):
                self._slips.publish(String(data=line.decode().rstrip()))
            moved = output.motions.velocity[-1]
            if np.isfinite(moved[:2]).all():
                self._object.publish(self._twist(*over_skin(moved, output.motions.velocity_covariance[-1])))
            if output.spatial is not None:
                self._publish_spatial(output.spatial)
        for event in output.events:
            self._events.publish(String(data=msgspec.json.encode(event_row(event)).decode()))

    def _publish_spatial(self, motions: Any) -> None:
        if np.isfinite(motions.twist[-1]).any():
            self._object3d.publish(self._twist(motions.twist[-1], motions.twist_covariance[-1]))
        if np.isfinite(motions.pose[-1]).all():
            self._pose3d.publish(self._pose(motions.pose[-1], motions.pose_covariance[-1]))

    def _twist(self, motion: Any, covariance: Any) -> Any:
        """A message of a motion (6,), NaN where unknown."""
        out = self._stamped(TwistWithCovarianceStamped())
        twist, whole = usable(motion, covariance)
        linear, angular = out.twist.twist.linear, out.twist.twist.angular
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist.tolist()
        out.twist.covariance = whole.ravel().tolist()
        return out

    def _pose(self, pose: Any, covariance: Any) -> Any:
        """A message of a pose (7,)."""
        out = self._stamped(PoseWithCovarianceStamped())
        place, turn = out.pose.pose.position, out.pose.pose.orientation
        place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = pose.tolist()
        out.pose.covariance = usable(np.zeros(6), covariance)[1].ravel().tolist()
        return out

    def _stamped(self, out: Any) -> Any:
        out.header.stamp = self._stamp
        out.header.frame_id = "hand"
        return out


def _message(name: str) -> tuple[Kind, Any]:
    """Entry in the table of messages, and class, of a type. Raises NameUnknown, ParameterInvalid."""
    kind = kind_of(name)
    if kind is None:
        raise NameUnknown("message type", name, known_types())
    package, _, short = ros2_name(name).partition("/msg/")
    try:
        return kind, getattr(import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError) as error:
        raise ParameterInvalid("type", name, f"be a message of an installed package ({error})") from error


def main() -> None:
    """Spin until Ctrl-C or SIGTERM; bad parameters are one line of the log and exit code 2."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's end the topics before the last results
    node = None
    try:
        with Signals() as signals:
            node = SlipNode()
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            signals.begin()
            while not signals.asked.is_set():
                executor.spin_once(timeout_sec=0.1)
            node.finish()
    except (TaxelflowError, NameValidationException, ParameterException) as error:
        get_logger("taxelflow").fatal(str(error))
        raise SystemExit(2) from None
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
