"""Scores of the motion in space on simulated grasps: twist over a window, pose, wrong pads, errors of joint angles."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from taxelflow.evaluation.statistics import rms
from taxelflow.fusion.spatial.parameters import SpatialField
from taxelflow.numerics.geometry import adjoint, se3_inverse, se3_log, se3_of
from taxelflow.pipeline import api
from taxelflow.simulation.grasp import Grasp, grasp_bound, simulate_grasp

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats, RawScans, SpatialMotions
    from taxelflow.simulation.grasp import Grasped

CENTRE_M = np.array([0.0, 0.0, 0.14])
"""Middle of the grasp in the hand, at which velocities and poses are compared."""
STUCK = "finger3_mid"
"""The pad that is made to stick to its first reading."""
_JOINT_ERROR_DEG = 0.2
JOINT_ERROR_RAD = math.radians(_JOINT_ERROR_DEG)
"""Standard deviation of the joint angles in the last variant."""
_GRASP = Grasp()
"""Its object moves along z at the middle of the grasp."""
VARIANTS = ("known joints", "one pad stuck", f"joints off by {_JOINT_ERROR_DEG:g} deg")


class GraspRow(msgspec.Struct, frozen=True):
    """One method and variant, over all strokes of all seeds; scans at the end of a stroke, one window each."""

    variant: str
    method: str
    direction_deg: float | None
    """Median error of the direction of the object's velocity at the middle of the grasp."""
    speed_percent: float | None
    """RMS error of its size."""
    turn_percent: float | None
    """RMS error of the rate of turn, in percent of the true one."""
    direction_bound_deg: float
    """Cramér-Rao bounds of these three, RMS: of a line through the poses of a window, patterns and joints known."""
    speed_bound_percent: float
    turn_bound_percent: float
    nees: float | None
    """Of the twist, over 6; 1 if its covariance is right."""
    pose_mm: float
    """RMS error of the object's place at the middle of the grasp since first contact, one constant offset taken off."""
    pose_deg: float
    bound_mm: float | None
    """Cramér-Rao bound of one scan, patterns known."""
    bound_deg: float | None
    blamed_rightly: float | None
    """Share of the scans in which the pad that sticks, and no other, is blamed."""
    strokes: int


class _Found(NamedTuple):
    """Of one recording. twist: (strokes, 4), errors of direction, speed and turn, and NEES. pose: (scans, 6), errors.
    right: (strokes,), whether the right pad was blamed.
    """

    twist: Floats
    pose: Floats
    right: Floats


def grasp_rows(methods: tuple[str, ...], seeds: list[int], exponent: float) -> list[GraspRow]:
    """Simulate, estimate and compare. exponent: see `Grasp`. Raises ExtraMissing without MuJoCo, NameUnknown."""
    found: dict[tuple[str, str], list[_Found]] = {(v, m): [] for m in methods for v in VARIANTS}
    bounds = []
    for seed in seeds:
        grasp = Grasp(seed=seed, exponent=exponent)
        grasped = simulate_grasp(grasp)
        shaken = simulate_grasp(replace(grasp, joint_error_rad=JOINT_ERROR_RAD))
        chosen = np.linspace(grasped.strokes[0].stop, grasped.strokes[-1].stop - 1, 3).astype(int).tolist()
        bounds.append(grasp_bound(grasp, grasped, chosen))
        recordings = zip(VARIANTS, (grasped.recording, _stuck(grasped), shaken.recording), strict=True)
        for (variant, recording), method in product(recordings, methods):
            result = api.estimate(recording, method)
            if result.spatial is not None:
                found[variant, method].append(_compared(grasped, result.spatial, result.pads))
    return [_row(variant, method, runs, np.concatenate(bounds)) for (variant, method), runs in found.items()]


