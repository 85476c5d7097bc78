"""Lab Streaming Layer in and out, on this machine only. Needs the extra `lsl`."""

from __future__ import annotations

import json
import threading
from contextlib import suppress
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from streaming import PALM, SCANS, awaited, published, running, slid
from taxelflow.acquire.devices.base import Faults
from taxelflow.errors import AddressInvalid, TaxelflowError
from taxelflow.pipeline.live.emulators.base import Playback, parse_fault
from taxelflow.pipeline.live.loop import Limits
from taxelflow.publish.columns import OBJECT
from taxelflow.publish.sinks.base import Ending, Head
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address

if TYPE_CHECKING:
    from pathlib import Path

pylsl = pytest.importorskip("pylsl")


def test_a_stream_is_read_with_its_stamps_and_results_go_out_as_another(tmp_path: Path) -> None:
    scans = slid()
    with (
        registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-in"), PALM) as device,
        running(
            device.url,
            f"jsonl:{tmp_path}/a.jsonl",
            "lsl:taxelflow-test-out",
            limits=Limits(max_scans=SCANS),  # not of time: on a busy machine readers take long to find the streams
        ) as reports,
    ):
        readers = [_Reader("taxelflow-test-out"), _Reader("taxelflow-test-out-events")]
        Playback(device, (), 2.0).run(zip((scans.t_s + 100.0).tolist(), scans.values, strict=True))
    (received, stamps), (markers, _) = (reader.all() for reader in readers)
    events = [json.loads(marker[0]) for marker in markers]
    assert reports[0].intake.scans_in == SCANS
    lines = published(tmp_path / "a.jsonl")
    sent = [[line["object"][name] for name in OBJECT] for line in lines]
    np.testing.assert_array_equal(np.array(sent, float), np.array(received)[:, : len(OBJECT)])
    np.testing.assert_allclose(np.array(received)[:, 0], scans.t_s + 100.0, rtol=1e-12)
    assert np.array(received)[:, -1].tolist() == [line["pads"]["pad0"]["slipping"] for line in lines]
    assert (np.diff(stamps) >= 0).all()
    assert 0.0 <= pylsl.local_clock() - stamps[-1] < 10.0  # by LSL's clock, not by the sensor's
    assert [event["event"] for event in events] == [one["event"] for line in lines for one in line["events"]]


@pytest.mark.long
def test_what_was_sent_last_arrives_although_the_sender_closes_at_once() -> None:
    """Outlets send by threads of their own: of 50 rows that were followed by the end, 0 to 13 arrived."""
    scans = 50
    device = registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-burst"), PALM)
    sink = registry.find("sink", "lsl")(parse_address("lsl:taxelflow-test-last"))
    sink.open(Head(PALM, ("pad0",), {}, lambda *_words: None))
    with device:
        readers = [_Reader(f"taxelflow-test-{name}") for name in ("burst", "last", "last-events")]
        device.wait()
        awaited(lambda: sink._motion.have_consumers() and sink._events.have_consumers())
        for scan in range(scans):
            device.send(device.encode(1.0 + scan, np.ones(28)))
            sink._motion.push_sample([float(scan)] * (len(OBJECT) + 1), 1.0 + scan)
            sink._events.push_sample([str(scan)], 1.0 + scan)
        sink.close(Ending(None, ()))
    assert [reader.all()[1] for reader in readers] == [[1.0 + scan for scan in range(scans)]] * 3


def test_a_scan_at_0_s_keeps_its_time() -> None:
    sent: list[tuple[list[float], float]] = []
    device = registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-zero"), PALM)
    device._outlet = SimpleNamespace(push_sample=lambda *one: sent.append(one), have_consumers=lambda: True)
    assert device.send(device.encode(0.0, np.ones(28)))
    assert 0.0 < sent[0][1] < 1e-9  # at 0 the library stamps by its own clock


@pytest.mark.long
def test_a_stream_that_is_lost_is_found_again(tmp_path: Path) -> None:
    scans = slid()
    with (
        registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-lost"), PALM) as device,
        running(device.url, f"jsonl:{tmp_path}/a.jsonl", limits=Limits(duration_s=6.0)) as reports,
    ):
        again = np.concatenate([scans.t_s, scans.t_s + 1.0, scans.t_s + 2.0])
        values = np.tile(scans.values, (3, 1))
        Playback(device, [parse_fault("cable@0.3:0.5")], 1.0).run(zip((again + 100.0).tolist(), values, strict=True))
    told = reports[0].source.faults.counts
    assert told["connection lost"] == 1
    assert told["connected again"] == 1
    assert published(tmp_path / "a.jsonl")[-1]["t_s"] == pytest.approx(again[-1] + 100.0)


def test_a_stream_of_another_shape_is_counted_and_left_out() -> None:
    faults = Faults()
    from taxelflow.acquire.devices.lsl import LslParser

    parser = LslParser(2, faults, timed=True)
    assert parser.feed(np.array([3.0, 0.0, 1.0, 2.0, 3.0]).tobytes()) == []
    assert faults.counts["bad message"] == 1
    ((t_s, values),) = parser.feed(np.array([2.0, 0.5, 1.0, 2.0]).tobytes())
    assert (t_s, values.tolist()) == (0.5, [1.0, 2.0])


def test_without_such_a_stream_the_run_reports_it() -> None:
    with (
        pytest.raises(TaxelflowError, match="no stream 'taxelflow-nobody'"),
        running("lsl:taxelflow-nobody?wait=0.2"),
    ):
        threading.Event().wait(0.1)


def test_streams_stay_on_this_machine_and_one_process_has_one_reach() -> None:
    registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-reach"), PALM)
    with pytest.raises(AddressInvalid, match="scope=link; give all LSL addresses the same: machine is in use"):
        registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-reach?scope=link"), PALM)
    with pytest.raises(AddressInvalid, match="scope=all; give scope=machine or link or site or config"):
        registry.find("emulator", "lsl")(parse_address("lsl:taxelflow-test-reach?scope=all"), PALM)


class _Reader(threading.Thread):
    """Reads a stream until its sender is lost: what waits then is lost, too."""

    def __init__(self, name: str) -> None:
        super().__init__(daemon=True)
        self._read: tuple[list[list[Any]], list[float]] = [], []
        streams = pylsl.resolve_byprop("name", name, 1, timeout=20.0)
        assert streams
        self._inlet = pylsl.StreamInlet(streams[0], recover=False)
        self._inlet.open_stream(timeout=5.0)
        self.start()

    def run(self) -> None:
        with suppress(pylsl.util.LostError):
            while True:
                sample, stamp = self._inlet.pull_sample(timeout=5.0)
                if sample is not None:
                    self._read[0].append(sample)
                    self._read[1].append(stamp)

    def all(self) -> tuple[list[list[Any]], list[float]]:
        """Samples and stamps, once there are no more."""
        self.join(20.0)
        assert not self.is_alive()
        return self._read
