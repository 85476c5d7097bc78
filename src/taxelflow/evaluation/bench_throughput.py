"""How many scans a second the batch step estimates, against reading memory and nothing else."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, cast

import msgspec
import numpy as np

from taxelflow.estimation.centroid.convolution_kernel import weighted_sums
from taxelflow.messages import Scans
from taxelflow.pipeline import api
from taxelflow.runtime.compiling import kernel
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.estimation.centroid.session import CentroidSession
    from taxelflow.evaluation.bench_effort import Effort
    from taxelflow.messages import Floats


class Throughput(msgspec.Struct, frozen=True):
    """Batch estimation of many scans at once, on one core, against reading memory and nothing else."""

    array: str
    what: str
    gb_per_s: float
    share_of_read: float
    million_scans_per_s: float


def throughput(size: int, effort: Effort) -> list[Throughput]:
    """Centroids alone, and the whole batch step with covariances, of arrays of size x size."""
    scans = effort.batch_bytes // (8 * size * size)
    layout = Sensor("grid", "kPa", (Pad("grid", size, size, (0.002, 0.002)),)).layout
    pressure = np.random.default_rng(0).uniform(1.0, 2.0, (scans, size * size))
    contact = np.ones((scans, 1), dtype=np.bool_)
    never = np.full(size * size, np.inf)
    block = Scans(np.linspace(0.0, 1.0, scans), pressure, np.full(size * size, 0.1), never, contact, contact)
    session = cast("CentroidSession", api.estimator("convolution").start(layout, "batch"))
    rows = session.room(scans)
    x, y, centroids = layout.x_m, layout.y_m, np.empty((scans, 2))
    flat = pressure.reshape(-1)
    read_s, centroid_s, step_s = _fastest(
        lambda: read_sum(flat),
        lambda: batch_centroids(pressure, x, y, size, centroids),
        lambda: session.run(block, rows),
        rounds=effort.batch_rounds,
    )
    return [
        Throughput(f"{size}x{size}", what, pressure.nbytes / s / 1e9, read_s / s, scans / s / 1e6)
        for what, s in (("reading", read_s), ("centroids", centroid_s), ("batch step", step_s))
    ]


def _fastest(*jobs: Callable[[], object], rounds: int) -> list[float]:
    """Shortest of several times of each, in turn."""
    taken = [[0.0] * rounds for _ in jobs]
    for job in jobs:
        job()
    for k in range(rounds):
        for number, job in enumerate(jobs):
            start = perf_counter()
            job()
            taken[number][k] = perf_counter() - start
    return [min(times) for times in taken]


@kernel
def read_sum(values: Floats) -> float:
    """Sum of an array: as fast as one core reads memory."""
    total = 0.0
    for k in range(len(values)):
        total += values[k]
    return total


@kernel
def batch_centroids(pressure: Floats, x: Floats, y: Floats, cols: int, centroids: Floats) -> None:
    """Centroids (scans, 2) of full grids (scans, taxels) with rows of length cols, by the estimator's own sums."""
    for scan in range(len(pressure)):
        s, sx, sy, _ = weighted_sums(pressure[scan], x, y, cols)
        centroids[scan, 0], centroids[scan, 1] = sx / s, sy / s