def _stuck(grasped: Grasped) -> Recording:
    """The recording with one pad whose readings stay what they are when the object begins to move."""
    recording = grasped.recording
    own = recording.layout.of_pad(recording.layout.pads.index(STUCK))
    (block,) = recording.read()
    values = block.values.copy()
    begins = grasped.strokes[0].start
    noise = values[begins - 20 : begins, own].std(axis=0)
    random = np.random.default_rng(0)
    values[begins:, own] = values[begins - 1, own] + noise * random.normal(size=values[begins:, own].shape)
    raw: RawScans = replace(block, values=values)
    return replace(recording, read=lambda: iter((raw,)))


def _compared(grasped: Grasped, motions: SpatialMotions, pads: tuple[str, ...]) -> _Found:
    at = [stroke.stop - 1 for stroke in grasped.strokes]
    rows, right = [], []
    for k in at:
        v, true = (_at_centre(twist) for twist in (motions.twist[k], grasped.twist[k]))
        cosine = v[:3] @ true[:3] / np.linalg.norm(v[:3]) / np.linalg.norm(true[:3])
        error = motions.twist[k] - grasped.twist[k]
        rows.append(
            (
                np.degrees(np.arccos(np.clip(cosine, -1, 1))),
                100 * (np.linalg.norm(v[:3]) / np.linalg.norm(true[:3]) - 1),
                100 * np.linalg.norm(v[3:] - true[3:]) / np.linalg.norm(true[3:]),
                error @ np.linalg.solve(motions.twist_covariance[k], error) / 6,
            )
        )
        right.append(float({pads[pad] for pad in np.flatnonzero(motions.blamed[k])} == {STUCK}))
    scans = np.arange(at[0], at[-1] + 1)
    scans = scans[np.isfinite(motions.pose[scans]).all(axis=1)]
    T = np.array([se3_of(pose[:3], pose[3:]) for pose in motions.pose[scans]]).reshape(-1, 4, 4)
    shift = np.eye(4)
    shift[:3, 3] = CENTRE_M
    apart = se3_log(se3_inverse(shift) @ T @ se3_inverse(grasped.X[scans]) @ shift)
    return _Found(np.array(rows), apart - apart.mean(axis=0), np.array(right))


def _at_centre(twist: Floats) -> Floats:
    moved: Floats = np.concatenate([twist[:3] + np.cross(twist[3:], CENTRE_M), twist[3:]])
    return moved


def _row(variant: str, method: str, runs: list[_Found], bounds: Floats) -> GraspRow:
    twist, pose, right = (np.concatenate(part) for part in zip(*runs, strict=True))
    known = twist[np.isfinite(twist).all(axis=1)]
    shift = np.eye(4)
    shift[:3, 3] = -CENTRE_M
    least = np.diagonal(adjoint(shift) @ bounds @ adjoint(shift).T, axis1=1, axis2=2).mean(axis=0)
    x, y, along, *turn = np.sqrt(least) / _line_s()
    return GraspRow(
        variant=variant,
        method=method,
        direction_deg=float(np.median(known[:, 0])) if len(known) else None,
        speed_percent=rms(known[:, 1]) if len(known) else None,
        turn_percent=rms(known[:, 2]) if len(known) else None,
        direction_bound_deg=float(np.degrees(np.hypot(x, y) / _GRASP.speed_m_s)),
        speed_bound_percent=float(100 * along / _GRASP.speed_m_s),
        turn_bound_percent=float(100 * np.linalg.norm(turn) / _GRASP.turn_rad_s),
        nees=float(known[:, 3].mean()) if len(known) else None,
        pose_mm=1e3 * rms(np.linalg.norm(pose[:, :3], axis=1)),
        pose_deg=float(np.degrees(rms(np.linalg.norm(pose[:, 3:], axis=1)))),
        bound_mm=1e3 * float(np.sqrt(least[:3].sum())),
        bound_deg=float(np.degrees(np.sqrt(least[3:].sum()))),
        blamed_rightly=float(right.mean()) if variant == VARIANTS[1] else None,
        strokes=len(twist),
    )


def _line_s() -> float:
    """Standard deviation of a pose over that of the slope of a line through a window of poses, s."""
    scans = round(SpatialField().window_s * _GRASP.rate_hz) + 1
    return float(np.sqrt(scans * (scans**2 - 1) / 12) / _GRASP.rate_hz)
