"""Compile the kernels once before the test workers start: each of them would compile all of them otherwise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PARTS = ("template", "others")


def warm_up() -> None:
    """Compile in one process per part; they write the cache that the workers read."""
    command = [sys.executable, "-B", str(Path(__file__))]
    running = [subprocess.Popen([*command, part], stderr=subprocess.DEVNULL) for part in PARTS]
    for process in running:
        process.wait()


def main(part: str) -> None:
    """Run every method of a part over a short recording with all stages."""
    from rigged import rigged
    from taxelflow import Conditioner, estimate
    from taxelflow.estimation.smoothing.parameters import Smoothing
    from taxelflow.simulation.simulate import simulate

    recording = simulate(rigged("slide-and-turn", motion={"strokes": 1, "rest_s": 0.5}))
    if part == "template":
        for mode in ("stream", "batch"):
            estimate(recording, "template", mode=mode)  # type: ignore[arg-type]
        return
    for method in ("convolution", "lnorm", "sum", "principal_axis", "registration"):
        for mode in ("stream", "batch"):
            estimate(recording, method, mode=mode)  # type: ignore[arg-type]
    everything = Conditioner(median_scans=3, lowpass_hz=10.0, drift="follow", mask="auto")
    for mode in ("stream", "batch"):
        estimate(recording, mode=mode, condition=everything, smooth=Smoothing(1.0), contacts=2)  # type: ignore[arg-type]


if __name__ == "__main__":
    main(sys.argv[1])
