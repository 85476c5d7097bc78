"""ROS without ROS: cyclonedds between two processes, CDR as rosbags has it, rosbridge; and the node with a stand-in."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from itertools import islice
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from streaming import PALM, SCANS, free_port, lines, opened, published, running, slid
from taxelflow import RawScans, load_sensor
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.dds import cyclonedds, quality_of_service
from taxelflow.acquire.ros.decode import store_of
from taxelflow.acquire.ros.kinds import kind_of
from taxelflow.errors import AddressInvalid, TaxelflowError
from taxelflow.pipeline.live.emulators.base import Fault, Playback
from taxelflow.pipeline.live.loop import Limits
from taxelflow.pipeline.live.ros2_sink import Ros2Types
from taxelflow.publish.sinks.base import Ending, Head
from taxelflow.publish.sinks.six_axes import over_skin
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address

if TYPE_CHECKING:
    from pathlib import Path

LOOPBACK = (
    '<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)
TOUCH = "tactile_msgs/msg/TactileState"


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")


def test_messages_have_the_bytes_that_rosbags_gives_them() -> None:
    types = Ros2Types()
    ours = bytes(types.touch(12.5, {"palm": [1.0, 2.0], "thumb": [3.0]}).serialize())
    kind = kind_of(TOUCH)
    assert kind is not None
    store = store_of(TOUCH, "", "", kind.definition)
    known: Any = store.types
    stamp = known["builtin_interfaces/msg/Time"](12, 500_000_000)
    header = known["std_msgs/msg/Header"](stamp, "hand")
    channel = known["sensor_msgs/msg/ChannelFloat32"]
    sensors = [channel("palm", np.array([1, 2], np.float32)), channel("thumb", np.array([3], np.float32))]
    assert ours == bytes(store.serialize_cdr(known[TOUCH](header, sensors), TOUCH))
    twist = types.twist(3.0, *over_skin(np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 3.0])))
    again = store_of("geometry_msgs/msg/TwistWithCovarianceStamped", "", "", "").deserialize_cdr(
        bytes(twist.serialize()), "geometry_msgs/msg/TwistWithCovarianceStamped"
    )
    assert (again.twist.twist.angular.z, again.header.frame_id) == (0.3, "hand")  # type: ignore[attr-defined]
    assert again.twist.covariance.reshape(6, 6).diagonal().tolist() == [1, 2, 1e6, 1e6, 1e6, 3]  # type: ignore[attr-defined]


@pytest.mark.long
def test_another_process_receives_scans_by_dds_and_passes_them_on(tmp_path: Path) -> None:
    (tmp_path / "hand.toml").write_text(
        'name = "hand"\nunit = "Pa"\n[[pads]]\nname = "pad0"\nrows = 4\ncols = 7\npitch_m = [0.01, 0.01]\n'
    )
    with registry.find("emulator", "ros2")(parse_address("ros2:/touch"), PALM) as device:
        command = [sys.executable, "-m", "taxelflow.cli", "record", device.url, str(tmp_path / "a.mcap")]
        process = subprocess.Popen(
            [*command, "--sensor", str(tmp_path / "hand.toml"), "--max-scans", "40"], stdout=subprocess.PIPE
        )
        scans = slid()
        Playback(device, (), 1.0).run(zip((scans.t_s + 100.0).tolist(), scans.values, strict=True))
        said, _ = process.communicate(timeout=30)
    assert b"scans in: 40" in said
    import taxelflow

    received = taxelflow.read(tmp_path / "a.mcap").load()
    sent = dict(zip((scans.t_s + 100.0).round(6).tolist(), scans.values, strict=True))
    assert np.allclose(received.values, [sent[t] for t in received.t_s.round(6).tolist()], rtol=1e-6)


def test_a_number_beyond_any_sensor_does_not_end_the_topics() -> None:
    sink = registry.find("sink", "ros2")(parse_address("ros2:"))
    sink.open(Head(PALM, PALM.layout.pads, {}, Faults().report))
    sink.write_raw(RawScans(np.zeros(1), np.full((1, 28), 1e40)), late=False)
    sink.close(Ending(None, ()))
    emulated = registry.find("emulator", "ros2")(parse_address("ros2:/touch"), PALM)
    assert emulated.encode(0.0, np.full(28, 1e40)) == emulated.encode(0.0, np.full(28, np.nan))


def test_a_scan_at_time_0_has_a_stamp() -> None:
    stamp = Ros2Types().header(0.0).stamp
    assert (stamp.sec, stamp.nanosec) == (0, 1)  # with 0 receivers use the time of receipt
    with registry.find("emulator", "rosbridge")(parse_address("rosbridge://127.0.0.1:0/touch"), PALM) as device:
        assert json.loads(device.encode(0.0, np.zeros(28)))["msg"]["header"]["stamp"] == {"sec": 0, "nanosec": 1}


def test_the_emulated_topic_sends_a_scan_late() -> None:
    emulated = registry.find("emulator", "ros2")(parse_address("ros2:/touch"), PALM)
    written: list[Any] = []
    emulated._writer = SimpleNamespace(write=written.append, get_matched_subscriptions=lambda: [1])
    playback = Playback(emulated, (Fault("reorder", 0.1, 0.0),), 0.0)
    playback.run((1.0 + 0.1 * k, np.zeros(28)) for k in range(4))
    stamps = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for message in written]
    assert stamps == pytest.approx([1.0, 1.2, 1.1, 1.3])


@pytest.mark.long
def test_a_topic_is_read_through_rosbridge(tmp_path: Path) -> None:
    scans = slid()
    url = f"rosbridge://127.0.0.1:{free_port()}/touch"
    with (
        registry.find("emulator", "rosbridge")(parse_address(url), PALM) as device,
        running(url, f"jsonl:{tmp_path}/a.jsonl", limits=Limits(max_scans=SCANS, duration_s=10.0)) as reports,
    ):
        playback = Playback(device, (), 2.0)
        playback.run(zip((scans.t_s + 100.0).tolist(), scans.values, strict=True))
        threading.Event().wait(0.1)
    assert not reports[0].source.faults.counts
    assert np.allclose([row["t_s"] for row in published(tmp_path / "a.jsonl")], scans.t_s + 100.0)


@pytest.mark.parametrize("reliable", [False, True])
def test_every_subscriber_receives_what_is_published(reliable: bool) -> None:
    """A reliable one, as `ros2 topic echo` is, gets nothing from a writer of best effort."""
    sink = registry.find("sink", "ros2")(parse_address("ros2:"))
    sink.open(Head(PALM, PALM.layout.pads, {}, Faults().report))
    dds = cyclonedds()
    participant = dds.domain.DomainParticipant(7)
    topic = dds.topic.Topic(participant, "rt/taxelflow/scans", Ros2Types().touch_type)
    reader = dds.sub.DataReader(participant, topic, qos=quality_of_service(reliable=reliable))
    sink.write_raw(RawScans(np.arange(1.0, 4.0), np.ones((3, 28))), late=False)
    received = [sample.header.stamp.sec for sample in reader.take(N=9)]
    assert received == [1, 2, 3]
    sink.close(Ending(None, ()))


@pytest.mark.long
def test_results_are_published_to_ros_2(tmp_path: Path) -> None:
    dds, types = cyclonedds(), Ros2Types()
    participant = dds.domain.DomainParticipant(7)
    kind = types["tactile_msgs/msg/TactileState"]
    topic = dds.topic.Topic(participant, "rt/taxelflow/scans", kind)
    reader = dds.sub.DataReader(participant, topic, qos=quality_of_service(reliable=False))
    port = free_port()
    with running(f"tcp-listen://127.0.0.1:{port}", "ros2:"):
        from streaming import connected

        with connected(port) as device:
            for line in lines(slid()):
                device.sendall(line)
                threading.Event().wait(0.005)
    received = [sample for sample in reader.take(N=200) if hasattr(sample, "sensors")]
    assert received
    assert [channel.name for channel in received[0].sensors] == ["pad0"]
    assert len(received[0].sensors[0].values) == 28


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("ros2:/touch", "no type"),
        ("ros2:/touch?type=a_msgs/Other", "type=a_msgs/Other"),
        ("rosbridge://127.0.0.1:1", "no path"),
        ("inspire-dds:?side=x", "side=r or l"),
        ("inspire-dds:?time=device", "time=device; give time=arrival"),
        ("inspire-dds://hand", "the host 'hand' has no meaning here"),
        ("ros2:/touch?type=tactile_msgs/TactileState&wait=3", "unknown option 'wait'"),
        ("rosbridge://127.0.0.1:1/touch?format=line", "unknown option 'format'"),
    ],
)
def test_a_malformed_topic_is_refused(url: str, words: str) -> None:
    with pytest.raises(TaxelflowError, match=words):
        opened(url)


def test_an_emulated_topic_of_another_type_is_refused() -> None:
    for scheme, url in (("rosbridge", "rosbridge://127.0.0.1:1/touch"), ("ros2", "ros2:/touch")):
        emulator = registry.find("emulator", scheme)
        with pytest.raises(AddressInvalid, match="sends tactile_msgs/TactileState"):
            emulator(parse_address(f"{url}?type=std_msgs/Float32MultiArray"), PALM)
        emulator(parse_address(f"{url}?type=tactile_msgs/msg/TactileState"), PALM)
    assert emulator(parse_address(f"{url}?type=tactile_msgs/TactileState"), PALM).url.count("type=") == 1


def test_the_inspire_hand_is_read_by_dds() -> None:
    hand = load_sensor("inspire-rh56dftp@3mm")
    values = np.random.default_rng(0).integers(0, 4095, (5, 1062)).astype(float)
    with (
        registry.find("emulator", "inspire-dds")(parse_address("inspire-dds:"), hand) as device,
        opened("inspire-dds:", hand) as source,
    ):
        arrivals = iter(source)
        next(arrivals)  # it has opened
        Playback(device, (), 0.0).run(zip([0.0, 0.1, 0.2, 0.3, 0.4], values, strict=True))
        found = [arrival.values for arrival in islice(arrivals, 5) if arrival is not None]
    assert np.array_equal(found, values)
