"""`taxelflow view`: a recording that is played in the browser while it is being estimated."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.acquire.joints import declared_joints
from taxelflow.errors import TaxelflowError
from taxelflow.pipeline import api
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.view.history import History, Results
from taxelflow.publish.view.page import DRAWING_S, Page

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Output
    from taxelflow.publish.view.server import PageServer


@dataclass(frozen=True, slots=True)
class _First:
    """The first picture."""

    browser_s: float = 3.0
    """The estimate of a recording waits so long at most for a browser: compiling kernels would delay the first
    picture."""
    draws_s: float = 1.0
    """A browser that has loaded the page draws the first picture in this time, also where it draws without a GPU. It
    needs a core and a half for that, more than a small computer has beside the estimate."""


_FIRST = _First()

_log = logging.getLogger("taxelflow")


@dataclass
class Filling:
    """Fills the history of a method from a recording. notes: what was lost or odd, once it is estimated."""

    recording: Recording
    pipeline: Pipeline
    history: History
    notes: list[str] = field(default_factory=list)

    def fill(self) -> None:
        """Read, condition, estimate: first the pressures, then the results."""
        self.see()
        self.estimate()

    def see(self) -> None:
        """The pressures."""
        taxels = self.recording.layout.taxels
        for scans in api.segmented(self.recording, self.pipeline.condition):
            self.history.see(scans.t_s, scans.pressure[:, :taxels])

    def estimate(self) -> None:
        """The results, block by block."""
        run = self.pipeline.start(self.recording)
        for output in run:
            self.history.add(_results_of(output), output.events)
        self.history.patterns = run.patterns
        self.history.complete = True
        self.notes = [*run.reading.notes, *run.notes, *([str(run.reading.loss)] if run.reading.loss else [])]

    def decide(self, alarms_per_hour: float) -> None:
        """Detect slips again, at another rate of false alarms; the old results are shown until then."""
        self.pipeline = replace(self.pipeline, monitor=replace(self.pipeline.monitor, alarms_per_hour=alarms_per_hour))
        outputs = [*self.pipeline.start(self.recording)]
        blocks = [_results_of(one) for one in outputs if len(one)]
        self.history.replace(blocks, [event for one in outputs for event in one.events])


def _results_of(output: Output) -> Results:
    return Results(output.slips, output.slipping, output.motions, output.statistic, output.spatial)


class Playing:
    """The page of a recording, and the threads that fill and show it."""

    def __init__(
        self,
        recording: Recording,
        methods: Sequence[str],
        server: PageServer,
        *,
        flat: bool = False,
    ) -> None:
        """Fills the server's page. flat: the hand is laid flat, whatever is known of its joint angles.

        Raises NameUnknown.
        """
        self._fillings = [
            Filling(recording, Pipeline(api.estimator(method)), History(method=method)) for method in methods
        ]
        self._stop, self._busy = threading.Event(), threading.Lock()
        self._showing: threading.Thread | None = None
        self.error: Exception | None = None
        name = recording.source.name if isinstance(recording.source, Path) else recording.source
        self.page = Page(
            recording.sensor,
            tuple(filling.history for filling in self._fillings),
            f"{name}, {' and '.join(methods)}",
            server,
            None if flat else recording.joints or declared_joints(recording.sensor),
        )
        self.page.on_decide(self.decide)

    def fill(self) -> None:
        """Read and estimate, by one method after the other. Raises what reading raises."""
        self._fillings[0].see()
        self._estimate()

    def decide(self, alarms_per_hour: float) -> None:
        """Detect slips again, unless that is being done."""
        show = self.page.panel.show_decided
        if not all(filling.history.complete for filling in self._fillings) or not self._busy.acquire(blocking=False):
            show("wait until the recording is estimated")
            return
        try:
            show("deciding ...")
            for filling in self._fillings:
                filling.decide(alarms_per_hour)
            slips = sum(event.event == "slip_start" for event in self._fillings[0].history.events)
            show(f"{slips} slips at {alarms_per_hour:g} false alarms per hour")
        except TaxelflowError as error:
            show(str(error))
        finally:
            self._busy.release()

    def run(self, asked: threading.Event, seen: Callable[[], None] = lambda: None) -> None:
        """Fill and show until asked to end. seen: called when all pressures are known. Raises what reading raises."""
        threading.Thread(target=self._guarded, args=(seen,), name="estimate", daemon=True).start()
        self._showing = showing = threading.Thread(target=self.page.run, args=(self._stop,), name="view", daemon=True)
        showing.start()
        try:
            while showing.is_alive() and not asked.is_set():
                showing.join(0.2)
                if self.error is not None:
                    raise self.error
        finally:
            self._stop.set()
            showing.join()  # before the server closes that it draws on

    def _estimate(self) -> None:
        for filling in self._fillings:
            filling.estimate()
        for note in dict.fromkeys(note for filling in self._fillings for note in filling.notes):
            _log.warning("%s", note)

    def close(self) -> None:
        """Stop to show, and the server."""
        self._stop.set()
        if self._showing is not None:
            self._showing.join(DRAWING_S)
        self.page.close()

    def _guarded(self, seen: Callable[[], None]) -> None:
        try:
            self._fillings[0].see()
            seen()
            if self.page.wait_for_browser(_FIRST.browser_s):
                self._stop.wait(_FIRST.draws_s)
            self._estimate()
        except Exception as error:  # raised by the thread that waits
            self.error = error
