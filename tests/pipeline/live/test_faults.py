"""The fault table: each fault that an emulated device can have, and what becomes of it in a run."""

from __future__ import annotations

import os
import signal
import socket
import threading
from itertools import islice, product
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from costly import mostly_long
from rigged import refused
from streaming import PALM, free_port, published, running, slid
from taxelflow.cli import main
from taxelflow.errors import ParameterInvalid
from taxelflow.pipeline.live.emulators.base import Fault, Playback, parse_fault
from taxelflow.pipeline.live.emulators.command import Emulate
from taxelflow.pipeline.live.loop import Limits
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address
from taxelflow.sensors.frame import Frame
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

COUNTS = msgspec.structs.replace(
    PALM, frame=Frame("AA55", type="float32", time="uint32_us", checksum="crc16-modbus"), name="framed"
)
# fault, kind that is reported over lines and over frames; None: only a gap or nothing is to be seen
TABLE = [
    (Fault("cable", 0.3, 0.05), "connection lost", "connection lost"),
    (Fault("half-frame", 0.3, 0.0), "bad line", "wrong checksum"),
    (Fault("checksum", 0.3, 0.0), "bad line", "wrong checksum"),
    (Fault("garbage", 0.3, 0.0), "bad line", "garbage between frames"),
    (Fault("duplicate", 0.3, 0.0), "scan repeated", "scan repeated"),
    (Fault("reorder", 0.3, 0.0), "scan late", "scan late"),
    (Fault("clock-jump", 0.3, -1000.0), "clock jumped", "clock jumped"),
    (Fault("taxel-count", 0.3, 0.0), "bad line", "wrong checksum"),
    (Fault("stall", 0.3, 0.1), None, None),
    (Fault("gone", 0.3, 0.1), None, None),
]


@pytest.mark.parametrize(
    ("row", "sensor"),
    mostly_long(product(TABLE, [PALM, COUNTS]), (TABLE[0], PALM), (TABLE[1], COUNTS)),
    ids=lambda given: given.name if given in (PALM, COUNTS) else given[0].name,
)
def test_a_fault_is_reported_and_all_else_arrives(
    tmp_path: Path, sensor: Sensor, row: tuple[Fault, str | None, str | None], caplog: pytest.LogCaptureFixture
) -> None:
    fault, over_lines, over_frames = row
    url = f"tcp://127.0.0.1:{free_port()}"
    scans = slid()
    t_s = scans.t_s + 2000.0
    with registry.find("emulator", "tcp")(parse_address(url), sensor) as device:
        playback = Playback(device, [fault], speed=2.0)
        with running(url, f"jsonl:{tmp_path}/a.jsonl", sensor=sensor, limits=Limits(duration_s=10.0)) as reports:
            playback.run(zip(t_s.tolist(), scans.values, strict=True))
            threading.Event().wait(0.1)
            device.__exit__()
    rows = published(tmp_path / "a.jsonl")
    counts = reports[0].source.faults.counts
    kind = over_lines if sensor is PALM else over_frames
    if kind is None:
        assert not counts
        assert reports[0].intake.timeline.gaps == (fault.name == "gone")
    else:
        assert counts[kind] >= 1
        reported = [record.message for record in caplog.records if record.message.startswith(kind)]
        assert len(reported) == 1
    spared = {"half-frame": 2, "taxel-count": 2, "cable": 30}.get(fault.name, 0)  # what half a frame, or a reset, takes
    assert playback.whole - spared <= len(rows) <= playback.whole
    times = np.array([row["t_s"] for row in rows])
    assert (np.diff(times) > 0).all()


def test_faults_are_given_by_name_time_and_extent() -> None:
    assert parse_fault("stall@2.5:0.5") == Fault("stall", 2.5, 0.5)
    assert parse_fault("cable@1") == Fault("cable", 1.0, 1.0)


@pytest.mark.parametrize("text", ["cable@nan", "cable@-1", "stall@1:-1", "gone@inf", "clock-jump@1:inf", "cable@1:2:3"])
def test_a_fault_at_no_time_is_refused(text: str) -> None:
    with pytest.raises(ParameterInvalid, match="fault must be NAME@SECONDS or NAME@SECONDS:EXTENT"):
        parse_fault(text)
    assert parse_fault("clock-jump@0:-5") == Fault("clock-jump", 0.0, -5.0)


def test_the_command_sends_a_scenario(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    assert main(["emulate", "stdin:", "--from", "stroke", "--speed", "0", "--fault", "garbage@2"]) == 0
    said = capfdbinary.readouterr()
    assert said.out.count(b"\n") >= 141
    assert b"140 whole scans sent, faults: garbage 1" in said.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_an_emulation_in_order(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def signalled(*_arguments: object) -> None:
        os.kill(os.getpid(), number)
        threading.Event().wait(10)

    monkeypatch.setattr(Playback, "run", signalled)
    assert main(["emulate", "stdin:", "--from", "stroke"]) == 0
    assert "0 whole scans sent, faults: none" in capfd.readouterr().err


def test_a_loop_goes_on_with_increasing_times() -> None:
    emulate = Emulate(device="stdin:", scans="stroke", loop=True)
    scans = emulate._scans(simulate(SCENARIOS["stroke"]))
    t_s = np.array([t for t, _ in islice(scans, 400)])
    assert np.diff(t_s) == pytest.approx(1 / 7, rel=1e-6)


def test_an_emulation_of_nothing_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "known are" in refused(capsys, "emulate", "nothing:", "--from", "stroke")
    assert "0 or more" in refused(capsys, "emulate", "stdin:", "--from", "stroke", "--speed", "nan")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        said = refused(capsys, "emulate", f"tcp://127.0.0.1:{port}", "--from", "stroke")
    assert said == (
        f"taxelflow: cannot open tcp://127.0.0.1:{port}: port {port} is taken by another program; "
        "choose another port, or end that program\n"
    )
    said = refused(capsys, "emulate", "tcp://192.0.2.1:5", "--from", "stroke")
    assert said.startswith("taxelflow: cannot open tcp://192.0.2.1:5: Cannot assign requested address")
    assert said.endswith("; check the address, and that this machine has it\n")
    assert "known are stroke" in refused(capsys, "emulate", "tcp", "--from", "nowhere")
    assert "known are cable" in refused(capsys, "emulate", "tcp", "--from", "stroke", "--fault", "fire@1")
    assert "stall@2.5" in refused(capsys, "emulate", "tcp", "--from", "stroke", "--fault", "stall@x")
    assert "be 0 or more" in refused(capsys, "emulate", "tcp", "--from", "stroke", "--speed", "-1")
