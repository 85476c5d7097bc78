"""The node of ros/taxelflow_ros with a stand-in for rclpy: there is no ROS where these tests run."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from streaming import slid
from taxelflow.publish.sinks.six_axes import UNKNOWN

PACKAGE = Path(__file__).resolve().parents[3] / "ros" / "taxelflow_ros"


class ParameterException(Exception):
    """rclpy's, for a parameter of another type than its default."""


class ExternalShutdownException(Exception):
    """rclpy's, on SIGTERM."""


class Node:
    """What the node uses of rclpy's."""

    given: ClassVar[dict[str, Any]] = {}
    fatal: ClassVar[list[str]] = []
    ended: ClassVar[list[str]] = []

    def __init__(self, name: str) -> None:
        self.name, self.published, self.subscriptions = name, {}, []

    def declare_parameter(self, name: str, usual: Any) -> Any:
        value = self.given.get(name, usual)
        if type(value) is not type(usual):
            raise ParameterException(f"{name} has another type")
        return SimpleNamespace(value=value)

    def destroy_node(self) -> None:
        self.ended.append(self.name)

    def create_publisher(self, _kind: Any, topic: str, _depth: int) -> Any:
        return SimpleNamespace(publish=self.published.setdefault(topic, []).append)

    def create_subscription(self, kind: Any, topic: str, call: Any, _qos: Any) -> None:
        self.subscriptions.append((kind, topic, call))

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=10**9, to_msg=lambda: "now"))

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=lambda *_text, **_options: None)


def twist() -> Any:
    stamped = SimpleNamespace(header=SimpleNamespace(), twist=SimpleNamespace(twist=SimpleNamespace()))
    stamped.twist.twist.linear, stamped.twist.twist.angular = SimpleNamespace(), SimpleNamespace()
    return stamped


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The node's module on a stand-in for ROS."""
    (tmp_path / "hand.toml").write_text(
        'name = "hand"\nunit = "Pa"\n[[pads]]\nname = "pad0"\nrows = 4\ncols = 7\npitch_m = [0.01, 0.01]\n'
    )
    modules = {
        "rclpy": {"init": lambda: None, "try_shutdown": lambda: None},
        "rclpy.exceptions": {"NameValidationException": ValueError, "ParameterException": ParameterException},
        "rclpy.executors": {"ExternalShutdownException": ExternalShutdownException},
        "rclpy.logging": {"get_logger": lambda _name: SimpleNamespace(fatal=Node.fatal.append)},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "geometry_msgs.msg": {"TwistWithCovarianceStamped": twist},
        "std_msgs.msg": {"String": lambda data: SimpleNamespace(data=data)},
        "tactile_msgs.msg": {"TactileState": SimpleNamespace},
        "xela_server_ros2.msg": {"SensStream": SimpleNamespace},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(Node, "given", {"sensor": str(tmp_path / "hand.toml"), "condition.contact_on": 7.0})
    monkeypatch.setattr(Node, "fatal", [])
    monkeypatch.setattr(Node, "ended", [])
    return runpy.run_path(str(PACKAGE / "taxelflow_ros" / "node.py"))


@pytest.fixture
def node(module: dict[str, Any]) -> Any:
    return module["SlipNode"]()


def test_scans_in_twist_slips_and_events_out(node: Any) -> None:
    ((_, topic, call),) = node.subscriptions
    assert topic == "/touch"
    assert node.live.pipeline.condition.contact_on == 7.0
    scans = slid()
    for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True):
        stamp = SimpleNamespace(sec=int(t_s), nanosec=round(t_s % 1 * 1e9))
        channel = SimpleNamespace(name="", values=values)
        call(SimpleNamespace(header=SimpleNamespace(stamp=stamp), sensors=[channel]))
    assert len(node.published["~/slips"]) == len(scans)
    assert json.loads(node.published["~/slips"][-1].data)["pads"]["pad0"]["contact"] is True
    assert json.loads(node.published["~/events"][0].data)["event"] == "contact"
    moved = node.published["~/object"][-1]
    assert moved.header.frame_id == "hand"
    assert moved.twist.twist.linear.x == pytest.approx(0.05, rel=0.3)
    variances = np.reshape(moved.twist.covariance, (6, 6)).diagonal()
    assert np.array_equal(variances[2:], [UNKNOWN] * 4)
    assert np.all(variances[:2] < 1.0)


