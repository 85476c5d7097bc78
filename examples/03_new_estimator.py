"""A new estimator: the plain pressure centroid, without the paper's half-scan lag.

An estimator is a frozen dataclass of its parameters with `start`, which gives a session with `step` and `finish`.
Pass it to `taxelflow.estimate`, or announce it to the command line as an entry point of your package:

    [project.entry-points."taxelflow.estimator"]
    centroid = "your_package:Centroid"
"""

from dataclasses import dataclass

import numpy as np

import taxelflow
from taxelflow import Estimates, Layout, Scans
from taxelflow.messages import no_scans
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate


@dataclass(frozen=True)
class Centroid:
    """Position = pressure-weighted mean of the taxels' places."""

    def start(self, layout: Layout, mode: str) -> "CentroidSession":
        return CentroidSession(layout)


class CentroidSession:
    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.last = (np.nan, np.full((len(layout.pads), 2), np.nan))

    def step(self, scans: Scans) -> Estimates:
        """Motion and its covariance; contact, border, load and quality are filled in by the pipeline."""
        estimates = Estimates.unknown(scans)
        estimates.lag_s[:] = 0.0
        places = np.stack([self.layout.x_m, self.layout.y_m], axis=1)
        for k, t_s in enumerate(scans.t_s):
            now = np.full((len(self.layout.pads), 2), np.nan)
            for pad in np.flatnonzero(scans.contact[k] & scans.complete[k]).tolist():
                own = self.layout.of_pad(pad)
                p, var = scans.pressure[k, own], scans.noise[own] ** 2
                now[pad] = p @ places[own] / p.sum()
                arm = (places[own] - now[pad]) / p.sum()  # d(centroid) / d(pressure)
                estimates.covariance[k, pad, :2, :2] = arm.T @ (var[:, None] * arm)
            estimates.pose[k, :, :2] = now
            estimates.displacement[k, :, :2] = now - self.last[1]
            estimates.displacement_covariance[k] = 2 * estimates.covariance[k]
            estimates.span_s[k] = t_s - self.last[0]
            self.last = (t_s, now)
        return estimates

    def finish(self) -> Estimates:
        """Nothing is held back."""
        return Estimates.unknown(no_scans(self.layout.entries, len(self.layout.pads)))


result = taxelflow.estimate(simulate(SCENARIOS["slide-and-turn"]), Centroid())
pad = result.pads.index("finger2_proximal")
y_mm = 1e3 * result.slips.pose[:, pad, 1]
print(f"{result.summary.method}: the object went from y = {y_mm[0]:.2f} mm to {y_mm.max():.2f} mm and back")
