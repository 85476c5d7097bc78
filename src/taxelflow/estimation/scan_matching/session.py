"""The session of two-scan registration: a spline per pad, the last scan, and the sum of steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import Interpolant
from taxelflow.estimation.scan_matching.odometry import MEMORY, follow
from taxelflow.messages import Scans, Slips
from taxelflow.sensors.border import border_of, mark_border

if TYPE_CHECKING:
    from taxelflow.messages import Floats
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
        self._edge = border_of(layout)
        self._compile()

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; see `EstimatorSession.step`."""
        layout = self._layout
        slips = Slips.unknown(scans, layout.starts)
        mark_border(scans.pressure, scans.noise, scans.contact, *self._edge, slips.border)
        if self._noise is None or not np.array_equal(scans.noise, self._noise):
            self._learn(scans.noise)
        for number, pad in enumerate(self._pads):
            own = layout.of_pad(number)
            if scans.contact[:, number].any() or pad.memory[0]:
                self._follow(number, pad, scans, slips, own)
        slips.lag_s[np.isfinite(slips.pose[..., 0])] = 0.0
        return slips

    def finish(self) -> Slips:
        """Nothing is held back."""
        return self.step(self._blank(0))

    def _follow(self, number: int, pad: _Pad, scans: Scans, slips: Slips, own: slice) -> None:
        spline = pad.spline
        follow(
            scans.t_s,
            scans.pressure[:, own],
            scans.noise[own],
            scans.ceiling[own],
            scans.contact[:, number],
            scans.complete[:, number],
            slips.border[:, number, 0] | slips.border[:, number, 1],
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
            slips.pose[:, number],
            slips.covariance[:, number],
            slips.displacement[:, number],
            slips.displacement_covariance[:, number],
            slips.span_s[:, number],
            slips.quality[:, number],
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
