"""A live source in the browser: the sink of `taxelflow view SOURCE`."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.joints import declared_joints
from taxelflow.condition.units import in_si
from taxelflow.pipeline.live.status import Rate, intake_words
from taxelflow.publish.view.history import History, Results
from taxelflow.publish.view.page import DRAWING_S, Page

if TYPE_CHECKING:
    from taxelflow.messages import RawScans
    from taxelflow.pipeline.live.api import Live
    from taxelflow.pipeline.live.loop import Report
    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.publish.view.server import PageServer

KEPT_S = 60.0
"""Time that can be scrubbed."""


class LiveView:
    """Feeds a page, which shows the newest scan; what comes faster than it draws is not shown. See `Sink`.

    live: what estimates; its learned tare is taken from the pressures.
    """

    lossless = False
    raw = True
    dropped = 0
    gathers_s = 0.02

    def __init__(self, live: Live, title: str, server: PageServer) -> None:
        """Fills the server's page."""
        self._live, self._stop, self._rate = live, threading.Event(), Rate()
        recording = live.recording
        joints = recording.joints or declared_joints(recording.sensor)
        self.history = History(keep_s=KEPT_S)
        self.page = Page(recording.sensor, (self.history,), title, server, joints)
        self.page.player.following = True

    def open(self, _head: Head) -> None:
        """Begin to show."""
        self._thread = threading.Thread(target=self.page.run, args=(self._stop,), name="view", daemon=True)
        self._thread.start()

    def write_raw(self, scans: RawScans, *, late: bool) -> None:
        """Pressures, as soon as tare is known."""
        learned = self._live.run.learned
        if late or learned is None:
            return
        sensor = self._live.recording.sensor
        readings = np.ascontiguousarray(sensor.channel_map.to_readings(scans.values))
        pressure = np.nan_to_num(in_si(readings, sensor) - learned.offset)
        pressure[:, learned.masked] = 0.0
        self.history.see(scans.t_s, pressure)

    def write(self, update: Update) -> None:
        """Results."""
        output = update.output
        results = Results(output.slips, output.slipping, output.motions, output.statistic, output.spatial)
        self.history.add(results, output.events)

    def tick(self) -> None:
        """The page has a thread of its own."""

    def watch(self, report: Report) -> None:
        """Show rate, latency and losses of the source. Called by the run several times a second."""
        if self._stop.is_set():
            return
        words = intake_words(report, self._rate.of(report))
        self.page.panel.show_source(f"{words}  \nlatency to the estimate: {report.estimated.words()}")

    def hurry(self) -> None:
        """Nothing is waited for."""

    def close(self, _ending: Ending) -> None:
        """Stop the page."""
        self._stop.set()
        self._thread.join(DRAWING_S)
        self.page.close()
