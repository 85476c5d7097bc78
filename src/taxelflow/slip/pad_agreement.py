"""Slips on which two facing pads agree: a test whose noise is measured by the pads' difference, at rest and in a slip.

Facing pads touch one rigid object, so their motions along the pads are equal, and their difference is noise. With
displacements d1, d2 of a window in one frame, s = (d1 + d2) / 2 and e = (d1 - d2) / 2 have the same covariance q^2 S if
the errors of the pads are independent and alike. So while the object rests

    F = (s' S^-1 s / 2) / mean(e' S^-1 e / 2)  ~  F(2, 2 m),   P(F > f) = (1 + f / m)^-m

for a mean over m scans, whatever q is. S is that of the reported covariances, plus what load and creep may do.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import LOST

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.sensors.layout import Layout


@dataclass(frozen=True, slots=True)
class _Test:
    """Of facing pads, and of their agreement."""

    memory_scans: int = 50
    least_scans: int = 10
    """Scans over which the noise is measured, and how many a pair needs before it is judged."""
    most: float = 25.0
    """Most that one scan counts in the noise: a wrong registration is no noise."""
    stays: float = 1e-2
    """p-value below which an agreed slip goes on."""
    opposite: float = -0.95
    """Cosine between the normals of facing pads, or less."""
    least_variance_m2: float = 1e-12
    """Of a displacement: a method may report 0."""
    windows: tuple[int, int] = (2, 8)
    """Windows in scans: the short one finds a fast slip early, the long one a slow slip."""


_TEST = _Test()


class _Step(NamedTuple):
    """One scan of two pads: mean and half the difference of their displacements, m, and the mean log load; the mean
    variance of their poses, m^2.
    """

    both_x: float
    both_y: float
    apart_x: float
    apart_y: float
    log_load: float
    pose_variance: float


class _Covariance(NamedTuple):
    """Of a plane vector."""

    xx: float
    xy: float
    yy: float

    def half_square(self, x: float, y: float, factor: float = 1.0, more: float = 0.0) -> float:
        """Half of chi-square of a vector whose covariance is `factor` times this, plus `more` along each axis."""
        xx, xy, yy = factor * self.xx + more, factor * self.xy, factor * self.yy + more
        return 0.5 * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


@dataclass(eq=False)
class _Pair:
    """Two facing pads. to_first: (2, 2), from the second pad's frame to the first one's. noise: q^2, over `scans`.
    walk: share of a step's variance that stays in the pose, likewise.
    """

    pads: tuple[int, int]
    to_first: Floats
    steps: deque[_Step] = field(default_factory=lambda: deque(maxlen=max(_TEST.windows) + 1))
    noise: float = 1.0
    walk: float = 0.0
    scans: int = 0
    agreed: bool = False

    def forget(self) -> None:
        """A contact has ended."""
        self.steps.clear()
        self.scans, self.walk, self.agreed = 0, 0.0, False

    def learn(self, half_square: float, growth: float) -> None:
        """One more difference, and the growth of the pose's variance over that of a step."""
        self.scans = min(self.scans + 1, _TEST.memory_scans)
        self.noise += (min(half_square, _TEST.most) - self.noise) / self.scans
        if not self.agreed:
            self.walk += (min(max(growth, -1.0), 1.0) - self.walk) / self.scans


