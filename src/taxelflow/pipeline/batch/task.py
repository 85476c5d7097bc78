"""One recording as a task: its results are complete or absent, and what goes wrong is a value, never an exception.

Workers import this module, so NumPy and all stages are loaded before the first task's clock starts.
"""

from __future__ import annotations

import shutil
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from importlib.metadata import version
from io import StringIO
from itertools import count
from pathlib import Path
from threading import Lock
from time import process_time
from typing import TYPE_CHECKING, Literal
from uuid import uuid4

import msgspec
from threadpoolctl import threadpool_limits

from taxelflow.errors import ExtraMissing, TaxelflowError, written_at
from taxelflow.pipeline import api
from taxelflow.pipeline.run_summary import summarise
from taxelflow.publish.parquet import NAMES, ParquetTables
from taxelflow.publish.summary import Totals, to_json

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.acquire.columns import Columns
    from taxelflow.pipeline.stages import Pipeline
    from taxelflow.publish.summary import Summary
    from taxelflow.sensors.sensor import Sensor

SUMMARY = "summary.json"
PARTS = ".parts"
"""Directory beside the results for files that are being written."""
_ONE = Lock()
"""Held by a task: on a worker with several threads, processor time would be that of all of them."""
_COUNT = count()
"""Of the tasks of this process."""


@dataclass(frozen=True)
class Settings:
    """All that results depend on besides the recording."""

    method: str
    pipeline: Pipeline
    sensor: Sensor | None
    topic: str | None
    columns: Columns | None
    contacts: str | None
    joints: str | None
    taxelflow: str = field(default_factory=lambda: version("taxelflow"))


@dataclass(frozen=True)
class Outcome:
    """What became of a recording.

    status: done; failed, through a fault of the recording; fault, through one of the worker, which leaves the recording
    undone. seconds: processor time, None where the results were there. message: why, or what a truncated recording
    lacks. recorded_s: length of the recording in its own time, s. warm: another recording was estimated before in the
    same process, which has loaded or compiled the kernels.
    """

    status: Literal["done", "failed", "fault"]
    seconds: float | None = None
    message: str = ""
    recorded_s: float = 0.0
    warm: bool = False


def estimate_one(settings: Settings, source: str, directory: str) -> Outcome:
    """Estimate a recording into a directory, unless its results are there."""
    with _ONE, threadpool_limits(1):
        path, out = Path(source), Path(directory)
        return finished(out) or _refused(settings, path) or _estimated(settings, path, out)


def _refused(settings: Settings, path: Path) -> Outcome | None:
    """The fault of a worker that cannot give the results that the client asks for."""
    own = version("taxelflow")
    if own != settings.taxelflow:
        return Outcome("fault", message=f"a worker has taxelflow {own}, not {settings.taxelflow}")
    if not path.exists():
        return Outcome("fault", message=f"a worker does not see {path}")
    return None


def _estimated(settings: Settings, path: Path, out: Path) -> Outcome:
    warm, start = next(_COUNT) > 0, process_time()
    try:
        with redirect_stderr(
            StringIO()
        ):  # notes are in the summary; bars of several workers would overwrite each other
            summary = _estimate(settings, path, out)
    except (ExtraMissing, ImportError, OSError, MemoryError) as error:
        return Outcome("fault", message=f"{type(error).__name__}: {error}")
    except TaxelflowError as error:
        return Outcome("failed", process_time() - start, str(error))
    except Exception as error:  # a recording that no one foresaw must not end the batch
        return Outcome("failed", process_time() - start, f"{type(error).__name__}: {error}")
    return Outcome("done", process_time() - start, summary.loss or "", summary.t_last_s - summary.t_first_s, warm)


class _Written(msgspec.Struct):
    """What is read of a summary."""

    input: str
    loss: str | None = None


def finished(out: Path) -> Outcome | None:
    """The outcome of a recording whose results are complete; None if they are not."""
    if not all((out / f"{name}.parquet").exists() for name in NAMES):
        return None
    try:
        return Outcome("done", message=_written(out).loss or "")
    except (FileNotFoundError, msgspec.DecodeError):  # the second after a crash of the machine
        return None


def source_of(out: Path) -> str:
    """The recording that complete results are of. Raises FileNotFoundError."""
    return _written(out).input


def _written(out: Path) -> _Written:
    return msgspec.json.decode((out / SUMMARY).read_bytes(), type=_Written)


def _estimate(settings: Settings, path: Path, out: Path) -> Summary:
    """Read, estimate, write beside the place of the results, then rename, the summary last."""
    recording = api.read(path, settings.sensor, topic=settings.topic, columns=settings.columns, joints=settings.joints)
    work = out.parent / PARTS / uuid4().hex  # with the name it could be too long for a file system
    with written_at(work):
        work.mkdir(parents=True)
    try:
        summary = _run(settings, recording.with_contacts(settings.contacts), work)
        with written_at(out):
            out.mkdir(exist_ok=True)
            for file in (*sorted(path.name for path in work.glob("*.parquet")), SUMMARY):
                (work / file).replace(out / file)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return summary


def _run(settings: Settings, recording: Recording, work: Path) -> Summary:
    totals = Totals(recording.layout)
    with ParquetTables(work, recording.layout.pads) as tables:
        run = settings.pipeline.start(recording)
        for output in run:
            tables.write(output.slips, output.slipping, output.motions, output.events, output.evidence)
            if output.spatial is not None:
                tables.write_spatial(output.spatial)
            totals.add(output.slips, output.events)
        summary = summarise(settings.method, settings.pipeline, run, totals)
    with written_at(work):
        (work / SUMMARY).write_bytes(to_json(summary))
    return summary
