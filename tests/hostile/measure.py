"""Memory, time and message of one file, read in a process of its own."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hostile.files import SENSOR, SENSORS, make, path_of

if TYPE_CHECKING:
    from pathlib import Path

MOST_MB, MOST_S = 1024, 30
"""What a file of at most 20 MB may cost."""
KILLED_S = 45
"""Processor time after which a process is ended by the system."""
_MESSAGE = 600


@dataclass(frozen=True)
class Cost:
    """Of one file: bytes, peak memory, processor time, exit code (None if it was killed), what it said on stderr."""

    name: str
    size: int
    peak_mb: float
    cpu_s: float
    exit: int | None
    message: str

    @property
    def within(self) -> bool:
        """Whether the file was read or refused within the limits, in lines without control characters."""
        lines = self.message.splitlines()
        said = all(line.isprintable() for line in lines) and not any("Traceback" in line for line in lines)
        return self.exit in (0, 1, 2) and self.peak_mb <= MOST_MB and self.cpu_s <= MOST_S and said


def measured(name: str, folder: Path) -> Cost:
    """Write the file of that name, and read it by `taxelflow info` (a sensor file by `taxelflow sensors`)."""
    if not (child := os.fork()):  # what it takes to make the file is not the reader's
        make(name, folder)
        os._exit(0)
    os.waitpid(child, 0)
    path = path_of(name, folder)
    size = path.stat().st_size if path.is_file() else sum(file.stat().st_size for file in path.iterdir())
    words = ["sensors", str(path)] if path.suffix == ".toml" else ["info", str(path)]
    if path.suffix not in (".toml", ".dsa") and "sensor" not in made_with(name):
        words += ["--sensor", SENSORS.get(name, SENSOR)]
    try:
        return Cost(name, size, *forked(words))
    finally:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def made_with(name: str) -> str:
    """What the file holds besides scans: `sensor` where it brings its own."""
    own = ("taxels", "contacts", "groups", "wide", "json")
    return "sensor" if any(part in name for part in own) else ""


def forked(words: list[str]) -> tuple[float, float, int | None, str]:
    """Run a command in a forked process: peak MB, processor s, exit code, stderr and the end of stdout."""
    from taxelflow import cli  # imported before, so that all are measured alike

    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.close(read)
        _run(cli.main, words, write)
    os.close(write)
    with os.fdopen(read, errors="replace") as said:
        message = said.read()
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    scale = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return (
        used.ru_maxrss / scale,
        used.ru_utime + used.ru_stime,
        code if code >= 0 else None,
        message.strip()[:_MESSAGE],
    )


def _run(main: object, words: list[str], write: int) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (KILLED_S, KILLED_S))
    resource.setrlimit(resource.RLIMIT_AS, (12 << 30, 12 << 30))
    said, out = io.StringIO(), io.StringIO()
    code = 70
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
            code = main(words)  # type: ignore[operator]
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException as error:
        said.write(f"Traceback: {type(error).__name__}: {error}")
    with os.fdopen(write, "w", errors="replace") as to_parent:
        to_parent.write(said.getvalue() + "".join(c for c in out.getvalue() if c == "\x1b"))
    os._exit(code)
