"""A batch from its recordings to its manifest: what is finished is found, what is missing is estimated."""

from __future__ import annotations

from dataclasses import dataclass, field
from shutil import rmtree
from typing import TYPE_CHECKING, Any

import msgspec

from taxelflow.errors import BatchUnlike, ClusterFault, RecordingMissing, RecordingsAlike, printable, written_at
from taxelflow.pipeline.batch.cluster import connected, outcomes
from taxelflow.pipeline.batch.manifest import Manifest, Row
from taxelflow.pipeline.batch.task import PARTS, finished, source_of
from taxelflow.publish.summary import to_json
from taxelflow.publish.terminal import counted
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from taxelflow.pipeline.batch.task import Outcome, Settings

MANIFEST, SETTINGS = "manifest.csv", "batch.json"
_MOST_FAULTS = 20
"""Faults in a row after which the cluster is taken to be broken."""


@dataclass(frozen=True, slots=True)
class _Printed:
    """What is printed at most."""

    listed: int = 10
    """Failures and differences."""
    characters: int = 80
    """Characters of a setting."""


_PRINTED = _Printed()


@dataclass
class Report:
    """What became of a batch.

    failed: rows of its recordings that failed, now or before. left: how many of these failed before and were left out.
    seconds, recorded_s: processor time and length of the recordings that were estimated on workers which had estimated
    before.
    """

    directory: Path
    recordings: int
    before: int = 0
    now: int = 0
    left: int = 0
    failed: list[Row] = field(default_factory=list)
    seconds: float = 0.0
    recorded_s: float = 0.0

    def count(self, outcome: Outcome) -> None:
        """Count a recording in that is done or has failed."""
        self.now += outcome.status == "done"
        if outcome.warm and outcome.recorded_s > 0:
            self.seconds += outcome.seconds or 0.0
            self.recorded_s += outcome.recorded_s

    def lines(self) -> list[str]:
        """A few lines for the terminal."""
        of = "1 recording" if self.recordings == 1 else f"{self.recordings} recordings"
        done = f"{self.before + self.now} done ({self.now} now, {self.before} before)"
        lines = [f"{of}: {done}, {len(self.failed)} failed"]
        if self.recorded_s > 0:
            lines.append(
                f"{3600 * self.seconds / self.recorded_s:.3g} s of processor time per hour of recording, without the "
                f"first of each worker, which loads kernels ({self.recorded_s / 3600:.2g} h in {self.seconds:.2g} s)"
            )
        return [*lines, f"results in {self.directory}"]

    def complaints(self) -> list[str]:
        """A line for each of the first failures, and how many there are more."""
        listed = [f"failed: {row.recording}: {row.message}" for row in self.failed[: _PRINTED.listed]]
        if (more := len(self.failed) - _PRINTED.listed) > 0:
            listed.append(f"{more} more failed: see {self.directory / MANIFEST}")
        if self.left:
            were, them = ("was", "it") if self.left == 1 else ("were", "them")
            listed.append(f"{self.left} of these failed before and {were} left out; --retry-failed repeats {them}")
        return listed


def run_batch(
    recordings: Mapping[str, Path],
    out: Path,
    settings: Settings,
    scheduler: str | None,
    workers: int | None,
    *,
    retry_failed: bool,
) -> Report:
    """Estimate what is missing. recordings: by the name of their result. scheduler, workers: see `connected`.

    Raises BatchUnlike and RecordingsAlike where `out` holds other results, ExtraMissing, and ClusterFault where
    recordings are left undone.
    """
    with written_at(out):
        out.mkdir(parents=True, exist_ok=True)
    report = Report(out, len(recordings))
    with Manifest(out / MANIFEST) as manifest:
        missing = _missing(recordings, out, manifest, retry_failed=retry_failed)
        settled = [path for name, path in recordings.items() if name not in missing]
        report.left = len(manifest.of(settled, "failed"))
        report.before = len(settled) - report.left
        _check_settings(out, settings, fresh=not any(row.status == "done" for row in manifest.rows.values()))
        if missing:
            _estimate(missing, settings, (scheduler, workers), manifest, report)
        report.failed = manifest.of(recordings.values(), "failed")
    rmtree(out / PARTS, ignore_errors=True)
    return report


def _missing(recordings: Mapping[str, Path], out: Path, manifest: Manifest, *, retry_failed: bool) -> dict[str, Path]:
    """Recordings without results, besides those that failed; the manifest gets rows of results that it lacks.

    Raises RecordingsAlike where results of that name are of another recording.
    """
    missing = {}
    for name, path in recordings.items():
        row = manifest.rows.get(printable(str(path)))
        found = finished(out / name)
        if found is None:
            if not (row is None or row.status == "done" or retry_failed):
                continue
            if path.is_symlink() and not path.exists():  # no worker will ever see it
                manifest.add(Row(printable(str(path)), "failed", None, str(RecordingMissing(path))))
            else:
                missing[name] = path
        elif row is None or row.status == "failed":
            if (source := source_of(out / name)) != str(path):
                raise RecordingsAlike(source, path, out / name)
            manifest.add(Row(printable(str(path)), "done", None, found.message))
    return missing


def _check_settings(out: Path, settings: Settings, *, fresh: bool) -> None:
    """Raises BatchUnlike where results are of other settings. fresh: there are none, so that these settings hold."""
    file = out / SETTINGS
    asked = to_json(msgspec.to_builtins(settings, enc_hook=str))
    if not fresh and file.exists():
        unlike = list(_unlike(msgspec.json.decode(file.read_bytes()), msgspec.json.decode(asked)))
        if unlike:
            raise BatchUnlike(out, ", ".join(unlike[: _PRINTED.listed]))
        return
    with whole_file(file) as part:
        part.write_bytes(asked)


def _unlike(before: Mapping[str, Any], now: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """`KEY was X, is Y` of each value of nested mappings that differs, by dotted keys."""
    for key in {**before, **now}:
        was, present = before.get(key), now.get(key)
        if isinstance(was, dict) and isinstance(present, dict):
            yield from _unlike(was, present, f"{prefix}{key}.")
        elif was != present:
            yield f"{prefix}{key} was {_short(was)}, is {_short(present)}"


def _short(value: Any) -> str:
    """A setting in a line: what has a name, as a sensor has, by that name."""
    if isinstance(value, dict) and "name" in value:
        value = value["name"]
    text = repr(value)
    return text if len(text) <= _PRINTED.characters else f"{text[: _PRINTED.characters]}..."


def _estimate(
    missing: Mapping[str, Path],
    settings: Settings,
    where: tuple[str | None, int | None],
    manifest: Manifest,
    report: Report,
) -> None:
    """Estimate recordings, and add a row for each that is done or has failed. Raises ClusterFault for any other."""
    faults: list[str] = []
    in_a_row = ended = 0
    tasks = ((path, report.directory / name) for name, path in missing.items())
    with connected(*where, most=len(missing)) as client:
        for path, outcome in counted(outcomes(client, settings, tasks), "recordings", len(missing)):
            if outcome.status == "fault":
                faults.append(f"{path}: {outcome.message}")
                in_a_row += 1
            else:
                in_a_row = 0
                ended += 1
                manifest.add(Row(printable(str(path)), outcome.status, outcome.seconds, outcome.message))
                report.count(outcome)
            if in_a_row == _MOST_FAULTS:
                break
    if faults:
        undone = len(missing) - ended
        seen = "1 recording is" if undone == 1 else f"{undone} recordings are"
        raise ClusterFault(
            f"{seen} not done, because workers failed; the first failure is {faults[0]}",
            "repair the cause, then run the same command again: what is finished is kept",
        )
