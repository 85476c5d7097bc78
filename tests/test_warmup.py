from __future__ import annotations

import subprocess
import sys

import pytest

from costly import mostly_long
from taxelflow.pipeline.warmup import made_up

PROGRAM = """
from dataclasses import replace
from msgspec import structs
from numba.core import event
from taxelflow.acquire.joints import asked_joints
from rigged import rigged
from taxelflow import Conditioner, estimator
from taxelflow.runtime import compiling
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.messages import RawScans
from taxelflow.pipeline.stages import Pipeline
from taxelflow.simulation.simulate import simulate
import numpy as np

class Compiles(event.Listener):
    count = 0
    def on_start(self, _event):
        self.count += 1
    def on_end(self, _event):
        pass

heard = Compiles()

def ready():
    return sum(len(kernel.signatures) for kernel in compiling.KERNELS)

def check(scenario, method, contacts=None, joints="", unseen_error=0.0, **options):
    recording = simulate(rigged(scenario, motion={"strokes": 1}))
    recording = replace(recording, sensor=structs.replace(recording.sensor, unseen_error=unseen_error))
    if joints:
        recording = replace(recording, joints=asked_joints(joints, recording.sensor))
    raw = recording.load()
    values, t_s = raw.values.copy(), raw.t_s.copy()
    values[60, ::9], values[61, ::7] = np.nan, 1e9
    t_s[90:] += 1.0
    heard.count = 0
    run = Pipeline(estimator(method), mode="stream", **options).start(recording.with_contacts(contacts))
    before = ready()
    with event.install_listener("numba:compile", heard):
        cuts = [*range(120), *range(120, min(len(t_s), 160), 5)]  # alone, then as they have waited
        for k, end in zip(cuts, [*cuts[1:], min(len(t_s), 160)]):
            run.step(RawScans(t_s[k:end], values[k:end]))
        run.finish()
    print(method, ready() - before, heard.count)
"""
METHODS = ("convolution", "lnorm", "sum", "principal_axis", "registration", "template")
ALONE = ['check("slide-and-turn", "convolution")']
FAULTY = 'check("slide-and-turn", "template", unseen_error=0.05)'  # as on a real sensor
PLAIN = [
    *(f'check("slide-and-turn", "{method}")' for method in METHODS),
    'check("two-contacts", "convolution")',
    FAULTY,
]
FILTERED = [
    'check("two-contacts", "convolution", 2, smooth=Smoothing(1.0),'
    ' condition=Conditioner(median_scans=3, lowpass_hz=2.0, drift="follow"))'
]
IN_SPACE = ['check("slide-and-turn-over-hand", "convolution", joints="spread")']


@pytest.mark.parametrize(
    "checks",
    mostly_long([ALONE, PLAIN, FILTERED, IN_SPACE], ALONE),
    ids=["one method", "plain", "filtered", "in space"],
)
def test_no_kernel_is_compiled_or_loaded_once_a_stream_has_started(checks: list[str]) -> None:
    """Streams that share a process, and so a warm-up, need the same; each checks that its own start loaded it all."""
    if checks is IN_SPACE:
        pytest.importorskip("mujoco")
    program = "\n".join(["import sys", f"sys.path[:0] = {sys.path!r}", PROGRAM, *checks])
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert [line.split()[1:] for line in done.stdout.splitlines()] == [["0", "0"]] * len(checks), done.stderr


def test_the_made_up_recording_touches_slips_leaves_and_has_gaps_missing_and_saturated_taxels() -> None:
    raw = made_up(split=False).load()
    assert (raw.t_s[1:] - raw.t_s[:-1]).max() > 1.0
    assert (raw.values != raw.values).sum() == 1
    assert (raw.values >= made_up(split=False).sensor.full_scale).sum() == 1
    assert made_up(split=True).layout.pads[-2:] == ("other#1", "other#2")
