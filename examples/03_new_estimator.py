"""A new estimator: the plain pressure centroid, without the paper's half-scan lag.

An estimator is a frozen dataclass of its parameters with `start`, which gives a session with `step` and `finish`.
Pass it to `taxelflow.estimate`, or announce it to the command line as an entry point of your package:

    [project.entry-points."taxelflow.estimator"]
    centroid = "your_package:Centroid"
"""

from dataclasses import dataclass

import numpy as np

import taxelflow
from taxelflow import Layout, Scans, Slips
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

    def step(self, scans: Scans) -> Slips:
        slips = Slips.unknown(scans)
        slips.lag_s[:] = 0.0
        places = np.stack([self.layout.x_m, self.layout.y_m], axis=1)
        for k, t_s in enumerate(scans.t_s):
            now = np.full((len(self.layout.pads), 2), np.nan)
            for pad in np.flatnonzero(scans.contact[k] & scans.complete[k]).tolist():
                own = self.layout.of_pad(pad)
                p, var = scans.pressure[k, own], scans.noise[own] ** 2
                now[pad] = p @ places[own] / p.sum()
                arm = (places[own] - now[pad]) / p.sum()  # d(centroid) / d(pressure)
                slips.covariance[k, pad, :2, :2] = arm.T @ (var[:, None] * arm)
            slips.pose[k, :, :2] = now
            slips.displacement[k, :, :2] = now - self.last[1]
            slips.displacement_covariance[k] = 2 * slips.covariance[k]
            slips.span_s[k] = t_s - self.last[0]
            self.last = (t_s, now)
        return slips

    def finish(self) -> Slips:
        nothing = np.zeros((0, len(self.layout.pads)), dtype=bool)
        bare = np.zeros((0, self.layout.entries))
        return Slips.unknown(Scans(np.zeros(0), bare, bare.sum(axis=0), bare.sum(axis=0), nothing, nothing))


result = taxelflow.estimate(simulate(SCENARIOS["slide-and-turn"]), Centroid())
pad = result.pads.index("finger2_proximal")
y_mm = 1e3 * result.slips.pose[:, pad, 1]
print(f"{result.summary.method}: the object went from y = {y_mm[0]:.2f} mm to {y_mm.max():.2f} mm and back")
