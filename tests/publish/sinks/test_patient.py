"""A file of a live run belongs to that run alone."""

from __future__ import annotations

import errno
import os
from typing import TYPE_CHECKING

import pytest

from taxelflow.errors import SinkUnusable
from taxelflow.publish.sinks import patient
from taxelflow.publish.sinks.patient import PatientFile

if TYPE_CHECKING:
    from pathlib import Path


def opened(path: Path | int) -> PatientFile:
    return PatientFile(path, lambda _kind, _seen: None)


def test_a_file_that_another_run_writes_is_refused_and_keeps_its_content(tmp_path: Path) -> None:
    first = opened(tmp_path / "a")
    first.write(b"rows")
    with pytest.raises(SinkUnusable, match="another run writes to it; choose another file, or end that run"):
        opened(tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == b"rows"
    first.close()
    opened(tmp_path / "a").close()
    assert (tmp_path / "a").read_bytes() == b""


def test_a_file_system_without_locks_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_arguments: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(patient.fcntl, "flock", fail)
    (tmp_path / "a").write_text("an older run")
    with opened(tmp_path / "a") as file:
        file.write(b"rows")
    assert (tmp_path / "a").read_bytes() == b"rows"


def test_several_runs_may_write_to_one_device() -> None:
    for file in [opened_null() for _ in range(2)]:
        file.close()


def opened_null() -> PatientFile:
    return PatientFile(os.devnull, lambda _kind, _seen: None)


def test_a_descriptor_that_was_given_stays_open(tmp_path: Path) -> None:
    descriptor = os.open(tmp_path / "a", os.O_WRONLY | os.O_CREAT)
    opened(descriptor).close()
    os.close(descriptor)
