"""The node of ros/taxelflow_ros with a stand-in for rclpy: there is no ROS where these tests run."""

from __future__ import annotations

import json
import runpy
import signal
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from streaming import slid
from taxelflow.messages import RawScans, cut
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


class Executor:
    """Calls `turn` instead of waiting for messages."""

    turn: ClassVar[Any] = None

    def add_node(self, node: Any) -> None:
        self.node = node

    def spin_once(self, timeout_sec: float) -> None:
        assert timeout_sec < 1.0
        Executor.turn(self.node)


def twist() -> Any:
    stamped = SimpleNamespace(header=SimpleNamespace(), twist=SimpleNamespace(twist=SimpleNamespace()))
    stamped.twist.twist.linear, stamped.twist.twist.angular = SimpleNamespace(), SimpleNamespace()
    return stamped


def pose() -> Any:
    stamped = SimpleNamespace(header=SimpleNamespace(), pose=SimpleNamespace(pose=SimpleNamespace()))
    stamped.pose.pose.position, stamped.pose.pose.orientation = SimpleNamespace(), SimpleNamespace()
    return stamped


def send(node: Any, scans: Any) -> None:
    for t_s, values in zip(scans.t_s.tolist(), scans.values, strict=True):
        stamp = SimpleNamespace(sec=int(t_s), nanosec=round(t_s % 1 * 1e9))
        channel = SimpleNamespace(name="", values=values)
        node.scan(SimpleNamespace(header=SimpleNamespace(stamp=stamp), sensors=[channel]))


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The node's module on a stand-in for ROS."""
    (tmp_path / "hand.toml").write_text(
        'name = "hand"\nunit = "Pa"\n[[pads]]\nname = "pad0"\nrows = 4\ncols = 7\npitch_m = [0.01, 0.01]\n'
    )
    modules = {
        "rclpy": {"init": lambda **_options: None, "try_shutdown": lambda: None},
        "rclpy.exceptions": {"NameValidationException": ValueError, "ParameterException": ParameterException},
        "rclpy.executors": {
            "ExternalShutdownException": ExternalShutdownException,
            "SingleThreadedExecutor": Executor,
        },
        "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO=0)},
        "rclpy.logging": {"get_logger": lambda _name: SimpleNamespace(fatal=Node.fatal.append)},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "geometry_msgs.msg": {"TwistWithCovarianceStamped": twist, "PoseWithCovarianceStamped": pose},
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
    assert call == node.scan
    send(node, scans)
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


def test_the_hand_in_space_is_published(module: dict[str, Any], tmp_path: Path) -> None:
    size = "rows = 4\ncols = 7\npitch_m = [0.01, 0.01]\n"
    pads = [f'[[pads]]\nname = "at{y}"\n{size}pose = [0, {y}, 0, 0, 0, 0, 1]\n' for y in (-0.04, 0.04)]
    (tmp_path / "placed.toml").write_text('name = "two"\nunit = "Pa"\n' + "".join(pads))
    Node.given |= {"sensor": str(tmp_path / "placed.toml")}
    node, scans = module["SlipNode"](), slid()
    send(node, RawScans(scans.t_s, np.hstack([scans.values, scans.values])))
    moved, placed = node.published["~/object3d"][-1], node.published["~/pose3d"][-1]
    assert moved.twist.twist.linear.x == pytest.approx(0.05, rel=0.3)
    assert (placed.header.frame_id, placed.pose.pose.position.x > 0.0) == ("hand", True)
    assert min(np.reshape(placed.pose.covariance, (6, 6)).diagonal()) > 0.0


def test_pressures_in_pascals_are_not_taken_as_counts(module: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    messages = ModuleType("schunk_sdh.msg")
    vars(messages)["PressureArrayList"] = SimpleNamespace
    monkeypatch.setitem(sys.modules, "schunk_sdh.msg", messages)
    Node.given |= {"sensor": "schunk-sdh2", "type": "schunk_sdh/PressureArrayList"}
    assert module["SlipNode"]().live.recording.sensor.unit == "Pa"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_in_order_and_publishes_what_was_held_back(
    module: dict[str, Any], number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[Any] = []

    def turn(node: Any) -> None:
        sent.append(node)
        send(node, cut(slid(), 0, 8))  # results of the first scans wait for the noise
        signal.raise_signal(number)

    monkeypatch.setattr(Executor, "turn", turn)
    module["main"]()
    assert Node.ended == ["taxelflow"]
    assert not Node.fatal
    assert len(sent[0].published["~/slips"]) == 8


def test_the_end_of_ros_ends_the_node(module: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def turn(_node: Any) -> None:
        raise ExternalShutdownException

    monkeypatch.setattr(Executor, "turn", turn)
    module["main"]()
    assert Node.ended == ["taxelflow"]


def test_the_package_depends_on_the_messages_of_its_defaults(module: dict[str, Any]) -> None:
    needed = {module["_USUAL"]["type"].partition("/")[0], "geometry_msgs", "std_msgs", "rclpy"}
    assert all(f"<exec_depend>{name}</exec_depend>" in (PACKAGE / "package.xml").read_text() for name in needed)


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
