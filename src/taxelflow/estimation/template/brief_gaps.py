"""Poses of the few scans in a row that know little, as a rule those in which a contact begins or ends.

A scan of few faintly loaded taxels may fit anywhere on the pad. The object has hardly moved much faster than it does
in the scans around: their poses, with what it may have moved since, are measurements, too, and all are combined by
their information. The quality of such a scan stays what it was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.pose_output import Poses
from taxelflow.messages import OK, UNRESOLVED

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats

_BRIEF = 5
"""Scans in a row; in more of them the object may have done anything."""
_FASTEST, _MARGIN = 0.95, 2.0
"""Quantile of the speeds in the other scans; the standard deviation of the speed in these is this many times that."""
_FEWEST = 8
"""Known scans from which speeds are learned."""
_FORMED = 0.5
"""Share of the usual load from which on a contact has its form: the highest taxels come first, and go last."""
_APART = 25.0
"""Chi-square of a scan from those around beyond which it fitted elsewhere by chance: 5 standard deviations."""


def formed(poses: Poses, load: Floats) -> Poses:
    """Poses of a contact, unresolved while it forms and while it ends: before the last, or after the first, of these
    scans that does not fit. One that fits between some that do not fits by chance. load: (scans,).
    """
    full = np.flatnonzero(load >= _FORMED * np.median(load))
    unresolved = np.flatnonzero(poses.quality == UNRESOLVED)
    begins, ends = unresolved[unresolved < full[0]], unresolved[unresolved > full[-1]]
    quality = poses.quality.copy()
    quality[: begins.max(initial=-1) + 1] = UNRESOLVED
    quality[ends.min(initial=len(quality)) :] = UNRESOLVED
    return Poses(poses.pose, poses.covariance, quality, poses.shared)


def bridged(poses: Poses, t_s: Floats) -> Poses:
    """Poses with brief runs of scans that are not OK drawn to those around them, as far as these know better."""
    known = np.flatnonzero(poses.quality == OK)
    if len(known) < _FEWEST or len(known) == len(poses):
        return poses
    free = np.isfinite(poses.pose[known]).all(axis=0)
    step = np.abs(np.diff(poses.pose[known][:, free], axis=0)) / np.diff(t_s[known])[:, np.newaxis]
    rate = _MARGIN * np.quantile(step, _FASTEST, axis=0)
    pose, covariance = poses.pose.copy(), poses.covariance.copy()
    box, count = np.ix_(free, free), int(free.sum())
    for k in np.flatnonzero(_brief(poses.quality != OK)).tolist():
        place = int(np.searchsorted(known, k))
        information, mean = np.zeros((count, count)), np.zeros(count)
        for near in known[max(place - 1, 0) : place + 1].tolist():
            moved = rate * abs(t_s[k] - t_s[near])
            more, at = _of(poses.pose[near, free], poses.covariance[near][box] + np.diag(moved**2))
            information, mean = information + more, mean + at
        own, at = _of(poses.pose[k, free], poses.covariance[k][box])
        if not _by_chance(poses.pose[k, free], poses.covariance[k][box], information, mean):
            information, mean = information + own, mean + at
        combined = np.linalg.inv(information)
        pose[k, free], covariance[k][box] = combined @ mean, combined
    return Poses(pose, covariance, poses.quality)


def _by_chance(pose: Floats, covariance: Floats, information: Floats, mean: Floats) -> bool:
    """Whether a pose is farther from that of the scans around, given by their information, than both explain."""
    around = np.linalg.inv(information)
    apart = pose - around @ mean
    return bool(apart @ np.linalg.solve(covariance + around, apart) > _APART)


def _of(pose: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Information (n, n), and information times pose (n,); 0 where nothing is known."""
    if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] <= 0:
        return np.zeros_like(covariance), np.zeros_like(pose)
    information = np.linalg.inv(covariance).astype(np.float64)
    return information, information @ pose


def _brief(unknown: Bools) -> Bools:
    """(scans,), which of `unknown` lie in runs of at most `_BRIEF`."""
    edges = np.flatnonzero(np.diff(unknown.astype(np.int8), prepend=0, append=0))
    brief = np.zeros_like(unknown)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        brief[start:stop] = stop - start <= _BRIEF
    return brief