def test_messages_of_single_numbers_and_without_header_are_read(module: dict[str, Any]) -> None:
    Node.given |= {"sensor": "xela-4x4@10mm", "type": "xela_server_ros2/SensStream"}
    node, scans = module["SlipNode"](), slid()
    for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True):
        pressed = 10 * values.reshape(4, 7)[:, 1:5].ravel()
        taxels = [SimpleNamespace(x=0, y=0, z=int(z)) for z in pressed]
        node.scan(SimpleNamespace(sensors=[SimpleNamespace(sensor_pos=1, time=10.0 + t_s, taxels=taxels)]))
    assert json.loads(node.published["~/slips"][-1].data)["t_s"] == pytest.approx(10.0 + scans.t_s[-1])
    assert node.published["~/object"][-1].header.stamp == "now"


def test_a_twist_of_messages_whose_stamp_is_not_set_has_the_time_of_receipt(node: Any) -> None:
    second = [10**9]
    node.get_clock = lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=second[0], to_msg=lambda: "now"))
    scans = slid()
    for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True):
        second[0] = round(1e9 * (1.0 + t_s))
        header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
        node.scan(SimpleNamespace(header=header, sensors=[SimpleNamespace(name="", values=values)]))
    assert json.loads(node.published["~/slips"][-1].data)["t_s"] == pytest.approx(1.0 + scans.t_s[-1])
    assert node.published["~/object"][-1].header.stamp == "now"


@pytest.mark.parametrize("signal", [KeyboardInterrupt, ExternalShutdownException])
def test_a_signal_ends_the_node_in_order(module: dict[str, Any], signal: type[BaseException]) -> None:
    def spin(_node: Any) -> None:
        raise signal

    module["rclpy"].spin = spin
    module["main"]()
    assert Node.ended == ["taxelflow"]
    assert not Node.fatal


def test_a_parameter_of_another_type_is_one_line_of_the_log(module: dict[str, Any]) -> None:
    Node.given["condition.contact_on"] = 7
    with pytest.raises(SystemExit, match="2"):
        module["main"]()
    assert Node.fatal == ["condition.contact_on has another type"]


def test_a_message_of_another_size_is_left_out(node: Any) -> None:
    node.scan(SimpleNamespace(header=SimpleNamespace(stamp=0.0), sensors=[SimpleNamespace(name="", values=[1.0])]))
    assert not node.published["~/slips"]


def test_a_type_may_be_named_as_in_ros_1(module: dict[str, Any]) -> None:
    Node.given["type"] = "tactile_msgs/TactileState"
    assert module["SlipNode"]().subscriptions[0][0] is SimpleNamespace


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("foo/msg/Bar", "unknown message type 'foo/msg/Bar'; known are taxelflow_msgs/Scan, "),
        ("schunk_sdh/TactileSensor", "No module named 'schunk_sdh'"),
        ("tactile_msgs/msg/TactileArray", "has no attribute 'TactileArray'"),
    ],
)
def test_a_type_that_is_unknown_or_not_installed_is_one_line_of_the_log(
    module: dict[str, Any], kind: str, words: str
) -> None:
    Node.given["type"] = kind
    with pytest.raises(SystemExit, match="2"):
        module["main"]()
    (line,) = Node.fatal
    assert words in line


def test_the_launch_file_declares_what_the_node_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    declared: list[str] = []
    stand_ins = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {"DeclareLaunchArgument": lambda name, **_usual: declared.append(name)},
        "launch.substitutions": {"LaunchConfiguration": str},
        "launch_ros.actions": {"Node": lambda **settings: settings},
    }
    for name, content in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    described = runpy.run_path(str(PACKAGE / "launch" / "slip.launch.py"))["generate_launch_description"]()
    assert declared == ["sensor", "topic", "type", "method"]
    assert described[-1]["executable"] == "slip"
