"""Score view: how soon the page is there, what its server and a browser cost while a large hand is shown."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.evaluation.base import Table, Watch, table_of, unwatched
from taxelflow.evaluation.live_bench import resident_mb
from taxelflow.evaluation.view import Filling
from taxelflow.evaluation.view_tab import DEBUGGED, Tab
from taxelflow.messages import cut
from taxelflow.pipeline import api
from taxelflow.pipeline.live.view import KEPT_S
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.view.browser import BrowserFailed, drawn_by, headless
from taxelflow.publish.view.history import History, Results
from taxelflow.publish.view.look import PANEL
from taxelflow.publish.view.page import Page
from taxelflow.publish.view.server import PageServer
from taxelflow.runtime.checks import positive
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Window:
    """The browser's window, pixels."""

    width: int = 1600
    height: int = 900


_WINDOW = _Window()
_SENSOR, _PAD = "inspire-rh56dftp@3.0mm", "palm"
_SCENARIO = SCENARIOS["stroke"]
_SETTLE_S = 5.0
"""Left out at the start: the browser compiles shaders and code."""


class StartRow(msgspec.Struct, frozen=True):
    """From the command to the first picture, with the browser already running."""

    address_s: float
    """Until the address is printed."""
    address_cpu_s: float
    """Processor time of the command until then; NaN where the system does not report it."""
    picture_s: float
    """Until a scan is drawn."""
    load_average: float
    """Of the machine: a figure from a busy machine is of little use."""


class ShowRow(msgspec.Struct, frozen=True):
    """A hand that is shown for a while."""

    taxels: int
    rate_hz: float
    """Of the scans."""
    seconds: float
    updates_hz: float
    """Scans that were sent to the browser."""
    core_share: float
    """Processor time of the server, all its threads, over time."""
    drawn_hz: float
    """Pictures that the browser drew."""
    renderer: str
    """What the browser draws with."""
    heap_mb: float
    """JavaScript heap at the end, after a collection."""
    heap_growth_mb: float
    """Since the first quarter."""
    resident_mb: float
    resident_growth_mb: float
    load_average: float


class ViewReport(msgspec.Struct, frozen=True):
    """Both tables."""

    shown: list[ShowRow]
    start: list[StartRow]

    def tables(self) -> list[Table]:
        """See `Score`."""
        return [table_of("shown", self.shown, ShowRow), table_of("start", self.start, StartRow)]

    def show(self) -> None:
        """Print them."""
        from rich.console import Console

        console = Console(markup=False, highlight=False, soft_wrap=True)
        for start in self.start:
            console.print(
                f"start: address after {start.address_s:.1f} s ({start.address_cpu_s:.1f} s of processor time), "
                f"first picture after {start.picture_s:.1f} s; load average {start.load_average:.1f}"
            )
        for row in self.shown:
            console.print(
                f"{row.taxels} taxels at {row.rate_hz:g} Hz for {row.seconds:g} s: {row.updates_hz:.1f} updates a "
                f"second, server {100 * row.core_share:.1f} % of a core, {row.resident_mb:.0f} MB "
                f"({row.resident_growth_mb:+.1f}); browser draws {row.drawn_hz:.1f} a second, heap {row.heap_mb:.1f} "
                f"MB ({row.heap_growth_mb:+.2f}); {row.renderer}; load average {row.load_average:.1f}"
            )


@dataclass(frozen=True)
class ViewBench:
    """Measure start, processor time and memory of `taxelflow view`."""

    seconds: float = 60.0
    """Time for which a hand is shown, s; 600 shows whether memory grows."""
    rate_hz: float = 100.0
    """Rate of the scans, Hz."""

    def __post_init__(self) -> None:
        positive("seconds", self.seconds)
        positive("rate_hz", self.rate_hz)

    def run(self, watched: Watch = unwatched) -> ViewReport:
        """Measure. Raises BrowserMissing, BrowserFailed, ExtraMissing."""
        with (
            TemporaryDirectory() as folder,
            headless("about:blank", _WINDOW.width, _WINDOW.height, DEBUGGED) as browser,
        ):
            tab = Tab(browser)
            try:
                start = next(iter(watched([_start(tab, Path(folder))], "starts")))
                return ViewReport([_show(tab, self.seconds, self.rate_hz)], [start])
            finally:
                tab.close()


