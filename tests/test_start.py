"""Commands that look at recordings and results start at once: they compile nothing."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from costly import mostly_long
from taxelflow.cli import main

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


INTERRUPTED = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "tyro":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
from taxelflow.__main__ import main
sys.argv[1:] = ["sensors"]
sys.exit(main())
"""


def test_an_interrupt_during_the_imports_is_quiet() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_an_interrupt_that_the_caller_ignores_stays_ignored() -> None:
    program = f"import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n{INTERRUPTED}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_console_command_is_the_entry_that_is_quiet() -> None:
    declared = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
    assert declared["project"]["scripts"] == {"taxelflow": "taxelflow.__main__:main"}


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
