"""The session of two-scan registration: a spline per pad, the last scan, and the sum of steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import Interpolant
from taxelflow.estimation.scan_matching.odometry import MEMORY, follow
from taxelflow.messages import Estimates, Scans
from taxelflow.sensors.border import Boundary

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout


@dataclass(slots=True, eq=False)
class _Pad:
    """What is kept of a pad from scan to scan; see `follow`."""

    spline: Interpolant
    memory: Floats
    before: Floats
    variance: Floats
    coefficients: Floats
    gains: Floats

    @classmethod
    def of(cls, name: str, places: Floats, variance: Floats) -> _Pad:
        taxels = len(variance)
        spline = Interpolant.of(name, places, variance)
        memory, last = np.zeros(MEMORY), np.zeros((2, taxels))
        return cls(spline, memory, last[0], last[1], np.zeros(spline.shape), np.zeros((3, taxels)))


class PairSession:
    """A causal estimator of pose that looks at two scans at a time."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        self._places = np.stack([layout.x_m, layout.y_m]) / np.repeat(self._pitch_m, np.diff(layout.starts))
        self._noise: Floats | None = None
        self._pads: list[_Pad] = []
        self._boundary = Boundary(layout)
        self._compile()

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        layout = self._layout
        estimates = Estimates.unknown(scans)
        border, _ = self._boundary.step(scans)
        cut_off: Bools = np.asarray(border.any(axis=2))
        if self._noise is None or not np.array_equal(scans.noise, self._noise):
            self._learn(scans.noise)
        for number, pad in enumerate(self._pads):
            own = layout.of_pad(number)
            if scans.contact[:, number].any() or pad.memory[0]:
                self._follow(number, pad, scans, cut_off[:, number], estimates, own)
        estimates.lag_s[np.isfinite(estimates.pose[..., 0])] = 0.0
        return estimates

    def finish(self) -> Estimates:
        """Nothing is held back."""
        return self.step(self._blank(0))

    def _follow(self, number: int, pad: _Pad, scans: Scans, cut_off: Bools, estimates: Estimates, own: slice) -> None:
        spline = pad.spline
        follow(
            scans.t_s,
            scans.pressure[:, own],
            scans.noise[own],
            scans.ceiling[own],
            scans.contact[:, number],
            scans.complete[:, number],
            cut_off,
            self._pitch_m[number],
            self._places[:, own],
            spline.lattice,
            spline.first,
            spline.weight,
            spline.factor,
            spline.trust,
            spline.doubt,
            spline.blind,
            spline.across,
            pad.memory,
            pad.before,
            pad.variance,
            pad.coefficients,
            pad.gains,
            estimates.pose[:, number],
            estimates.covariance[:, number],
            estimates.displacement[:, number],
            estimates.displacement_covariance[:, number],
            estimates.span_s[:, number],
            estimates.quality[:, number],
        )

    def _learn(self, noise: Floats) -> None:
        """Splines that suit the noise; what is known of a contact stays."""
        layout = self._layout
        fresh = []
        for number, name in enumerate(layout.pads):
            own = layout.of_pad(number)
            fresh.append(_Pad.of(name, self._places[:, own], noise[own] ** 2))
        for new, old in zip(fresh, self._pads, strict=False):
            new.memory, new.before, new.variance = old.memory, old.before, old.variance
            new.coefficients, new.gains = old.coefficients, old.gains
        self._pads, self._noise = fresh, noise

    def _blank(self, scans: int) -> Scans:
        """Scans without contact."""
        layout = self._layout
        none = np.zeros((scans, len(layout.pads)), dtype=np.bool_)
        noise = np.ones(layout.entries) if self._noise is None else self._noise
        never = np.full(layout.entries, np.inf)
        return Scans(np.arange(float(scans)), np.zeros((scans, layout.entries)), noise, never, none, none.copy())

    def _compile(self) -> None:
        """Run the kernels once, so that none is compiled within the stream."""
        blank = self._blank(2)
        blank.pressure[:] = 1.0
        for flags in (blank.contact, blank.complete):
            flags[:] = True
        self.step(blank)
        self._pads, self._noise = [], None
