"""The session of two-scan registration: per pad a spline, the last scan, and the sum of steps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import Interpolant
from taxelflow.estimation.scan_matching.odometry import Block, Steps, Taxels, follow
from taxelflow.estimation.scan_matching.track import Last, Track
from taxelflow.messages import Estimates, Scans
from taxelflow.numerics.blas import on_one_core
from taxelflow.numerics.centroid import CELL_ERROR
from taxelflow.numerics.records import Records, records

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


class _Pad(NamedTuple):
    """What is kept of a pad from scan to scan; see `follow`."""

    own: slice
    taxels: Taxels
    spline: Interpolant
    tracks: Records
    last: Last


class RegistrationSession:
    """A causal estimator of pose that compares two scans at a time."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        self._places = np.stack([layout.x_m, layout.y_m]) / np.repeat(self._pitch_m, np.diff(layout.starts))
        self._share = CELL_ERROR if layout.unseen_error else 0.0
        self._noise: Floats | None = None
        self._pads: list[_Pad] = []
        self._compile()

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        estimates = Estimates.unknown(scans)
        if self._share:
            estimates = replace(estimates, unseen=np.zeros_like(estimates.covariance))
        if self._noise is None or not np.array_equal(scans.noise, self._noise):
            self._learn(scans.noise)
        for number, pad in enumerate(self._pads):
            if scans.contact[:, number].any() or pad.tracks["running"][0]:
                self._follow(number, pad, scans, estimates)
        estimates.lag_s[np.isfinite(estimates.pose[..., 0])] = 0.0
        return estimates

    def finish(self) -> Estimates:
        """Nothing is held back."""
        return self.step(self._blank(0))

    def _follow(self, number: int, pad: _Pad, scans: Scans, estimates: Estimates) -> None:
        block = Block(
            scans.t_s,
            np.ascontiguousarray(scans.pressure[:, pad.own]),  # one layout for any number of pads: one compile
            np.ascontiguousarray(scans.contact[:, number]),
            np.ascontiguousarray(scans.complete[:, number]),
            scans.ceiling[pad.own],
        )
        names = ("pose", "covariance", "displacement", "displacement_covariance", "span_s", "quality")
        filled = [np.ascontiguousarray(getattr(estimates, name)[:, number]) for name in names]
        unseen = np.zeros((len(scans), 3, 3))  # the kernel has one type for all sensors
        follow(block, pad.taxels, pad.spline, pad.tracks, pad.last, Steps(*(*filled, unseen)))
        for name, values in zip(names, filled, strict=True):
            getattr(estimates, name)[:, number] = values
        if estimates.unseen is not None:
            estimates.unseen[:, number] = unseen

    def _learn(self, noise: Floats) -> None:
        """Splines that suit the noise; what is known of a contact stays."""
        layout = self._layout
        known = self._pads
        self._pads, self._noise = [], noise
        for number, name in enumerate(layout.pads):
            own = layout.of_pad(number)
            places, pitch_m = np.ascontiguousarray(self._places[:, own]), self._pitch_m[number]
            taxels = Taxels(places, noise[own], np.array([pitch_m, pitch_m, 1.0]), self._share)
            with on_one_core():
                spline = Interpolant.of(name, places, noise[own] ** 2)
            if known:
                self._pads.append(known[number]._replace(taxels=taxels, spline=spline))
                continue
            (reading, variance), gains = np.zeros((2, own.stop - own.start)), np.zeros((3, own.stop - own.start))
            last = Last(reading, variance, gains, np.zeros(spline.shape))
            self._pads.append(_Pad(own, taxels, spline, records(Track, 1), last))

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
