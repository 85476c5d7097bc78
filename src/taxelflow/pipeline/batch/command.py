"""The command `batch`. NumPy is imported when it runs, so that help is fast."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

import tyro
from tyro.conf import Positional

from taxelflow.acquire.options import Source
from taxelflow.errors import ParameterInvalid
from taxelflow.pipeline.batch.options import Estimating
from taxelflow.runtime.addresses import MOST_PORT
from taxelflow.runtime.exit_codes import ExitCode


@dataclass(frozen=True, kw_only=True)
class Batch(Source, Estimating):
    """Estimate many recordings, on all cores or on a Dask cluster (extra cluster), as Parquet files and a manifest.

    DIR/NAME/ gets slips.parquet, object.parquet, events.parquet, summary.json of the recording NAME.npz;
    DIR/manifest.csv a row for each recording that is done or has failed. Run again, it does what is missing.
    A method's own parameters follow as options, e.g. --gain 1.04 for lnorm and convolution.
    Exit code: 0 if all are done; 1 if some failed, now or before; 2 on bad input, or if the cluster failed.
    """

    recordings: Annotated[Positional[tuple[str, ...]], tyro.conf.arg(metavar="RECORDING")]
    """Recordings: paths, quoted patterns such as 'runs/**/*.npz', or directories of recordings. Their names without
    suffix must differ."""
    out: Path
    """Directory for the results; created if it does not exist."""
    workers: int | None = None
    """Number of processes on this machine; as many as cores if left out."""
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://HOST:8786, whose workers see the same files."""
    retry_failed: bool = False
    """Estimate recordings again that failed before."""

    def run(self, rest: list[str]) -> int:
        """Find recordings, estimate those that are missing, print what became of them."""
        from taxelflow.pipeline.batch.recordings import find_recordings
        from taxelflow.pipeline.batch.run import run_batch
        from taxelflow.pipeline.batch.task import Settings
        from taxelflow.runtime.signals import Signals
        from taxelflow.sensors.catalogue import load_sensor

        if further := [word for word in rest if not word.startswith("-") and Path(word).exists()]:
            raise ParameterInvalid("recordings", further[0], "stand before the method's own options")
        if self.workers is not None and self.workers < 1:
            raise ParameterInvalid("workers", self.workers, "be at least 1")
        if self.workers is not None and self.scheduler is not None:
            raise ParameterInvalid("workers", self.workers, "be left out with --scheduler, which has its own")
        _check_port(self.scheduler or "")
        sensor = None if self.sensor is None else load_sensor(self.sensor)
        files = {name: path.absolute() for name in ("file", "times") if (path := getattr(self.columns, name))}
        columns = None if self.own_columns is None else replace(self.columns, **files)
        joints = str(Path(self.joints).absolute()) if self.joints and self.joints.endswith(".csv") else self.joints
        pipeline = self.pipeline(rest, "batch")
        settings = Settings(self.method, pipeline, sensor, self.topic, columns, self.contacts, joints)
        folders = bool(self.columns.pads) or (sensor is not None and any(pad.files for pad in sensor.pads))
        out = self.out.absolute()
        recordings = find_recordings(self.recordings, out, folders=folders)
        try:
            with Signals():  # a scheduler of jobs sends SIGTERM, which would leave Dask's workers to themselves
                report = run_batch(
                    recordings, out, settings, self.scheduler, self.workers, retry_failed=self.retry_failed
                )
        except KeyboardInterrupt:
            print("taxelflow: interrupted; what is finished is kept: run the same command again", file=sys.stderr)
            return ExitCode.INTERRUPTED
        for line in report.lines():
            print(line)
        for line in report.complaints():
            print(f"taxelflow: {line}", file=sys.stderr)
        return ExitCode.PARTLY_DONE if report.failed else 0


def _check_port(scheduler: str) -> None:
    """Raises ParameterInvalid for a port that Dask would try in vain for 10 s."""
    try:
        _ = urlsplit(scheduler).port
    except ValueError as error:
        raise ParameterInvalid("scheduler", scheduler, f"have a port from 0 to {MOST_PORT}") from error
