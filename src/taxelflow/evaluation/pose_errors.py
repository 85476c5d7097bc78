"""Errors of poses against the truth of a rig's scenario, for the scores limits and contacts.

What an estimator calls the object's place is some point of its body at some angle, which nothing in the scans fixes.
So errors are what is left of a contact's poses when one constant body offset and one constant angle, those that fit
best (weights: information at the known bound), were taken off; a contact starts again where the pad was free or the
estimator was lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import LOST, OK
from taxelflow.numerics.geometry import rotation, wrapped
from taxelflow.numerics.rounding import LINE_POINTS
from taxelflow.simulation.motion import move

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from taxelflow.evaluation.bound import Bound
    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.simulation.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Errors:
    """One method on one seed. error: (scans, 3) in m, m, rad, NaN where unknown; since: (scans, 3), the same of the
    motion since the contact's first scan. covariance: (scans, 3, 3) as the estimator gave it. ok: (scans,). piece:
    (scans,), number of the contact.
    """

    error: Floats
    since: Floats
    covariance: Floats
    ok: Bools
    piece: NDArray[np.int64]
    bound: Bound


def errors_of(scenario: Scenario, t_s: Floats, slips: Slips, pad: int, bound: Bound) -> Errors:
    """Errors of one run, each contact's constant body offset and angle taken off. t_s: (scans,), true times."""
    pose, quality, lag_s = slips.pose[:, pad], slips.quality[:, pad], slips.lag_s[:, pad]
    true = move(scenario.motion, t_s - np.nan_to_num(lag_s), scenario.seed).pose
    known = bound.scored & np.isfinite(pose[:, :2]).all(axis=1) & (quality != LOST)
    broken = ~slips.contact[:, pad] | (quality == LOST)
    piece = np.cumsum(broken)
    error, since = np.full(pose.shape, np.nan), np.full(pose.shape, np.nan)
    for own in contacts_of(known, piece):
        error[own] = without_frame(pose[own], true[own], bound.known[own])
        since[own[1:]] = _moved(pose[own], true[own])
    return Errors(error, since, slips.covariance[:, pad], quality == OK, piece, bound)


def contacts_of(known: Bools, piece: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """The known scans (scans,) of each contact that has enough of them. piece: (scans,), number of the contact."""
    for number in np.unique(piece[known]):
        own = np.flatnonzero(known & (piece == number))
        if len(own) >= LINE_POINTS:
            yield own


def without_frame(pose: Floats, true: Floats, deviation: Floats) -> Floats:
    """What is left of poses (scans, 3) of a body point when it was put where it fits the true poses best.

    deviation: (scans, 3), standard deviations that weight the fit, NaN for a turn that is not observable.
    """
    turn = rotation(true[:, 2])
    apart = pose[:, :2] - true[:, :2]
    in_body = np.einsum("kji,kj->ki", turn, apart)
    weight = 1 / np.sum(deviation[:, :2] ** 2, axis=1)
    body = weight @ in_body / weight.sum()
    error = np.full(pose.shape, np.nan)
    error[:, :2] = apart - turn @ body
    sure = np.where(np.isfinite(deviation[:, 2]), 1 / deviation[:, 2] ** 2, 1.0) * np.isfinite(pose[:, 2])
    turned = np.nan_to_num(pose[:, 2] - true[:, 2])
    off = turned - np.angle(np.sum(sure * np.exp(1j * turned)))
    error[:, 2] = np.where(np.isfinite(pose[:, 2]), wrapped(off), np.nan)
    return error


def _moved(pose: Floats, true: Floats) -> Floats:
    """Errors (scans - 1, 3) of the motion since the first scan, of the object's centre.

    Turns count from the first one that is known; where none is, the true turn carries the point that is followed.
    """
    gap = pose[:, 2] - true[:, 2]
    known = np.flatnonzero(np.isfinite(gap))
    turned = wrapped(gap - (gap[known[0]] if len(known) else 0.0))
    way = rotation(true[:, 2] - true[0, 2] + np.nan_to_num(turned))
    centre = pose[:, :2] + way @ (true[0, :2] - pose[0, :2])
    turned[known[:1]] = np.nan
    return np.column_stack([centre - true[:, :2], turned])[1:]
