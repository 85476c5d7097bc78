"""Poses exclude a slip where they are `ok`, stay and are precise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sliding import slips_of
from taxelflow.messages import AMBIGUOUS, OK
from taxelflow.slip.pose_rest import PoseRest

if TYPE_CHECKING:
    from taxelflow.messages import Floats, Slips

PITCH_M = np.array([[0.004, 0.005]])
WINDOW = 4
SCANS = 20


def poses(way_m: Floats | float = 0.0, deviation_m: float = 1e-4) -> Slips:
    """Along x, with this deviation; one scan is one bin."""
    pose = np.zeros((SCANS, 3))
    pose[:, 0] = way_m
    slips = slips_of(pose)
    covariance = np.broadcast_to(np.diag([deviation_m**2, 1e-10, 1e-4]), (SCANS, 1, 3, 3))
    return replace(slips, covariance=covariance, quality=np.full((SCANS, 1), OK, dtype=np.uint8))


def excluded(slips: Slips, slipped: bool = False) -> list[bool]:
    watch = PoseRest(PITCH_M, WINDOW)
    return [bool(watch.step(slips, scan, np.array([slipped]))[0]) for scan in range(SCANS)]


def test_precise_poses_that_stay_exclude_a_slip_once_they_fill_the_window() -> None:
    assert excluded(poses()) == [False] * WINDOW + [True] * (SCANS - WINDOW)


@pytest.mark.parametrize(
    "slips",
    [
        poses(deviation_m=4e-4),
        poses(np.where(np.arange(SCANS) % 2, 1e-3, 0.0)),
        replace(poses(), quality=np.full((SCANS, 1), AMBIGUOUS, dtype=np.uint8)),
    ],
)
def test_poses_that_are_vague_or_move_or_are_not_ok_exclude_nothing(slips: Slips) -> None:
    assert not any(excluded(slips))


def test_a_slip_by_the_pose_is_not_excluded() -> None:
    assert not any(excluded(poses(), slipped=True))


@given(step_m=st.floats(0.0, 2e-3), begin=st.integers(0, SCANS - 1))
def test_a_quarter_of_a_pitch_is_never_excluded(step_m: float, begin: int) -> None:
    found = excluded(poses(np.where(np.arange(SCANS) >= begin, step_m, 0.0)))
    if begin > 0 and step_m > 0.25e-3 * 4:
        assert not any(found[begin : begin + WINDOW])
    assert all(found[begin + WINDOW + 1 :])
