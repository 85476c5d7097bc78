"""The session of two-scan registration: per pad a spline, the last scan, and the sum of steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import Interpolant
from taxelflow.estimation.scan_matching.odometry import Block, Steps, follow
from taxelflow.estimation.scan_matching.track import Last, Taxels, Track
from taxelflow.messages import Estimates, Scans
from taxelflow.numerics.blas import on_one_core
from taxelflow.numerics.records import records
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


class _Pad(NamedTuple):
    """What is kept of a pad from scan to scan; see `follow`."""

    taxels: Taxels
    spline: Interpolant
    last: Last


class RegistrationSession:
    """A causal estimator of pose that compares two scans at a time."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        self._places = np.stack([layout.x_m, layout.y_m]) / np.repeat(self._pitch_m, np.diff(layout.starts))
        self._noise: Floats | None = None
        self._pads: list[_Pad] = []
        self._tracks = records(Track, len(layout.pads))
        self._follow = Settled(follow)
        self._compile()

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        unseen = np.zeros((*scans.contact.shape, 3, 3))  # the kernel has one type for all sensors
        estimates = Estimates.unknown(scans, unseen if self._layout.unseen_error else None)
        noise = scans.noise
        if noise is not self._noise and (self._noise is None or not np.array_equal(noise, self._noise)):
            self._learn(noise)
        contact, complete = np.ascontiguousarray(scans.contact), np.ascontiguousarray(scans.complete)
        block = Block(scans.t_s, np.ascontiguousarray(scans.pressure), contact, complete, scans.ceiling)
        steps = Steps(
            estimates.pose,
            estimates.covariance,
            estimates.displacement,
            estimates.displacement_covariance,
            estimates.span_s,
            estimates.quality,
            unseen,
        )
        for number in np.flatnonzero(scans.contact.any(axis=0) | self._tracks["running"]).tolist():
            pad = self._pads[number]
            self._follow(block, pad.taxels, pad.spline, self._tracks, pad.last, steps)
        estimates.lag_s[np.isfinite(estimates.pose[..., 0])] = 0.0
        return estimates

    def finish(self) -> Estimates:
        """Nothing is held back."""
        return self.step(self._blank(0))

    def _learn(self, noise: Floats) -> None:
        """Splines that suit the noise; what is known of a contact stays."""
        layout = self._layout
        known = self._pads
        self._pads, self._noise = [], noise
        for number, name in enumerate(layout.pads):
            own = layout.of_pad(number)
            places, pitch_m = np.ascontiguousarray(self._places[:, own]), self._pitch_m[number]
            units = np.array([pitch_m, pitch_m, 1.0])
            taxels = Taxels(number, own.start, places, noise[own], units, layout.unseen_error)
            with on_one_core():
                spline = Interpolant.of(name, places, noise[own] ** 2)
            if known:
                self._pads.append(known[number]._replace(taxels=taxels, spline=spline))
                continue
            (reading, variance), gains = np.zeros((2, own.stop - own.start)), np.zeros((3, own.stop - own.start))
            last = Last(reading, variance, gains, np.zeros(spline.shape))
            self._pads.append(_Pad(taxels, spline, last))

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
        self._tracks = records(Track, len(self._tracks))
