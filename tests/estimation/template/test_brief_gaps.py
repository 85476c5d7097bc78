"""Scans that know little between scans that know much."""

import numpy as np
import pytest

from taxelflow.estimation.template.brief_gaps import bridged, formed
from taxelflow.estimation.template.pose_output import Poses
from taxelflow.messages import AMBIGUOUS, OK, UNRESOLVED

SCANS, PERIOD_S, SPEED_M_S = 40, 0.02, 0.02


def steady(unknown: slice, off_m: float = 0.03, std_m: float = 0.01) -> tuple[Poses, np.ndarray]:
    """An object at 20 mm/s, known to 0.1 mm but in scans `unknown`; and where it is (scans, 2)."""
    t_s = PERIOD_S * np.arange(SCANS)
    true = np.stack([SPEED_M_S * t_s, np.zeros(SCANS)], axis=1)
    pose = np.column_stack([true, np.full(SCANS, np.nan)])
    covariance = np.full((SCANS, 3, 3), np.nan)
    covariance[:, :2, :2] = 1e-4**2 * np.eye(2)
    quality = np.full(SCANS, OK, np.uint8)
    pose[unknown, 0] += off_m
    covariance[unknown, :2, :2] = std_m**2 * np.eye(2)
    quality[unknown] = AMBIGUOUS
    return Poses(pose, covariance, quality), true


@pytest.mark.parametrize("unknown", [slice(0, 2), slice(20, 23), slice(SCANS - 3, SCANS)])
def test_a_brief_gap_is_bridged_within_its_covariance(unknown: slice) -> None:
    poses, true = steady(unknown)
    found = bridged(poses, PERIOD_S * np.arange(SCANS))
    off = found.pose[unknown, 0] - true[unknown, 0]
    std = np.sqrt(found.covariance[unknown, 0, 0])
    assert np.abs(off).max() < 3e-3  # of 30 mm
    assert (np.abs(off) < 3 * std).all()
    assert (found.quality == poses.quality).all()
    known = poses.quality == OK
    np.testing.assert_array_equal(found.pose[known], poses.pose[known])


def test_a_long_gap_stays_as_it_was_measured() -> None:
    poses, _ = steady(slice(10, 20))
    assert bridged(poses, PERIOD_S * np.arange(SCANS)).pose[12, 0] == poses.pose[12, 0]


def test_what_a_scan_knows_by_itself_counts() -> None:
    poses, _ = steady(slice(0, 1), off_m=0.5e-3, std_m=0.05e-3)
    found = bridged(poses, PERIOD_S * np.arange(SCANS))
    assert found.pose[0, 0] == pytest.approx(poses.pose[0, 0], abs=0.05e-3)


def test_without_enough_known_scans_nothing_is_drawn() -> None:
    poses, _ = steady(slice(4, SCANS))
    assert bridged(poses, PERIOD_S * np.arange(SCANS)) is poses


def test_a_scan_that_fits_elsewhere_by_chance_is_drawn_to_those_around() -> None:
    poses, true = steady(slice(0, 1), off_m=0.018, std_m=0.26e-3)
    found = bridged(poses, PERIOD_S * np.arange(SCANS))
    assert abs(found.pose[0, 0] - true[0, 0]) < 1e-3


def test_while_a_contact_forms_or_ends_no_scan_is_resolved_beyond_one_that_does_not_fit() -> None:
    poses, _ = steady(slice(0, 0))
    load = np.ones(SCANS)
    load[:4], load[-4:] = [0.15, 0.35, 0.45, 0.8], [0.9, 0.4, 0.3, 0.1]
    poses.quality[[1, 20, SCANS - 2]] = UNRESOLVED
    found = formed(poses, load).quality
    resolved = np.flatnonzero(found != UNRESOLVED).tolist()
    assert resolved == [*range(2, 20), *range(21, SCANS - 2)]
    whole = formed(poses, np.ones(SCANS)).quality
    np.testing.assert_array_equal(whole, poses.quality)
