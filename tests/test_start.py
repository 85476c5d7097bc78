"""Commands that look at recordings and results start at once: they compile nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

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


def test_looking_at_recordings_and_results_compiles_nothing(tmp_path: Path) -> None:
    assert main(["simulate", "stroke", "--out", str(tmp_path / "stroke.npz")]) == 0
    assert main(["estimate", str(tmp_path / "stroke.npz"), "--method", "lnorm", "--out", str(tmp_path / "result")]) == 0
    commands = [
        "sensors barretthand-162",
        "info stroke.npz",
        "info stroke.npz --json",
        "convert stroke.npz again.csv",
        "plot result --out pictures --format svg",
        "report result --out report.html",
    ]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *commands],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "cache").rglob("*.nbi"))
