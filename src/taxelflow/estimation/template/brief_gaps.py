"""Poses of short runs of scans with little information, mostly where a contact begins or ends.

A scan of few, weakly loaded taxels may fit anywhere on the pad. The speeds in the scans around it bound how far the
object has moved since. So the poses around, with a variance for that motion, are further measurements; all are combined
by their information. The quality of such a scan does not change.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.hypotheses import ENOUGH_SCANS
from taxelflow.messages import OK, UNRESOLVED
from taxelflow.numerics.robust import OUTLIER
from taxelflow.numerics.spans import spans

if TYPE_CHECKING:
    from taxelflow.estimation.template.pose_output import Poses
    from taxelflow.messages import Bools, Floats


class _Gap(NamedTuple):
    """A brief run of scans without a pose."""

    scans: int = 5
    """Scans in a row; in a longer run the speeds around it bound nothing."""
    quantile: float = 0.95
    margin: float = 2.0
    """The standard deviation of the speed in such a run: this quantile of the other speeds, times this factor."""


_GAP = _Gap()
_FORMED = 0.5
"""Share of the median load above which a contact is complete: the highest points of an object touch first."""


def formed(poses: Poses, load: Floats) -> Poses:
    """Poses of a contact, marked unresolved while it forms and while it ends. load: (scans,).

    It forms up to its last unresolved scan before the load is complete, and ends from the first one after. Scans that
    fit in between fit by chance.
    """
    full = np.flatnonzero(load >= _FORMED * np.median(load))
    unresolved = np.flatnonzero(poses.quality == UNRESOLVED)
    begins, ends = unresolved[unresolved < full[0]], unresolved[unresolved > full[-1]]
    quality = poses.quality.copy()
    quality[: begins.max(initial=-1) + 1] = UNRESOLVED
    quality[ends.min(initial=len(quality)) :] = UNRESOLVED
    return replace(poses, quality=quality)


def bridged(poses: Poses, t_s: Floats) -> Poses:
    """Poses in which short runs of scans that are not OK are combined with the poses around them."""
    known = np.flatnonzero(poses.quality == OK)
    if len(known) < ENOUGH_SCANS or len(known) == len(poses):
        return poses
    free = np.isfinite(poses.pose[known]).all(axis=0)
    step = np.abs(np.diff(poses.pose[known][:, free], axis=0)) / np.diff(t_s[known])[:, np.newaxis]
    rate = _GAP.margin * np.quantile(step, _GAP.quantile, axis=0)
    pose, covariance = poses.pose.copy(), poses.covariance.copy()
    box, count = np.ix_(free, free), int(free.sum())
    for k in np.flatnonzero(_in_short_runs(poses.quality != OK)).tolist():
        place = int(np.searchsorted(known, k))
        information, mean = np.zeros((count, count)), np.zeros(count)
        for near in known[max(place - 1, 0) : place + 1].tolist():
            moved = rate * abs(t_s[k] - t_s[near])
            more, at = _information_form(poses.pose[near, free], poses.covariance[near][box] + np.diag(moved**2))
            information, mean = information + more, mean + at
        own, at = _information_form(poses.pose[k, free], poses.covariance[k][box])
        if not _is_outlier(poses.pose[k, free], poses.covariance[k][box], information, mean):
            information, mean = information + own, mean + at
        combined = np.linalg.inv(information)
        pose[k, free], covariance[k][box] = combined @ mean, combined
    return replace(poses, pose=pose, covariance=covariance)


def _is_outlier(pose: Floats, covariance: Floats, information: Floats, mean: Floats) -> bool:
    """Whether a pose contradicts the combined pose of the scans around it, given as information and mean."""
    around = np.linalg.inv(information)
    apart = pose - around @ mean
    return bool(apart @ np.linalg.solve(covariance + around, apart) > OUTLIER)


def _information_form(pose: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Information (n, n), and information times pose (n,); both 0 for an unknown or singular covariance."""
    if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] <= 0:
        return np.zeros_like(covariance), np.zeros_like(pose)
    information = np.linalg.inv(covariance).astype(np.float64)
    return information, information @ pose


def _in_short_runs(unknown: Bools) -> Bools:
    """(scans,), which of the unknown scans lie in runs of at most `_GAP.scans`."""
    brief = np.zeros_like(unknown)
    for start, stop in spans(unknown):
        brief[start:stop] = stop - start <= _GAP.scans
    return brief
