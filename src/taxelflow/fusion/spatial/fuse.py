"""One step of the fusion in space, compiled: twist, then pose, of scan after scan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.fusion.spatial.inheritance import inherit, keep_shown
from taxelflow.fusion.spatial.pose import Anchor, Body, fit_pose, pose_centre, set_anchors, start_body
from taxelflow.fusion.spatial.robust import Verdict, most_chi2
from taxelflow.fusion.spatial.solve import Contacts, Solution, room
from taxelflow.fusion.spatial.twist import (
    Limits,
    Misfit,
    Sixfold,
    centre_of,
    fill_joints,
    fill_rows,
    fuse_twist,
    unscale,
    usual_misfit,
    widen,
)
from taxelflow.fusion.spatial.window import Seen, Velocities, put_under, rates
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.numerics.se3 import compose, count_true
from taxelflow.numerics.small_linalg import copy_matrix
from taxelflow.runtime.compiling import kernel, routine


class _Knobs(NamedTuple):
    """Smooth contacts: those of a round object, or knobs on its surface."""

    attempts: int = 3
    """They are taken as of a round object, then as knobs, then as round again if the knobs were not better."""
    proof: float = 50.0
    """Chi-square by which knobs must be better: errors of several standard deviations occur without them."""


_KNOBS = _Knobs()


class Moving(NamedTuple):
    """Pads on links: J (scans, pads, 6, joints), twists of the pads per rate of each joint; joint_std: of an angle,
    rad; rate_std: (scans,), of its rate, rad/s. No joints where their errors are neglected.
    """

    J: Floats
    joint_std: float
    rate_std: Floats


class Memory(NamedTuple):
    """Kept from scan to scan: anchors (pads,), bodies (1,), misfits (2,) of twist and pose."""

    anchors: Records
    bodies: Records
    misfits: Records


class Written(NamedTuple):
    """twists, poses: (scans,) of `Sixfold`. body: (scans, 4, 4). blamed: (scans, pads). contradicted: (scans,). pads:
    (scans,).
    """

    twists: Records
    poses: Records
    body: Floats
    blamed: Bools
    contradicted: Bools
    pads: Floats


@kernel
def fuse_scans(
    seen: Seen,
    first: int,
    window_s: float,
    velocities: Velocities,
    moving: Moving,
    limits: Limits,
    memory: Memory,
    out: Written,
) -> None:
    """Fill what is written of the scans from `first` of seen on; velocities have an axis of these scans in front, and
    are filled in here unless the window is 0.
    """
    pads, joints = seen.theta.shape[1], moving.J.shape[3]
    solution = room(pads, joints)
    contacts = Contacts(
        np.zeros((pads, 3, 6)),
        np.zeros((pads, 3)),
        np.zeros((pads, 3, 3)),
        np.zeros((pads, 3, joints)),
        np.zeros(joints),
        np.zeros(pads),
    )
    for row in range(len(out.body)):
        pose_step(seen, first + row, row, moving, limits, contacts, solution, memory, out)
        scan, own = first + row, of_scan(velocities, row)
        usual, under, was = usual_misfit(memory.misfits[0]), np.empty((pads, 3)), np.empty((pads, 3))
        copy_matrix(seen.under[scan], under)
        deepest = verdict = Verdict(0, 0.0, 0.0, False, 0)
        for attempt in range(_KNOBS.attempts):
            if window_s > 0.0:
                rates(seen, scan, window_s, own)
            verdict = twist_step(row, own, usual, moving, limits, contacts, solution)
            if attempt == 0:
                deepest = verdict
            copy_matrix(seen.under[scan], was)
            if not another(attempt, verdict, deepest, usual, under, seen.under[scan]):
                break
            shift(own, was, seen.under[scan])
        write_twist(row, own, usual, verdict, limits, contacts, solution, memory, out)


@routine
def of_scan(velocities: Velocities, row: int) -> Velocities:
    """Those of one scan, as views."""
    return Velocities(velocities.frames[row], velocities.rate[row], velocities.covariance[row], velocities.known[row])


@routine
def twist_step(
    row: int,
    velocities: Velocities,
    usual: float,
    moving: Moving,
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
) -> Verdict:
    """Solve for the twist of one scan."""
    frames = velocities.frames
    centre = centre_of(frames, velocities.known)
    fill_rows(frames, centre, limits.length_m, contacts.rows)
    fill_joints(moving.J[row], moving.rate_std[row], centre, limits.length_m, contacts)
    return fuse_twist(velocities.rate, velocities.covariance, velocities.known, usual, limits, contacts, solution)


@routine
def another(attempt: int, verdict: Verdict, first: Verdict, usual: float, deep: Floats, under: Floats) -> bool:
    """Whether to solve another time, with `under` (pads, 3) as it then is. first: verdict of the first attempt.

    First, smooth contacts are those of a round object (deep). If the contacts then contradict each other, and far less
    at the surface, the smooth patterns are of knobs that are fixed to the object and move with it. Else they are taken
    as deep again. A contact that is blamed costs as much as twice the proof.
    """
    if attempt == 0 and (verdict.blamed > 0 or verdict.chi2 * usual > most_chi2(verdict.freedom)):
        smooth = lies_deep(under)
        if smooth:
            under[:] = 0.0
        return smooth
    if attempt == 1:
        scatter = 1.0 / usual
        if verdict.freedom > 0.0:
            scatter = max(scatter, verdict.chi2 / verdict.freedom)
        proof = first.chi2 - verdict.chi2 + 2.0 * _KNOBS.proof * scatter * (first.blamed - verdict.blamed)
        if proof < _KNOBS.proof * scatter:
            copy_matrix(deep, under)
            return True
    return False


@routine
def lies_deep(under: Floats) -> bool:
    """Whether the point of any contact, at (pads, 3), lies below the surface."""
    deep = 0.0
    for pad in range(len(under)):
        deep = max(deep, under[pad, 2])
    return deep > 0.0


@routine
def shift(velocities: Velocities, was: Floats, now: Floats) -> None:
    """Shift the places of velocities by now - was, both (pads, 3), in the axes of their frames."""
    for pad in range(len(velocities.known)):
        frame = velocities.frames[pad]
        for j in range(3):
            by = now[pad, j] - was[pad, j]
            for i in range(3):
                frame[i, 3] += frame[i, j] * by


@routine
def write_twist(
    row: int,
    velocities: Velocities,
    usual: float,
    verdict: Verdict,
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
    memory: Memory,
    out: Written,
) -> None:
    """Fill the twist of one scan, and who was blamed."""
    known = velocities.known
    count = count_true(known)
    if count == 0:
        return
    twist: Sixfold = out.twists[row]
    unscale(solution, verdict, centre_of(velocities.frames, known), limits.length_m, limits.twist_m_s, twist)
    widen(memory.misfits[0], usual, verdict, twist)
    for pad in range(len(known)):
        if contacts.use[pad] < 0.0:
            out.blamed[row, pad] = True
            count -= 1
    out.contradicted[row] = verdict.contradicted
    out.pads[row] = count


@routine
def find_heights(seen: Seen, scan: int, memory: Memory) -> None:
    """Fill the heights over the pads at which the body's pose has the points of the contacts."""
    B, body = np.empty((4, 4)), memory.bodies[0]
    for pad in range(len(memory.anchors)):
        anchor: Anchor = memory.anchors[pad]
        if seen.known[scan, pad] and anchor.anchored:
            compose(body.pose, anchor.frame, B)
            K, under = seen.frames[scan, pad], seen.under[scan, pad]
            there, here = put_under(B, under), put_under(K, under)
            for i in range(3):
                seen.height[scan, pad] += K[i, 2] * (there[i] - here[i])


