"""Score batch: how much faster `taxelflow batch` is with more workers, and what its processes cost.

The same recordings are estimated by each number of workers in turn. Rates are of the time after every worker has ended
its first recording: until then workers start, import and load kernels, which costs the same for a thousand recordings.
The processor time says what a busy machine hides: what the client, with Dask's scheduler in it, spends on a recording
is serial, and a task that costs more beside another one shares caches, memory or cores with it.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import TYPE_CHECKING

import msgspec
from rich.console import Console

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import caption, shown
from taxelflow.pipeline import api
from taxelflow.pipeline.batch.cluster import connected, outcomes
from taxelflow.pipeline.batch.task import Settings
from taxelflow.pipeline.stages import Pipeline
from taxelflow.runtime.checks import at_least
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from taxelflow.evaluation.base import Table, Watch

_SCENARIO = SCENARIOS["slide-and-turn-over-hand"]


class WorkersRow(msgspec.Struct, frozen=True):
    """One number of workers; times are of one recording, s."""

    workers: int
    wall_s: float
    """Of the client's clock, while all workers have ended their first recording."""
    ratio: float
    """Of the rate to that of the first row."""
    task_s: float
    """Processor time of the task."""
    client_s: float
    """Processor time of the client and Dask's scheduler."""
    first_task_s: float
    """Processor time of a worker's first recording, in which it loads kernels."""
    first_wall_s: float
    """Of the client's clock, from the start until each worker has ended its first recording."""


@dataclass(frozen=True)
class BatchWorkers:
    """Measure the rate of `taxelflow batch` by its workers.

    Needs the extra `cluster`. On a machine whose cores are busy with other work the ratio is too small.
    """

    recordings: int = 40
    """Number of recordings, copies of one of 162 taxels; at least 4 for each worker."""
    workers: tuple[int, ...] = (1, 2)
    """Numbers of workers, in turn; the first is what the others are compared with."""
    method: str = "convolution"
    """Estimator."""

    def __post_init__(self) -> None:
        if not self.workers or min(self.workers) < 1:
            raise ParameterInvalid("workers", self.workers, "be numbers of 1 or more")
        at_least("recordings", self.recordings, 4 * max(self.workers))

    def run(self, watched: Watch = unwatched) -> WorkersReport:
        """Simulate one recording, copy it, estimate all. Raises NameUnknown, ExtraMissing, ClusterFault."""
        settings = Settings(self.method, Pipeline(api.estimator(self.method)), None, None, None, None, None)
        with TemporaryDirectory() as folder:
            recordings = [Path(folder) / f"{number}.npz" for number in range(self.recordings)]
            save(replace(_SCENARIO, seed=1), recordings[0])
            for copy in recordings[1:]:
                shutil.copyfile(recordings[0], copy)
            rows: list[WorkersRow] = []
            for workers in watched(self.workers, "numbers of workers"):
                row = _measured(settings, recordings, Path(folder) / f"by-{workers}", workers)
                rows.append(msgspec.structs.replace(row, ratio=(rows[0] if rows else row).wall_s / row.wall_s))
        return WorkersReport(self.method, self.recordings, rows)


class WorkersReport(msgspec.Struct, frozen=True):
    """A row for each number of workers."""

    method: str
    recordings: int
    rows: list[WorkersRow]

    def tables(self) -> list[Table]:
        """The rows."""
        return [table_of("rows", self.rows, WorkersRow)]

    def show(self) -> None:
        """One table."""
        console = Console(markup=False)
        times = (("task CPU s", "task_s", 3), ("client CPU s", "client_s", 3))
        first = (("first CPU s", "first_task_s", 3), ("first wall s", "first_wall_s", 3))
        columns = (("workers:", "workers"), ("wall s", "wall_s", 3), ("ratio", "ratio", 2), *times, *first)
        console.print(shown(self.rows, *columns, title=f"batch, {self.method}, {self.recordings} recordings"))
        caption(
            console,
            "wall, task and client: of one recording, after each worker's first, which loads kernels; "
            "ratio: of the rate to that of the first row, on idle cores only.",
        )


def _measured(settings: Settings, recordings: list[Path], out: Path, workers: int) -> WorkersRow:
    """The row of one number of workers; its ratio is 1."""
    out.mkdir()
    start, clock, spent = perf_counter(), 0.0, 0.0
    first: list[float] = []
    ended: list[float] = []
    with connected(None, workers, most=len(recordings)) as client:
        for _, outcome in outcomes(client, settings, ((path, out / path.stem) for path in recordings)):
            (ended if outcome.warm else first).append(outcome.seconds or 0.0)
            if not outcome.warm:
                clock, spent = perf_counter(), process_time()
                ended.clear()
        wall_s, client_s = perf_counter() - clock, process_time() - spent
    count = len(ended)
    return WorkersRow(
        workers=workers,
        wall_s=wall_s / count,
        ratio=1.0,
        task_s=sum(ended) / count,
        client_s=client_s / count,
        first_task_s=sum(first) / len(first),
        first_wall_s=clock - start,
    )
