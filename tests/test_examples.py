from __future__ import annotations

import re
import runpy
import socket
import sys
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rigged import rigged
from streaming import connected, free_port, lines, running, slid
from taxelflow import load_sensor
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What an example prints that is run in a folder of its own."""

    def run(name: str, *arguments: str) -> str:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_every_example_is_tested_here() -> None:
    names = sorted(path.name for path in EXAMPLES.glob("*.py"))
    assert names == [
        "01_read_and_estimate.py",
        "02_live_loop.py",
        "03_new_estimator.py",
        "04_slip_control.py",
        "05_live_client.py",
        "06_live_grip.py",
    ]


def test_the_times_of_the_arduino_are_whole_microseconds_and_read_as_such() -> None:
    sketch = (EXAMPLES / "arduino_lines" / "arduino_lines.ino").read_text()
    assert "Serial.print(micros());" in sketch
    url = re.search(r"serial:[^' ]+", sketch)
    assert url
    source = registry.find("source", "serial")(parse_address(url[0]), load_sensor("grid:4x4@10mm"))
    [(t_s, values)] = source._parser.feed(b"8,7\n3600008500" + b",7" * 16 + b"\n")
    assert t_s == 3600.0085
    assert len(values) == 16


def test_01_prints_contact_speed_accuracy_and_events(ran: Callable[..., str]) -> None:
    said = ran("01_read_and_estimate.py")
    told = re.search(r"^palm: (\d+) scans in contact, median speed ([\d.]+) mm/s,$", said, re.MULTILINE)
    assert told
    assert 40 < int(told[1]) < 70
    assert 15 < float(told[2]) < 26
    std = re.search(r"standard deviation of x ([\d.]+) mm", said)
    assert std
    assert 0 < float(std[1]) < 1
    events = re.findall(r"^ *([\d.]+) s  palm +(\w+)", said, re.MULTILINE)
    assert [name for _, name in events if name in ("contact", "release")] == ["contact", "release"] * 2
    assert {"slip_start", "slip_stop"} <= {name for _, name in events}
    assert sorted(events, key=lambda event: float(event[0])) == events


def test_01_takes_a_recording_and_a_sensor(tmp_path: Path, ran: Callable[..., str]) -> None:
    save(rigged("turn"), tmp_path / "turn.npz")
    assert "\nfinger2_proximal: " in ran("01_read_and_estimate.py", "turn.npz")
    assert "\nfinger2_proximal: " in ran("01_read_and_estimate.py", "turn.npz", "schunk-sdh2")


def test_02_prints_slips_back_and_forth_as_they_happen(ran: Callable[..., str]) -> None:
    lines = ran("02_live_loop.py").splitlines()
    t_s = [float(line.split()[0]) for line in lines]
    assert t_s == sorted(t_s)
    vx = [
        float(found[1]) for line in lines if (found := re.search(r"palm slips at \(([-+\d.]+), [-+\d.]+\) mm/s", line))
    ]
    assert len(vx) > 20
    half = [speed < 0 for speed in vx].index(False)
    assert all(-35 < speed < -5 for speed in vx[:half])
    assert all(5 < speed < 35 for speed in vx[half:])
    assert sum("palm: contact" in line for line in lines) == sum("palm: release" in line for line in lines) == 2


def test_03_runs_an_estimator_of_its_own(ran: Callable[..., str]) -> None:
    said = ran("03_new_estimator.py")
    told = re.fullmatch(r"Centroid: the object went from y = (-[\d.]+) mm to ([\d.]+) mm and back\n", said)
    assert told
    assert float(told[1]) == pytest.approx(-12.5, abs=1)
    assert float(told[2]) == pytest.approx(12.5, abs=1)


def test_03_shows_a_new_estimator_in_40_lines() -> None:
    source = (EXAMPLES / "03_new_estimator.py").read_text()
    body = source[source.index("@dataclass") : source.index("\nresult = ")]
    assert len([line for line in body.splitlines() if line.strip()]) <= 40


@pytest.mark.long
def test_04_holds_what_would_slide_and_lets_slip_what_was_asked_for(ran: Callable[..., str]) -> None:
    said = ran("04_slip_control.py")
    loose, held, felt, slid = map(float, re.findall(r"(?:slid|felt|^ +) ?([\d.]+) mm", said, re.MULTILINE))
    assert loose > 20
    assert held < 0.1 * loose
    assert slid == pytest.approx(5.0, abs=0.5)
    assert felt == pytest.approx(slid, abs=0.3)


@pytest.mark.parametrize(
    ("method", "slipping"),
    [("convolution", r"pad0: \+\d+\.\d, [-+]\d+\.\d mm/s"), ("sum", "pad0: slip_start")],
    ids=["velocity", "no velocity"],
)
def test_05_follows_a_run_by_json_lines(
    ran: Callable[..., str], monkeypatch: pytest.MonkeyPatch, method: str, slipping: str
) -> None:
    port, out = free_port(), free_port()
    connect = socket.create_connection
    urls = f"tcp-listen://127.0.0.1:{port}", f"jsonl-listen://127.0.0.1:{out}"
    with running(*urls, method=method), connected(port) as device:
        connected(out).close()  # it listens once the source does

        def here(_place: object) -> socket.socket:
            client = connect(("127.0.0.1", out))
            threading.Timer(0.2, lambda: (device.sendall(b"".join(lines(slid()))), device.shutdown(1))).start()
            return client

        monkeypatch.setattr(socket, "create_connection", here)
        said = ran("05_live_client.py")
    assert "pad0: contact" in said
    assert re.search(slipping, said)
    assert len((EXAMPLES / "05_live_client.py").read_text().splitlines()) <= 20


@pytest.mark.long
def test_06_holds_a_bottle_that_is_filled_over_tcp(ran: Callable[..., str]) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
    said = ran("06_live_grip.py")
    first, times, slid, last, least = map(float, re.findall(r"([\d.]+)(?: N| times| mm)", said))
    assert slid < 5.0
    assert times > 1.5
    assert first < least < last < 2.5 * least
