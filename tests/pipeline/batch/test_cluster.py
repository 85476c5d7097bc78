"""Scheduler and workers as processes of their own on loopback, killed while they work."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from batched import alone, one_by_one, slides, statuses, written
from taxelflow.cli import main

if TYPE_CHECKING:
    from collections.abc import Iterator

READER = """
import os
from dataclasses import replace
from taxelflow.acquire.npz import open_npz

def open_held(path, sensor):
    with path.with_name("read").open("a") as log:
        log.write(f"{os.getpid()} {path.stem}\\n")
    if path.with_suffix(".gate").exists():
        with path.with_suffix(".gate").open() as gate:  # waits until the test has opened and closed its end
            gate.read()
    return replace(open_npz(path, sensor), source=path)
"""
"""A reader of .held files, which are .npz files that are read when the test says so, and notes who reads what."""


class Processes:
    """Programs in the background of a folder, in which the reader of .held files is installed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._running: list[subprocess.Popen[bytes]] = []
        (folder / "held.py").write_text(READER)
        installed = folder / "held-0.1.dist-info"
        installed.mkdir()
        (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: held\nVersion: 0.1\n")
        (installed / "entry_points.txt").write_text("[taxelflow.reader]\n.held = held:open_held\n")

    def start(self, *words: object) -> subprocess.Popen[bytes]:
        environment = os.environ | {"PYTHONPATH": str(self.folder), "DASK_LOGGING__DISTRIBUTED": "critical"}
        command = [sys.executable, "-m", *map(str, words)]
        with (self.folder / f"said-{len(self._running)}").open("wb") as said:
            process = subprocess.Popen(command, env=environment, stdout=said, stderr=said, cwd=self.folder)
        self._running.append(process)
        return process

    def said(self, process: subprocess.Popen[bytes]) -> str:
        return (self.folder / f"said-{self._running.index(process)}").read_text()

    def kill(self, number: int) -> None:
        """kill -9, and wait until the process is gone."""
        [process] = [process for process in self._running if process.pid == number]
        process.kill()
        process.wait()

    def end(self) -> None:
        for process in self._running:
            process.kill()
            process.wait()


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    started = Processes(tmp_path)
    yield started
    started.end()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def held(folder: Path, name: str) -> Path:
    """A recording that is read when its gate is opened and closed."""
    [plain] = slides(folder, f"{name}.npz")
    os.mkfifo(folder / f"{name}.gate")
    return plain.rename(folder / f"{name}.held")


@contextmanager
def reading(recording: Path) -> Iterator[int]:
    """Waits until a process reads a recording, and holds it there: gives its number."""
    with recording.with_suffix(".gate").open("w"):
        yield readers(recording)[-1]


def readers(recording: Path) -> list[int]:
    """Processes that have begun to read a recording, in that order."""
    lines = [line.split() for line in recording.with_name("read").read_text().splitlines()]
    return [int(process) for process, name in lines if name == recording.stem]


@pytest.mark.long
def test_nothing_is_lost_done_twice_or_called_failed_when_processes_are_killed(
    processes: Processes, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    runs, out = tmp_path / "runs", tmp_path / "out"
    one, two = held(runs, "1"), held(runs, "2")
    slides(runs, "a.npz")
    (runs / "broken.npz").write_bytes(b"PK")
    address = f"tcp://127.0.0.1:{free_port()}"
    scheduler = processes.start("dask", "scheduler", "--host", address, "--no-dashboard")
    options = ("--nthreads", 1, "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
    for _ in range(2):
        processes.start("dask", "worker", address, *options)
    batch = ["batch", "runs/*.held", "runs/*.npz", "--out", "out"]
    first = processes.start("taxelflow.cli", *batch, "--scheduler", address)

    # A worker is killed while both read: the other one reads on, and then the recording that was lost.
    with reading(two) as survivor:
        with reading(one) as killed:
            processes.kill(killed)
        assert killed != survivor
    with reading(one) as again:
        assert again == survivor
        processes.kill(first.pid)  # the client
        before = {path: path.stat().st_mtime_ns for path in out.glob("2/*")}
        assert statuses(out).items() <= {"2.held": "done", "a.npz": "done", "broken.npz": "failed"}.items()
        three = held(runs, "3")
        second = processes.start("taxelflow.cli", *batch, "--scheduler", address)
    with reading(three):
        processes.kill(scheduler.pid)
        assert second.wait() == 2
    lost = "taxelflow: the scheduler was lost; what is finished is kept: run the same command again\n"
    assert processes.said(second) == lost
    assert statuses(out).items() >= {"1.held": "done", "2.held": "done"}.items()
    assert "3.held" not in statuses(out)

    # Once more, on a worker of this machine: only what is missing.
    for gate in runs.glob("*.gate"):
        gate.unlink()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    assert main([*batch, "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "5 recordings: 4 done" in said.out
    assert "failed: " in said.err
    assert {path: path.stat().st_mtime_ns for path in out.glob("2/*")} == before
    assert (len(readers(one)), len(readers(two))) == (2, 1)
    expected = {"1.held": "done", "2.held": "done", "3.held": "done", "a.npz": "done", "broken.npz": "failed"}
    assert statuses(out) == expected

    # The same bytes as in one process.
    monkeypatch.setattr("taxelflow.pipeline.batch.run.connected", alone)
    monkeypatch.setattr("taxelflow.pipeline.batch.run.outcomes", one_by_one)
    assert main([*batch[:-1], "alone"]) == 1
    assert written(tmp_path / "alone") == written(out)
