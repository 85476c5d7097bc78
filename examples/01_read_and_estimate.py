"""Read a recording, estimate the object's motion, look at the numbers.

Run it on your own file: python examples/01_read_and_estimate.py FILE [SENSOR]
Without one it simulates the paper's experiment.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import taxelflow
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import save

if len(sys.argv) > 1:
    recording = taxelflow.read(*sys.argv[1:3])
else:
    path = Path(tempfile.mkdtemp()) / "stroke.npz"
    save(SCENARIOS["stroke"], path)
    recording = taxelflow.read(path)

result = taxelflow.estimate(recording, method="convolution")

for number, pad in enumerate(result.pads):
    touched = result.slips.contact[:, number]
    if not touched.any():
        continue
    known = result.slips.valid[:, number]
    speed_mm_s = 1e3 * np.hypot(*result.slips.velocity[known, number, :2].T)
    std_mm = 1e3 * np.sqrt(result.slips.covariance[known, number, 0, 0])
    print(f"{pad}: {touched.sum()} scans in contact, median speed {np.median(speed_mm_s):.1f} mm/s,")
    print(f"  standard deviation of x {np.median(std_mm):.3f} mm (noise alone; edges bias the paper's methods)")

for event in result.events:
    print(f"{event.t_s:10.3f} s  {event.pad:12s} {event.event}")