def _start(tab: Tab, folder: Path) -> StartRow:
    """Run the command in a process of its own."""
    recording = folder / "stroke.npz"
    save(_SCENARIO, recording)
    command = [sys.executable, "-m", "taxelflow.cli", "view", str(recording), "--port", "0"]
    began = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            printed = process.stdout.readline() if process.stdout else ""
            if not printed.startswith("http"):
                raise BrowserFailed(f"taxelflow view printed {printed.strip()!r}, not its address")
            address_s, address_cpu_s = time.monotonic() - began, _cpu_s(process.pid)
            tab.open(printed.split()[0])
            tab.wait_for("document.querySelector('canvas') && document.body.innerText.includes(' s · ')")
            tab.count_pictures()
            tab.wait_for("window.drawn > 2")
            return StartRow(address_s, address_cpu_s, time.monotonic() - began, os.getloadavg()[0])
        finally:
            process.terminate()


def _cpu_s(process: int) -> float:
    """Processor time of a process so far, s."""
    statistics = Path(f"/proc/{process}/stat")
    if not statistics.exists():
        return float("nan")
    after_name = statistics.read_text(encoding="utf-8").rpartition(")")[2].split()
    *_, user, system = after_name[:13]  # `utime` and `stime` of proc(5)
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def _show(tab: Tab, seconds: float, rate_hz: float) -> ShowRow:
    """Show scans of the Inspire hand as they come, each with its result."""
    sensor, t_s, pressure, results = _prepared()
    history = History(keep_s=KEPT_S)
    page = Page(sensor, (history,), "measured", PageServer(port=0))
    page.player.following = True
    stop = threading.Event()
    feeding = threading.Thread(
        target=_feed, args=(history, t_s, pressure, results, rate_hz, stop), name="feed", daemon=True
    )
    showing = threading.Thread(target=page.run, args=(stop,), name="view", daemon=True)
    try:
        feeding.start()
        showing.start()
        tab.open(page.url)
        drawn_by(page, _WINDOW.width - PANEL.wide)
        time.sleep(_SETTLE_S)
        tab.count_pictures()
        cpu_s, began, draws = time.process_time(), time.monotonic(), page.draws
        time.sleep(seconds / 4)
        heap_mb, held_mb = tab.heap_mb(), resident_mb()
        time.sleep(max(0.0, began + seconds - time.monotonic()))
        lasted = time.monotonic() - began
        row = ShowRow(
            sensor.layout.taxels,
            rate_hz,
            seconds,
            (page.draws - draws) / lasted,
            (time.process_time() - cpu_s) / lasted,
            tab.pictures / lasted,
            tab.renderer,
            end_mb := tab.heap_mb(),
            end_mb - heap_mb,
            resident_mb(),
            resident_mb() - held_mb,
            os.getloadavg()[0],
        )
    finally:
        stop.set()
        feeding.join()
        showing.join()
        page.close()
    return row


def _prepared() -> tuple[Sensor, Floats, Floats, Results]:
    """A sensor, times (scans,), pressures (scans, taxels) and results of a slide over its palm."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "palm.npz"
        save(replace(_SCENARIO, sensor=_SENSOR, pad=_PAD), path)
        recording = api.read(path)
        history = History()
        Filling(recording, Pipeline(api.estimator("convolution")), history).fill()
    known, times = history.within(-np.inf, np.inf), history.times
    assert known is not None
    snapshots = [history.at(float(at_s)) for at_s in times]
    pressure = np.array([snapshot.pressure for snapshot in snapshots if snapshot is not None])
    return recording.sensor, times, pressure, known


def _feed(
    history: History, t_s: Floats, pressure: Floats, results: Results, rate_hz: float, stop: threading.Event
) -> None:
    """Add scans at their rate, the recording over and over, until `stop` is set."""
    cuts = [
        (
            pressure[k : k + 1],
            Results(
                cut(results.slips, k, k + 1),
                results.slipping[k : k + 1],
                cut(results.motions, k, k + 1),
                results.statistic[k : k + 1],
            ),
        )
        for k in range(len(t_s))
    ]
    began, scan = time.monotonic(), 0
    while not stop.is_set():
        at_s = np.array([scan / rate_hz])
        row, result = cuts[scan % len(cuts)]
        history.see(at_s, row)
        slips, motions = replace(result.slips, t_s=at_s), replace(result.motions, t_s=at_s)
        history.add(result._replace(slips=slips, motions=motions), [])
        scan += 1
        stop.wait(max(0.0, began + scan / rate_hz - time.monotonic()))
