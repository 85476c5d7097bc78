"""Tiny recordings for batches, and what a batch wrote."""

from __future__ import annotations

import csv
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from synthetic import dome, grid_sensor
from taxelflow.pipeline.api import convert, recording
from taxelflow.pipeline.batch.task import estimate_one

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from taxelflow.pipeline.batch.task import Outcome, Settings

PALM = grid_sensor(4, 7)


def slides(folder: Path, *names: str) -> list[Path]:
    """A recording of each name: a dome that moves over a palm, each a little faster than the one before."""
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        values = np.random.default_rng(number).normal(0, 100, (60, 28))
        values[20:] += np.array([dome(PALM, (0.0005 + 0.0001 * number) * scan) for scan in range(-20, 20)])
        convert(recording(np.arange(60) / 10, values, PALM), folder / name)
    return [folder / name for name in names]


def manifest(out: Path) -> list[dict[str, str]]:
    """Rows of the manifest, without the folders of the recordings."""
    with (out / "manifest.csv").open(newline="") as file:
        return [row | {"recording": row["recording"].rpartition("/")[2]} for row in csv.DictReader(file)]


def statuses(out: Path) -> dict[str, str]:
    return {row["recording"]: row["status"] for row in manifest(out)}


def written(out: Path) -> dict[str, bytes]:
    """Bytes of every file of a batch, without the seconds of the manifest."""
    files = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    rows = [(row["recording"], row["status"], row["message"]) for row in manifest(out)]
    return files | {"manifest.csv": repr(rows).encode()}


@contextmanager
def alone(_scheduler: str | None, _workers: int | None, *, most: int) -> Iterator[None]:
    """In place of a cluster: this process."""
    assert most
    yield


def one_by_one(_client: None, settings: Settings, tasks: Iterable[tuple[Path, Path]]) -> Iterator[tuple[Path, Outcome]]:
    """Outcomes in the order of the tasks, from this process."""
    for source, out in tasks:
        yield source, estimate_one(settings, str(source), str(out))
