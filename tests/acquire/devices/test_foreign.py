"""Live sources of another package, which `pip` has installed with entry points."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest

from taxelflow.cli import main

if TYPE_CHECKING:
    from pathlib import Path

PLUGIN = """
import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.devices.base import Arrival, Faults


class Glove:
    patient = False

    def __init__(self, address, sensor):
        self.recording, self.faults = Recording.live(sensor, address.url), Faults()
        self.mode, self.scan = address.path, 0
        if self.mode == "bare":
            del self.faults

    def __enter__(self):
        if self.mode == "unplugged":
            raise OSError("no glove")
        return self

    def __exit__(self, *details):
        pass

    def __iter__(self):
        while self.scan < 40:
            self.scan += 1
            if self.scan == 30 and self.mode == "breaks":
                raise ValueError("no\\nmotor")
            if self.scan == 30 and self.mode == "leaves":
                raise SystemExit("no licence")
            if self.scan == 30 and self.mode == "falls":
                raise OSError("bus reset")
            if self.scan == 30 and self.mode == "words":
                yield "a scan"
            if self.scan == 30 and self.mode == "short":
                yield Arrival(0.0, 0.295, np.ones(3))
            yield Arrival(0.0, 0.01 * self.scan, np.ones(16))
"""


@pytest.fixture(autouse=True)
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that is not taxelflow's announces a source and a reader."""
    (tmp_path / "plug-1.0.dist-info").mkdir()
    (tmp_path / "plug_with_glove.py").write_text(PLUGIN)
    (tmp_path / "plug-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: plug\nVersion: 1.0\n")
    (tmp_path / "plug-1.0.dist-info" / "entry_points.txt").write_text(
        "[taxelflow.source]\nglove = plug_with_glove:Glove\n[taxelflow.reader]\n.glove = plug_with_glove:Reader\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "plug_with_glove", raising=False)
    monkeypatch.chdir(tmp_path)


def run(mode: str) -> int:
    return main(["run", f"glove:{mode}", "--sensor", "grid:4x4@10mm", "--quiet", "--to", "jsonl:a.jsonl"])


def times(path: Path) -> list[float]:
    return [round(json.loads(line)["t_s"], 3) for line in (path / "a.jsonl").read_text().splitlines()]


@pytest.mark.parametrize(
    ("mode", "seen", "line"), [("breaks", "ValueError: no motor", 29), ("leaves", "SystemExit: no licence", 31)]
)
def test_an_exception_is_one_line_that_names_the_package_and_results_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mode: str, seen: str, line: int
) -> None:
    assert run(mode) == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.startswith(f"taxelflow: source 'glove' of the package plug has failed ({seen}; ")
    assert message.endswith(f"plug_with_glove.py, line {line}); repair or remove that package")
    assert len(times(tmp_path)) == 29


def test_an_error_of_the_system_is_a_lost_connection(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert run("falls") == 0
    assert [record.getMessage() for record in caplog.records][-2:] == [
        "connection lost: bus reset; connecting again",
        "connected again: glove:falls",
    ]
    assert len(times(tmp_path)) == 39


def test_a_scan_of_another_shape_is_counted_and_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert run("short") == 0
    assert caplog.messages[-1] == "bad scan: values of shape (3,), 16 expected"
    assert 0.295 not in times(tmp_path)
    assert len(times(tmp_path)) == 40


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("words", "cannot use source 'glove' from plug_with_glove:Glove (TypeError: it yields a str, not an Arrival"),
        (
            "bare",
            "cannot use source 'glove' from plug_with_glove:Glove (TypeError: its Glove needs an attribute faults",
        ),
        ("unplugged", "cannot open glove:unplugged: no glove; check the device and the address"),
    ],
)
def test_what_breaks_the_protocol_is_refused_by_name(
    mode: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(mode) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"taxelflow: {message}")
