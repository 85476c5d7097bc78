from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("numpy", "numba", "scipy", "matplotlib", "rosbags", "mcap", "pyarrow", "distributed", "viser")


def loaded_after(program: str) -> set[str]:
    """Which heavy packages a fresh interpreter has loaded after running this."""
    report = (
        f"\nimport sys; print(*[name for name in {(*HEAVY, 'scipy.signal')!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program + report], check=True, capture_output=True, text=True)
    return set(done.stderr.split())


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["estimate", "--help"],
        ["batch", "--help"],
        ["calibrate", "--help"],
        ["info", "--help"],
        ["view", "--help"],
        ["convert", "--help"],
        ["sensors", "--help"],
        ["score", "--help"],
    ],
)
def test_help_imports_no_heavy_library(arguments: list[str]) -> None:
    program = (
        f"from taxelflow.cli import main\ntry: main({arguments!r})\nexcept SystemExit as done: assert not done.code"
    )
    assert loaded_after(program) == set()


@pytest.mark.parametrize(
    "module",
    [
        "taxelflow",
        "taxelflow.cli",
        "taxelflow.errors",
        "taxelflow.runtime.registry",
        "taxelflow.acquire.ros.kinds",
        "taxelflow.acquire.columns",
        "taxelflow.simulation.scenario",
        "taxelflow.condition.parameters",
        "taxelflow.slip.parameters",
        "taxelflow.estimation.base",
        "taxelflow.estimation.centroid.convolution",
        "taxelflow.estimation.centroid.lnorm",
        "taxelflow.estimation.centroid.principal_axis",
        "taxelflow.estimation.centroid.load_sum",
    ],
)
def test_what_the_command_line_is_made_of_imports_no_heavy_library(module: str) -> None:
    assert loaded_after(f"import {module}") == set()


def test_estimating_needs_neither_scipys_signal_processing_nor_pictures() -> None:
    program = (
        "import numpy as np\nfrom taxelflow import estimate\nfrom taxelflow.acquire.base import Recording\n"
        "from taxelflow.sensors.catalogue import load_sensor\nfrom taxelflow.messages import RawScans\n"
        "raw = RawScans(np.arange(30.0), np.ones((30, 162)))\n"
        "estimate(Recording('memory', 'memory', load_sensor('barretthand-162'), lambda: iter([raw])))\n"
    )
    assert {"scipy.signal", "matplotlib"} & loaded_after(program) == set()
