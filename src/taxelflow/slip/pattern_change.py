"""Change of a contact's pressure pattern against what a change of load and tilt explains, from the scans themselves.

When a hand moves, the load is redistributed over the pad while the object stays: the pattern q at rest becomes

    y = g q (1 + a . v) + noise,    v = (r - centroid) / radius,

with load g and tilt a. Poses move along, for a tilt of a smooth pattern is a shift. A slip changes the pattern in ways
that load and tilt do not. Scans are averaged over bins of 0.1 s; y is the mean of the bins after one, q that of the two
before it. The unexplained change is the norm of what the least squares fit of g and a leaves of y, over that of y.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.slip.evidence import log_likelihood_ratio

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Layout

BIN_S = 0.1
"""Duration of a bin. The slowest of the soft skins scan ten times a second."""
BEFORE_BINS = 2
"""Bins whose mean is the pattern at rest. Two or three detect equally well."""
_LONGEST_BIN_S = 0.25
"""A longer time between two scans is a gap. Sensors that scan that slowly give no evidence."""
_STEADY_RISE = 0.1
"""Change of the log load above which a grip closes or opens: the contact is not at rest."""
_STIRRED_SIGMAS = 2.0
"""Standard deviations of the squared norm of noise by which a pattern at rest must have changed to count as stirred."""
_RIDGE = 1e-9
"""Relative to the squared norm of the pattern: tilts of a line of taxels have one dimension only."""


@dataclass(frozen=True, slots=True, eq=False)
class PatternChanges:
    """Evidence per scan and pad.

    t_s: (scans,). centre_s: (scans,), first time of the bin that is judged; NaN in a scan that completes no window.
    log_ratio: (scans, pads), log likelihood ratio of "moved" against "load and tilt only" of that bin; NaN where the
    window is not in contact throughout. touching: (scans, pads), contact in all of that bin. stirred: (scans, pads), 1
    where the pattern changed by more than noise and creep explain at a steady load, 0 where it did not; NaN elsewhere.
    """

    t_s: Floats
    centre_s: Floats
    log_ratio: Floats
    touching: Bools
    stirred: Floats

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(slots=True, eq=False)
class _Bin:
    """Sum of scans. touching, whole: (pads,), contact and no missing taxel in all of them."""

    since_s: float
    pressure: Floats
    touching: Bools
    whole: Bools
    scans: int = 1

    @property
    def mean(self) -> Floats:
        mean: Floats = self.pressure / self.scans
        return mean


class PatternWatch:
    """Compares patterns from bin to bin; the result does not depend on how the scans are cut into blocks."""

    def __init__(self, layout: Layout, creep_m_s: float, after: int) -> None:
        """creep_m_s: see `SlipMonitor`. after: bins after the one that is judged."""
        self._starts = layout.starts[:-1]
        self._entries = np.diff(layout.starts)
        self._places = np.stack([layout.x_m, layout.y_m])
        self._creep_m = creep_m_s * (after + BEFORE_BINS + 2) / 2 * BIN_S
        self._after = after
        self._bins: deque[_Bin] = deque(maxlen=BEFORE_BINS + 1 + after)
        self._open: _Bin | None = None
        self._last_s = -np.inf

    def step(self, scans: Scans) -> PatternChanges:
        """Changes of the scans that follow those of the last call."""
        shape = scans.contact.shape
        changes = PatternChanges(
            scans.t_s,
            np.full(len(scans), np.nan),
            np.full(shape, np.nan),
            np.zeros(shape, dtype=np.bool_),
            np.full(shape, np.nan),
        )
        for scan, t_s in enumerate(scans.t_s.tolist()):
            if self._completed(scans, scan, t_s) and len(self._bins) == self._bins.maxlen:
                centre = self._bins[BEFORE_BINS]
                changes.centre_s[scan] = centre.since_s
                changes.touching[scan] = centre.touching
                changes.log_ratio[scan], changes.stirred[scan] = self._compare(scans.noise)
        return changes

    def _completed(self, scans: Scans, scan: int, t_s: float) -> bool:
        """Add a scan to the open bin; whether that completes it."""
        step_s, self._last_s = t_s - self._last_s, t_s
        if step_s > _LONGEST_BIN_S:
            self._bins.clear()
            self._open = None
        pressure, touching, whole = scans.pressure[scan], scans.contact[scan], scans.complete[scan]
        if self._open is None:
            self._open = _Bin(t_s, pressure.copy(), touching, whole)
        else:
            self._open.pressure += pressure
            self._open.touching = self._open.touching & touching
            self._open.whole = self._open.whole & whole
            self._open.scans += 1
        if t_s - self._open.since_s + 1.5 * min(step_s, _LONGEST_BIN_S) < BIN_S:
            return False
        self._bins.append(self._open)
        self._open = None
        return True

    def _compare(self, noise: Floats) -> tuple[Floats, Floats]:
        """(pads,), log likelihood ratio and whether stirred. noise: (entries,)."""
        bins = list(self._bins)
        before, after = bins[:BEFORE_BINS], bins[BEFORE_BINS + 1 :]
        valid = np.logical_and.reduce([one.touching & one.whole for one in bins])
        if not valid.any():
            return np.full(len(valid), np.nan), np.full(len(valid), np.nan)
        old, new = (np.mean([one.mean for one in side], axis=0) for side in (before, after))
        scans = [sum(one.scans for one in side) for side in (before, after)]
        live = noise**2 * ((old != 0) | (new != 0)) * sum(1 / count for count in scans)
        load, rise, tilted, radius_m = self._explained(old, new)
        power, variance, taxels = self._sum(np.stack([new**2, live, live > 0]))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share, rest, noise_power = 1 - tilted / power, 1 - load / power, variance / power
            ratio = log_likelihood_ratio(share, rise, noise_power)
            doubt = 1 + _STIRRED_SIGMAS * np.sqrt(2 / taxels)
            crept = 0.5 * (self._creep_m / radius_m) ** 2  # a Gaussian pattern that creeps
            stirred = (rest > noise_power * doubt + crept).astype(np.float64)
        valid &= np.isfinite(ratio)
        steady = valid & (np.abs(rise) < _STEADY_RISE)
        return np.where(valid, ratio, np.nan), np.where(steady, stirred, np.nan)

    def _explained(self, old: Floats, new: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """(pads,): power of the new pattern that load explains, change of the log load, power that load and tilt
        explain, and radius of the old pattern, m.
        """
        weight = np.maximum(old, 0.0)
        total, *moments = self._sum(np.stack([weight, *(weight * self._places)]))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            arm = self._places - np.repeat(np.stack(moments) / total, self._entries, axis=1)
            radius_m = np.sqrt(self._sum(weight * (arm**2).sum(axis=0)) / (2 * total))
            modes = np.stack([old, *(old * arm / np.repeat(radius_m, self._entries))])
            modes = np.where(np.isfinite(modes), modes, 0.0)
            normal = self._sum(modes[:, np.newaxis] * modes).transpose(2, 0, 1)
            score = self._sum(modes * new).T
            normal += _RIDGE * (normal[:, :1, :1] + 1e-300) * np.eye(3)
            gain = np.linalg.solve(normal, score[..., np.newaxis])[..., 0]
            by_load = score[:, 0] ** 2 / normal[:, 0, 0]
            rise = np.log(np.maximum(self._sum(new), 0.0) / total)
        return by_load, rise, (gain * score).sum(axis=1), radius_m

    def _sum(self, values: Floats) -> Floats:
        """(..., pads), sums over each pad's entries, which are the last axis."""
        sums: Floats = np.add.reduceat(values, self._starts, axis=-1)
        return sums
