from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("numpy", "numba", "scipy", "matplotlib", "rosbags", "mcap", "pyarrow", "distributed", "viser")
HELP = ("", "estimate", "batch", "calibrate", "info", "view", "convert", "sensors", "score")
MODULES = (
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
)
REPORT = f"""
import sys
def report(after):
    print(after, *[name for name in {(*HEAVY, "scipy.signal")!r} if name in sys.modules], file=sys.stderr)
"""


def loaded_after(program: str) -> dict[str, set[str]]:
    """Which heavy packages a fresh interpreter has loaded at each `report` of this program, by what it names."""
    done = subprocess.run([sys.executable, "-c", REPORT + program], check=True, capture_output=True, text=True)
    return {name: set(loaded) for name, *loaded in map(str.split, done.stderr.splitlines())}


def test_help_imports_no_heavy_library() -> None:
    program = f"""
from taxelflow.cli import main
for command in {HELP!r}:
    try:
        main([*filter(None, [command]), "--help"])
    except SystemExit as done:
        assert not done.code
    report(command or "alone")
"""
    assert loaded_after(program) == {command or "alone": set() for command in HELP}


def test_what_the_command_line_is_made_of_imports_no_heavy_library() -> None:
    program = f"""
import importlib
for module in {MODULES!r}:
    importlib.import_module(module)
    report(module)
"""
    assert loaded_after(program) == {module: set() for module in MODULES}


@pytest.mark.long
def test_estimating_needs_neither_scipys_signal_processing_nor_pictures() -> None:
    program = (
        "import numpy as np\nfrom taxelflow import estimate\nfrom taxelflow.acquire.base import Recording\n"
        "from taxelflow.sensors.catalogue import load_sensor\nfrom taxelflow.messages import RawScans\n"
        "raw = RawScans(np.arange(30.0), np.ones((30, 162)))\n"
        "estimate(Recording('memory', 'memory', load_sensor('barretthand-162'), lambda: iter([raw])))\n"
    )
    assert {"scipy.signal", "matplotlib"} & loaded_after(f"{program}report('all')")["all"] == set()
