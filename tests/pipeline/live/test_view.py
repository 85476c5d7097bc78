from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest

from rigged import refused
from streaming import awaited
from taxelflow.acquire.base import Recording
from taxelflow.errors import ExtraMissing
from taxelflow.evaluation.view import Filling, Playing
from taxelflow.pipeline.api import convert, estimate, estimator, read
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.loop import Limits, run_live
from taxelflow.pipeline.live.replay import Replay
from taxelflow.pipeline.live.view import LiveView
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.view.history import History
from taxelflow.publish.view.server import PageServer
from taxelflow.slip.parameters import SlipMonitor


@pytest.mark.long
def test_a_live_source_fills_the_page_on_this_computer_only(stroke: Recording) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    live = Live(stroke, "convolution")
    sink = LiveView(live, "stroke", PageServer(port=0))
    run_live(Replay(stroke, 5.0), {"view": sink}, live, Limits(), watch=sink.watch)
    assert sink.page.url.startswith("http://127.0.0.1:")
    assert re.match(r"\d+ scans", sink.page.panel.source)
    assert "0 dropped" in sink.page.panel.source
    assert "latency to the estimate: " in sink.page.panel.source
    times, known = sink.history.times, sink.history.within(-np.inf, np.inf)
    assert known is not None
    assert set(times) <= set(known.slips.t_s)
    assert len(times) > 30  # those from which tare is learned are not shown
    moving = sink.history.at(float(times[len(times) // 2]))
    assert moving is not None
    assert moving.pressure.max() > 5 * live.run.learned.noise.max()  # type: ignore[union-attr]
    assert {event.event for event in sink.history.events} >= {"contact", "release"}


def test_a_recording_fills_the_page_with_what_estimate_gives(stroke: Recording) -> None:
    history = History()
    Filling(stroke, Pipeline(estimator("convolution")), history).fill()
    known, asked = history.within(-np.inf, np.inf), estimate(stroke)
    assert history.complete
    assert known is not None
    assert np.array_equal(known.slips.pose, asked.slips.pose, equal_nan=True)
    assert np.array_equal(known.slipping, asked.slipping)
    assert np.array_equal(history.times, asked.slips.t_s)
    assert history.events == asked.events


def test_what_is_lost_or_odd_of_a_recording_is_told_once(
    stroke: Recording, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    path = tmp_path / "a.csv"
    convert(stroke, path)
    path.write_text(path.read_text().rstrip("\n")[:-40])  # as of a recorder that was killed
    cut = replace(read(path, stroke.sensor), notes=("a note of the reader",))
    playing = Playing(cut, ("convolution", "sum"), PageServer(port=0))
    try:
        playing.fill()
    finally:
        playing.close()
    note, loss = (record.message for record in caplog.records if record.module == "view")  # kernels may be compiled
    assert note == "a note of the reader"
    assert "a.csv is truncated: 79 scans could be read" in loss


def test_slips_are_decided_anew_at_another_rate_of_false_alarms(stroke: Recording) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    playing = Playing(stroke, ("convolution", "sum"), PageServer(port=0))
    try:
        playing.decide(1e-3)
        assert "wait" in playing.page.panel.decided
        playing.fill()
        history = playing.page.histories[0]
        before = history.events
        playing.decide(1e-3)
        assert history.changes == 1
        assert history.events == estimate(stroke, monitor=SlipMonitor(alarms_per_hour=1e-3)).events
        assert [event.event for event in before][:1] == ["contact"]
        assert "slips at 0.001 false alarms per hour" in playing.page.panel.decided
    finally:
        playing.close()


def test_methods_that_are_compared_differ(
    capsys: pytest.CaptureFixture[str], stroke: Recording, tmp_path: Path
) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    convert(stroke, tmp_path / "stroke.npz")
    twice = ("--method", "sum", "--method", "sum")
    assert "be different ones" in refused(capsys, "view", tmp_path / "stroke.npz", *twice)
    assert "be a recording" in refused(capsys, "view", f"replay:{tmp_path / 'stroke.npz'}", "--film", "a.mp4")


@pytest.mark.long
def test_the_command_prints_its_address_and_ends_with_ctrl_c(stroke: Recording, tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    convert(stroke, tmp_path / "stroke.npz")
    command = [sys.executable, "-m", "taxelflow.cli", "view", str(tmp_path / "stroke.npz"), "--port", "18733"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            said = process.stdout.readline() if process.stdout else ""
            with urlopen(said.split()[0]) as page:
                assert b"<html" in page.read(2000)
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    assert said.startswith("http://127.0.0.1:")


def test_without_viser_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ExtraMissing, match=r"taxelflow\[view\]"):
        PageServer(port=0)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--port", "99999"), "--port must be from 0 to 65535 (got 99999)"),
        (("--port", "-1"), "--port must be from 0 to 65535 (got -1)"),
        (("--host", "192.0.2.1"), "--host must be an address of this computer, such as 127.0.0.1 (got '192.0.2.1')"),
        (("--sensor", "palmm"), "unknown sensor 'palmm'"),
        (("--sensor", "none.toml"), "there is no such file"),
        (("--method", "foo"), "unknown method 'foo'; known are lnorm, convolution, template,"),
        (("--from-s", "3"), "--from-s must be left out without --film (got 3.0)"),
        (("--from", "3"), "--from must be left out without --film (got 3.0)"),
        (("--speed", "0.5"), "--speed must be left out without --film (got 0.5)"),
        (("--film", "scene.avi"), "--film must end in .gif or .mp4 (got 'scene.avi')"),
        (("--method", "sum", "--method", "tempalte"), "unknown method 'tempalte'; did you mean 'template'?"),
    ],
    ids=lambda one: " ".join(one) if isinstance(one, tuple) else "",
)
def test_what_cannot_be_served_is_refused_before_an_address_is_printed(
    capsys: pytest.CaptureFixture[str], stroke: Recording, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    convert(stroke, tmp_path / "stroke.npz")
    assert says in refused(capsys, "view", tmp_path / "stroke.npz", *words)


def test_what_is_missing_is_one_line_without_an_address(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    assert "does not exist" in refused(capsys, "view", tmp_path / "none.npz")
    (tmp_path / "summary.json").touch()
    assert "holds results, not a recording; give the recording that" in refused(capsys, "view", tmp_path)
    assert "does not exist" in refused(capsys, "view", f"replay:{tmp_path / 'none.npz'}")
    assert "unknown source 'tpc'; did you mean 'tcp'?" in refused(capsys, "view", "tpc://127.0.0.1:1")
    assert "does not contain its sensor" in refused(capsys, "view", "tcp://127.0.0.1:1")


def test_the_page_is_there_before_the_pipeline_is_imported() -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    code = """
import sys
from urllib.request import urlopen
import taxelflow.cli
from taxelflow.publish.view.server import PageServer
with PageServer(port=0) as server:
    assert b"<html" in urlopen(server.url).read(2000)
    print([name for name in ("numba", "scipy", "taxelflow.pipeline.stages") if name in sys.modules])
"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split("\n")[0] == "[]"


def test_the_estimate_waits_for_a_browser_that_is_opening(stroke: Recording) -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    server = PageServer(port=0)
    playing = Playing(stroke, ("convolution",), server)
    try:
        threading.Thread(target=playing.run, args=(threading.Event(),), daemon=True).start()
        history = playing.page.histories[0]
        awaited(lambda: len(history.times) > 0)
        assert not history.complete
        server.opened.set()  # as a browser does
        awaited(lambda: history.complete)
    finally:
        playing.close()
