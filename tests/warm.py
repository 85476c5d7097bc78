"""Compile kernels and bytecode once before the test workers start: each of them would compile all of them otherwise."""

from __future__ import annotations

import compileall
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from unittest import mock

import numpy as np

import taxelflow

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode

MODES: tuple[Mode, Mode] = ("stream", "batch")


def warm_up() -> None:
    """Compile in one process per part, side by side; they write the cache that the workers read.

    Bytecode comes first: commands that tests start read it, also where PYTHONDONTWRITEBYTECODE is set.
    """
    compileall.compile_dir(Path(taxelflow.__file__).parent, quiet=2)
    command = [sys.executable, "-B", str(Path(__file__))]
    running = [subprocess.Popen([*command, part], stderr=subprocess.DEVNULL) for part in PARTS]
    for process in running:
        process.wait()


@contextmanager
def loading_as_needed() -> Iterator[None]:
    """No stream leads a made-up recording through its stages first, which changes no result."""
    from taxelflow.pipeline.stages import Pipeline

    with mock.patch.object(Pipeline, "warm_up", lambda _pipeline, **_needs: None):
        yield


def short_recording() -> Recording:
    from rigged import rigged
    from taxelflow.simulation.simulate import simulate

    return simulate(rigged("slide-and-turn", motion={"strokes": 1, "rest_s": 0.5}))


def stages() -> None:
    """All stages of the pipeline, with the methods that are compiled soon."""
    from taxelflow import Conditioner, estimate, estimator
    from taxelflow.estimation.completion import start_slips
    from taxelflow.estimation.smoothing.parameters import Smoothing

    recording = short_recording()
    everything = Conditioner(median_scans=3, lowpass_hz=10.0, drift="follow", mask="auto")
    with loading_as_needed():  # the recording does the same
        for mode in MODES:
            estimate(recording, mode=mode)
            estimate(recording, mode=mode, condition=everything, smooth=Smoothing(1.0), contacts=2)
    for method in ("lnorm", "sum", "principal_axis"):
        start_slips(estimator(method), recording.layout, "stream")


def estimators() -> None:
    """The methods that take long, without the stages around them: their sessions compile as they start."""
    from taxelflow import estimator
    from taxelflow.estimation.completion import start_slips
    from taxelflow.pipeline.warmup import made_up

    layout = made_up(split=False).layout
    for mode in MODES:
        for method in ("registration", "template"):
            start_slips(estimator(method), layout, mode)


def space() -> None:
    """The fusion of pads that have a place in space."""
    from taxelflow.evaluation.slip_scoring import still_slips
    from taxelflow.fusion.spatial.parameters import SpatialField
    from taxelflow.sensors.pads import Pad
    from taxelflow.sensors.sensor import Sensor

    pad = Pad(name="pad", rows=2, cols=2, pitch_m=(0.005, 0.005), pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    session = SpatialField().start(Sensor(name="hand", unit="Pa", pads=(pad,)), None)
    assert session is not None
    slips = still_slips(np.arange(3.0), np.zeros((3, 3)), np.full(3, 1e-5), np.full(3, np.nan))
    session.step(slips, slips.pose[..., :2])


PARTS = {"stages": stages, "estimators": estimators, "space": space}


if __name__ == "__main__":
    part = PARTS[sys.argv[1]] if len(sys.argv) > 1 else warm_up
    part()
