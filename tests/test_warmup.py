from __future__ import annotations

import subprocess
import sys

import pytest

from taxelflow.simulation.warmup import made_up

PROGRAM = """
from dataclasses import replace
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

recording = simulate(rigged("{scenario}", motion={{"strokes": 1}}))
if {joints!r}:
    recording = replace(recording, joints=asked_joints({joints!r}, recording.sensor))
raw = recording.load()
values, t_s = raw.values.copy(), raw.t_s.copy()
values[60, ::9], values[61, ::7] = np.nan, 1e9
t_s[90:] += 1.0
heard = Compiles()

def ready():
    return sum(len(kernel.signatures) for kernel in compiling.KERNELS)

for method in {methods}:
    run = Pipeline(estimator(method), mode="stream"{options}).start(recording.with_contacts({contacts}))
    before = ready()
    with event.install_listener("numba:compile", heard):
        for k in range(min(len(t_s), 160)):
            run.step(RawScans(t_s[k : k + 1], values[k : k + 1]))
        run.finish()
    print(method, ready() - before, heard.count)
"""
OPTIONS = ", condition=Conditioner(median_scans=3, lowpass_hz=2.0, drift='follow'), smooth=Smoothing(1.0)"


@pytest.mark.parametrize(
    ("scenario", "methods", "options", "contacts", "joints"),
    [
        ("slide-and-turn", ["convolution", "lnorm", "sum", "principal_axis", "registration", "template"], "", None, ""),
        ("two-contacts", ["convolution"], "", None, ""),
        ("two-contacts", ["convolution"], OPTIONS, 2, ""),
        ("slide-and-turn-over-hand", ["convolution"], "", None, "spread"),
    ],
)
def test_no_kernel_is_compiled_or_loaded_once_a_stream_has_started(
    scenario: str, methods: list[str], options: str, contacts: int | None, joints: str
) -> None:
    if joints:
        pytest.importorskip("mujoco")
    program = PROGRAM.format(scenario=scenario, methods=methods, options=options, contacts=contacts, joints=joints)
    paths = ["import sys", f"sys.path[:0] = {sys.path!r}"]
    command = [sys.executable, "-c", "\n".join([*paths, program])]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.stdout.splitlines() == [f"{method} 0 0" for method in methods], done.stderr


def test_the_made_up_recording_touches_slips_leaves_and_has_gaps_missing_and_saturated_taxels() -> None:
    raw = made_up(split=False).load()
    assert (raw.t_s[1:] - raw.t_s[:-1]).max() > 1.0
    assert (raw.values != raw.values).sum() == 1
    assert (raw.values >= made_up(split=False).sensor.full_scale).sum() == 1
    assert made_up(split=True).layout.pads[-2:] == ("other#1", "other#2")
