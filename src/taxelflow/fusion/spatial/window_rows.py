"""Rows of the window of the fusion in space: filled from the slips of pads, and the object's motion read from them."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from taxelflow.fusion.spatial.window import Seen
from taxelflow.messages import AMBIGUOUS, UNRESOLVED, Bools, Bytes, Floats
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.records import Records
from taxelflow.numerics.se3 import compose
from taxelflow.numerics.small_linalg import copy_matrix
from taxelflow.runtime.compiling import exact_kernel, routine


class Rules:
    """Of a pad. used: whether it has a place in space. edge_m: standard deviations that are added along x and y at a
    border to ambiguous poses. anchor_m: the same where a contact is anchored in a scan whose pose is not resolved.
    patience_s: how long poses that are not resolved are left out, after the last that was or the begin of a contact.
    since_s: time of that; NaN before any scan.
    """

    used: bool
    edge_m: Annotated[Floats, 2]
    anchor_m: float
    patience_s: float
    since_s: float


class PadSlips(NamedTuple):
    """Fields of `Slips` and `Texture`, of all scans and pads; formed: see `Forming`."""

    contact: Bools
    border: Bools
    quality: Bytes
    displacement: Floats
    pose: Floats
    covariance: Floats
    displacement_covariance: Floats
    turns: Bools
    unobservable: Floats
    formed: Bools


class MotionFields(NamedTuple):
    """Fields of `SpatialMotions`, of all scans."""

    twist: Floats
    twist_covariance: Floats
    pose: Floats
    pose_covariance: Floats
    observed: Floats


@exact_kernel
def fill_rows(slips: PadSlips, frames: Floats, rules: Records, first: int, seen: Seen) -> None:
    """Fill the rows of seen, but for their times, from `first` on. frames: (scans, pads, 4, 4), of the contacts, NaN
    where unknown.
    """
    for scan in range(len(frames)):
        row = first + scan
        for pad in range(len(rules)):
            rule: Rules = rules[pad]
            held = slips.contact[scan, pad] and rule.used
            copy_matrix(frames[scan, pad], seen.frames[row, pad])
            copy_matrix(slips.unobservable[scan, pad], seen.unobservable[row, pad])
            known = held and fill_pose_covariance(slips, scan, pad, rule, seen.covariance[row, pad])
            resolved = slips.quality[scan, pad] < UNRESOLVED
            formed = held and slips.formed[scan, pad]
            if resolved or not formed or np.isnan(rule.since_s):
                rule.since_s = seen.t_s[row]
            known = known and formed and all_finite(frames[scan, pad], 4)
            known = known and (resolved or seen.t_s[row] - rule.since_s >= rule.patience_s - SAME_S)
            fill_noise(slips.displacement_covariance[scan, pad], seen.covariance[row, pad], seen.noise[row, pad])
            seen.theta[row, pad] = slips.pose[scan, pad, 2]
            if not slips.turns[scan, pad]:
                leave_turn(row, pad, seen)
            loose = 0.0 if resolved else rule.anchor_m
            seen.doubt[row, pad] = loose * loose
            seen.known[row, pad], seen.held[row, pad] = known, held
            seen.kept[row, pad] = held and (np.isfinite(slips.displacement[scan, pad, 0]) or not known)
            seen.height[row, pad] = 0.0
            for a in range(3):
                seen.under[row, pad, a] = 0.0


@routine
def fill_pose_covariance(slips: PadSlips, scan: int, pad: int, rule: Rules, whole: Floats) -> bool:
    """Fill whole (3, 3), the covariance of a pose, wider at a border; whether the place is known."""
    copy_matrix(slips.covariance[scan, pad], whole)
    if slips.quality[scan, pad] == AMBIGUOUS:
        for a in range(2):
            if slips.border[scan, pad, a]:
                whole[a, a] += rule.edge_m[a] * rule.edge_m[a]
    return all_finite(whole, 2)


@routine
def all_finite(matrix: Floats, n: int) -> bool:
    """Whether the first n rows and columns are."""
    known = True
    for a in range(n):
        for b in range(n):
            known = known and np.isfinite(matrix[a, b])
    return known


@routine
def leave_turn(row: int, pad: int, seen: Seen) -> None:
    """Make the turn of a contact unknown."""
    seen.theta[row, pad] = np.nan
    for a in range(3):
        seen.covariance[row, pad, a, 2] = seen.covariance[row, pad, 2, a] = np.nan


@routine
def fill_noise(moved: Floats, whole: Floats, noise: Floats) -> None:
    """Fill noise (3, 3): half of the covariance of a displacement, where that is less than the pose's own, whole."""
    less = True
    for a in range(3):
        less = less and (0.5 * moved[a, a] <= whole[a, a] or not np.isfinite(whole[a, a]))
    for a in range(3):
        for b in range(3):
            noise[a, b] = 0.5 * moved[a, b] if less else whole[a, b]