@routine
def pose_step(
    seen: Seen,
    scan: int,
    row: int,
    moving: Moving,
    limits: Limits,
    contacts: Contacts,
    solution: Solution,
    memory: Memory,
    out: Written,
) -> None:
    """The pose of one scan."""
    body: Body = memory.bodies[0]
    for pad in range(len(memory.anchors)):
        memory.anchors[pad].anchored = memory.anchors[pad].anchored and seen.kept[scan, pad]
    if not count_true(seen.held[scan]):
        start_body(body, memory.anchors)
        memory.misfits[1].chi2 = memory.misfits[1].freedom = 0.0
        return
    if not count_true(seen.known[scan]):
        return
    inherited = np.zeros((6, 6))
    pose: Sixfold = out.poses[row]
    if body.started:
        past: Misfit = memory.misfits[1]
        usual = usual_misfit(past)
        joint_std = np.sqrt(2.0) * moving.joint_std  # of now, and of when the contact was anchored
        doubts = (moving.J[row], joint_std, usual)
        before, under = np.empty((4, 4)), np.empty((len(memory.anchors), 3))
        copy_matrix(body.pose, before)
        copy_matrix(seen.under[scan], under)
        centre = pose_centre(seen, scan, memory.anchors)
        deepest = verdict = Verdict(0, 0.0, 0.0, False, 0)
        for attempt in range(_KNOBS.attempts):
            copy_matrix(before, body.pose)
            verdict = fit_pose(seen, scan, centre, doubts, limits, contacts, solution, memory.anchors, body)
            if attempt == 0:
                deepest = verdict
            if not another(attempt, verdict, deepest, usual, under, seen.under[scan]):
                break
        verdict = inherit(contacts, solution, centre, limits, verdict, memory.anchors, body)
        unscale(solution, verdict, centre, limits.length_m, limits.pose_m, pose)
        factor = widen(past, usual, verdict, pose)
        copy_matrix(pose.covariance, inherited)
        keep_shown(solution, verdict.rank, centre, limits, factor, body, inherited)
        for pad in range(len(contacts.use)):
            out.blamed[row, pad] = out.blamed[row, pad] or contacts.use[pad] < 0.0
        out.contradicted[row] = out.contradicted[row] or verdict.contradicted
    else:
        pose.rank = 6.0
    find_heights(seen, scan, memory)
    set_anchors(seen, scan, pose.covariance, inherited, contacts.use, memory.anchors, body)
    copy_matrix(body.pose, out.body[row])


@kernel
def begin(memory: Memory) -> None:
    """Nothing touches yet."""
    start_body(memory.bodies[0], memory.anchors)
