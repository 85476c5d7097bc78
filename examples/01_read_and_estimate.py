"""Read a recording, estimate the object's motion, look at the numbers.

Run it on your own file: python examples/01_read_and_estimate.py FILE [SENSOR]
Without one it simulates the paper's experiment.
"""

import sys

import numpy as np

import taxelflow

recording = taxelflow.read(*sys.argv[1:3]) if len(sys.argv) > 1 else taxelflow.simulate("stroke")
result = taxelflow.estimate(recording, method="convolution")
print(recording, result, sep="\n")

for name in result:
    pad = result[name]
    if not pad.contact.any():
        continue
    speed_mm_s = 1e3 * np.hypot(pad.velocity[:, 0], pad.velocity[:, 1])
    std_mm = 1e3 * np.sqrt(pad.covariance[:, 0, 0])
    print(f"{name}: {pad.contact.sum()} scans in contact, median speed {np.nanmedian(speed_mm_s):.1f} mm/s,")
    print(f"  standard deviation of x {np.nanmedian(std_mm):.3f} mm (noise alone; edges bias the paper's methods)")

for event in result.events:
    path = f" {1e3 * event.path_m:.1f} mm in {event.duration_s:.2f} s" if np.isfinite(event.path_m) else ""
    print(f"{event.t_s:10.3f} s  {event.pad:12s} {event.event}{path}")