class PadAgreement:
    """Whether facing pads agree that their object slips, scan by scan."""

    def __init__(self, layout: Layout, alarms_per_hour: float, creep_m_s: float, load_m: float) -> None:
        """The options are those of `SlipMonitor`."""
        self._count = len(layout.pads)
        self._alarms_per_hour, self._creep_m_s, self._load_m = alarms_per_hour, creep_m_s, load_m
        self._pairs = [_Pair(pads, to_first) for pads, to_first in facing_pads(layout)]

    def step(self, slips: Slips) -> Bools:
        """(scans, pads), whether a pad agrees with one that faces it."""
        agreed = np.zeros((len(slips), self._count), dtype=np.bool_)
        for pair in self._pairs:
            pads = list(pair.pads)
            known = slips.contact[:, pads] & (slips.quality[:, pads] != LOST) & (slips.span_s[:, pads] > 0)
            known &= np.isfinite(slips.displacement[:, pads, :2]).all(axis=-1)
            known &= np.isfinite(slips.displacement_covariance[:, pads, :2, :2]).all(axis=(-1, -2))
            for scan, usable in enumerate(known.all(axis=1).tolist()):
                if usable:
                    agreed[scan, pads] |= self._judge(pair, slips, scan)
                else:
                    pair.forget()
        return agreed

    def _judge(self, pair: _Pair, slips: Slips, scan: int) -> bool:
        first, second = pair.pads
        turn, (x, y) = pair.to_first, slips.displacement[scan, first, :2].tolist()
        (u, v) = (turn @ slips.displacement[scan, second, :2]).tolist()
        matrix = slips.displacement_covariance[scan, first, :2, :2]
        matrix = (matrix + turn @ slips.displacement_covariance[scan, second, :2, :2] @ turn.T) / 4.0
        (xx, xy), (_, yy) = matrix.tolist()
        noise = _Covariance(xx + _TEST.least_variance_m2, xy, yy + _TEST.least_variance_m2)
        load = float(np.log(np.maximum(slips.load[scan, [first, second]], 1e-9)).mean())
        variance = float(slips.covariance[scan, [first, second], :2, :2].trace(axis1=1, axis2=2).mean()) / 4.0
        grown = variance - pair.steps[-1].pose_variance if pair.steps else 0.0
        pair.steps.append(_Step((x + u) / 2, (y + v) / 2, (x - u) / 2, (y - v) / 2, load, variance))
        pair.learn(noise.half_square((x - u) / 2, (y - v) / 2), grown / (noise.xx + noise.yy))
        if pair.scans < _TEST.least_scans:
            return False
        dt_s = float(slips.span_s[scan, [first, second]].mean())
        p_value = min(self._p_value(pair, noise, dt_s, window) for window in _TEST.windows)
        accepted = dt_s * self._alarms_per_hour / 3600.0 / len(_TEST.windows)
        pair.agreed = p_value < (_TEST.stays if pair.agreed else accepted)
        return pair.agreed

    def _p_value(self, pair: _Pair, noise: _Covariance, dt_s: float, window: int) -> float:
        """Of the sum of the last steps if the object rests."""
        if len(pair.steps) <= window:
            return 1.0
        before, *steps = list(pair.steps)[-window - 1 :]
        both_x, both_y, apart_x, apart_y, *_ = map(sum, zip(*steps, strict=True))
        # A sum of steps has the noise of its ends only, that of one step, and what of each stays in the pose. Both
        # skins feel load and creep alike.
        shared = (self._load_m * (steps[-1].log_load - before.log_load)) ** 2
        shared += (self._creep_m_s * dt_s * window) ** 2
        stays = 1.0 + (window - 1) * max(pair.walk, 0.0)
        now = noise.half_square(apart_x, apart_y, stays)
        scale = max(pair.noise, (now + pair.scans * pair.noise) / (pair.scans + 1), 1.0)
        f = noise.half_square(both_x, both_y, scale * stays, shared)
        return float((1.0 + f / pair.scans) ** -pair.scans)


def facing_pads(layout: Layout) -> list[tuple[tuple[int, int], Floats]]:
    """Pairs of pads that face each other in space, with what turns tangents (2,) of the second into the first's frame.

    Pads without a `pose`, and pads on links that move, are in no pair.
    """
    axes: dict[int, Floats] = {}
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        place = layout.place_m[own]
        if len(place) and np.isfinite(place).all() and np.isfinite(layout.normal[own]).all():
            flat = np.column_stack([np.ones(len(place)), layout.x_m[own], layout.y_m[own]])
            fitted = np.linalg.lstsq(flat, place, rcond=None)[0][1:]
            axes[pad] = np.vstack([fitted, layout.normal[own].mean(axis=0)])
    found = []
    for first, second in combinations(axes, 2):
        if axes[first][2] @ axes[second][2] < _TEST.opposite:
            found.append(((first, second), axes[first][:2] @ axes[second][:2].T))
    return found
