"""Commands that look at recordings and results start at once: they compile nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from costly import mostly_long
from taxelflow.cli import main

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """
import sys
from numba.core import event
from taxelflow.cli import main

class Listener(event.Listener):
    def on_start(self, happened):
        sys.exit("compiles " + happened.data["dispatcher"].__name__)
    def on_end(self, happened):
        pass

event.register("numba:compile", Listener())
for command in sys.argv[1:]:
    status = main(command.split())
    assert not status, (command, status)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording and its result."""
    made = tmp_path_factory.mktemp("start")
    assert main(["simulate", "stroke", "--out", str(made / "stroke.npz")]) == 0
    assert main(["estimate", str(made / "stroke.npz"), "--method", "lnorm", "--out", str(made / "result")]) == 0
    return made


@pytest.mark.parametrize(
    "commands",
    [
        ["sensors barretthand-162", "info stroke.npz", "info stroke.npz --json", "convert stroke.npz again.csv"],
        *mostly_long([["plot result --out pictures --format svg", "report result --out report.html"]]),
    ],
    ids=["recordings", "results"],
)
def test_looking_at_recordings_and_results_compiles_nothing(folder: Path, tmp_path: Path, commands: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *commands],
        cwd=folder,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "cache").rglob("*.nbi"))