@exact_kernel
def along_planes(T: Floats, planes: Floats, point: Floats, frames: Floats) -> None:
    """Fill frames (scans, pads, 4, 4) of points (scans, pads, 2) on flat skins. T: (scans, pads, 4, 4), of the pads in
    the hand. planes: (pads, 4, 4), of the skins on their pads.
    """
    F = np.zeros((4, 4))
    for scan in range(len(point)):
        for pad in range(len(planes)):
            x, y = point[scan, pad, 0], point[scan, pad, 1]
            copy_matrix(planes[pad], F)
            for i in range(3):
                F[i, 3] += x * F[i, 0] + y * F[i, 1]
            compose(T[scan, pad], F, frames[scan, pad])


@exact_kernel
def fill_motions(twists: Records, poses: Records, body: Floats, pads: Floats, worst: Floats, out: MotionFields) -> None:
    """Fill motions from `Sixfold` (scans,) of twists and poses, and the body's pose (scans, 4, 4), NaN where unknown.

    pads: (scans,), number that contribute to the twist. worst: (6,), standard deviations beyond which a component of a
    twist is unknown that is not observed whole.
    """
    for scan in range(len(pads)):
        twist, pose = twists[scan], poses[scan]
        none, lost = pads[scan] == 0.0, not np.isfinite(body[scan, 0, 0])
        for i in range(6):
            out.observed[scan, i] = np.nan if none else twist.value[i]
            blind = twist.rank < 6.0 and np.sqrt(twist.covariance[i, i]) > worst[i]
            out.twist[scan, i] = np.nan if none or blind else twist.value[i]
            for j in range(6):
                out.twist_covariance[scan, i, j] = np.nan if none else twist.covariance[i, j]
                out.pose_covariance[scan, i, j] = np.nan if lost else pose.covariance[i, j]
        for i in range(3):
            out.pose[scan, i] = body[scan, i, 3]
        if lost:
            for i in range(7):
                out.pose[scan, i] = np.nan
        else:
            turn_of(body[scan], out.pose[scan])


@routine
def turn_of(body: Floats, pose: Floats) -> None:
    """Fill the quaternion x, y, z, w >= 0 of a pose (7,) from the body's (4, 4), by its largest component."""
    trace = body[0, 0] + body[1, 1] + body[2, 2]
    best, most = 3, trace
    for i in range(3):
        if body[i, i] > most:
            best, most = i, body[i, i]
    if best == 3:
        pose[6] = 1.0 + trace
        for i in range(3):
            n, m = (i + 1) % 3, (i + 2) % 3
            pose[3 + i] = body[m, n] - body[n, m]
    else:
        n, m = (best + 1) % 3, (best + 2) % 3
        pose[3 + best] = 1.0 - trace + 2.0 * body[best, best]
        pose[3 + n] = body[n, best] + body[best, n]
        pose[3 + m] = body[m, best] + body[best, m]
        pose[6] = body[m, n] - body[n, m]
    length = 0.0
    for i in range(3, 7):
        length += pose[i] * pose[i]
    length = np.sqrt(length) if pose[6] >= 0.0 else -np.sqrt(length)
    for i in range(3, 7):
        pose[i] /= length
