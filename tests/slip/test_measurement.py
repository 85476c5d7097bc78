from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiled import compiled
from taxelflow.evaluation.slip_scoring import still_slips
from taxelflow.messages import AMBIGUOUS, LOST, OK, UNRESOLVED
from taxelflow.numerics.records import records
from taxelflow.slip.covariance import Covariance
from taxelflow.slip.measurement import (
    Measurement,
    observations,
    parameter_records,
)
from taxelflow.slip.measurement import (
    has_pose as _has_pose,
)
from taxelflow.slip.measurement import (
    measure as _measure,
)
from taxelflow.slip.measurement import (
    measure_pose as _measure_pose,
)
from taxelflow.slip.measurement import (
    raise_to_mean as _raise_to_mean,
)

has_pose = compiled(_has_pose)
measure = compiled(_measure)
measure_pose = compiled(_measure_pose)
raise_to_mean = compiled(_raise_to_mean)

STD = np.array([2e-5, 3e-5, 1e-3])


def scans(count: int = 5, **fields: Any) -> Any:
    """Records of one pad's scans that move by one unit of STD each."""
    pose = np.arange(1.0, count + 1)[:, np.newaxis] * STD
    found = observations(still_slips(np.arange(count) / 100, pose, STD, np.zeros(3)))[:, 0]
    for name, value in fields.items():
        found[name] = value
    return found


def empty() -> Any:
    measurement = records(Measurement, 1)[0]
    measurement["previous_s"] = -np.inf
    return measurement


def test_displacements_add_up_and_half_their_covariance_is_a_poses() -> None:
    measurement = empty()
    for scan in scans():
        assert measure(scan, measurement)
    np.testing.assert_allclose(measurement["position"], 5 * STD)
    np.testing.assert_allclose(measurement["covariance"]["variance"], STD**2 + [1e-12, 1e-12, 1e-10])
    assert measurement["t_s"] == 0.04


def test_an_unknown_turn_leaves_the_position_as_it_is() -> None:
    some = scans()
    some["displacement"][2:, 2] = np.nan
    measurement = empty()
    for scan in some:
        measure(scan, measurement)
    np.testing.assert_allclose(measurement["position"], [5, 5, 2] * STD)


def test_of_poses_that_share_a_scan_every_second_one_is_used() -> None:
    measurement, used = empty(), []
    for scan in scans(lag_s=0.005):
        used.append(measure(scan, measurement))
        if used[-1]:
            measurement["previous_s"] = scan["t_s"]
    assert used == [True, False, True, False, True]
    np.testing.assert_allclose(measurement["position"], 5 * STD)
    np.testing.assert_allclose(measurement["covariance"]["variance"][:2], 2 * STD[:2] ** 2 + 1e-12)


def test_a_pose_that_does_not_fit_has_three_times_the_deviation() -> None:
    scan, measurement = scans(quality=UNRESOLVED)[0], empty()
    scan["displacement_covariance"][0, 1] = 1e-10
    measure(scan, measurement)
    measure_pose(scan, 4.0, measurement)
    np.testing.assert_allclose(measurement["covariance"]["variance"][:2], 9 * STD[:2] ** 2 + 1e-12)
    assert measurement["covariance"]["xy"] == pytest.approx(4.5e-10)
    np.testing.assert_allclose(measurement["pose_covariance"]["variance"][:2], 36 * STD[:2] ** 2 + 1e-12)


@pytest.mark.parametrize(("std", "unknown"), [(0.02, [0]), (0.004, [])], ids=str)
def test_an_axis_is_unknown_if_it_is_worse_than_the_other_and_bad(std: float, unknown: list[int]) -> None:
    scan, measurement = scans()[0], empty()
    scan["displacement_covariance"][0, 0] = 2 * std**2
    scan["displacement_covariance"][0, 1] = scan["displacement_covariance"][0, 2] = 1e-9
    measure(scan, measurement)
    assert np.flatnonzero(np.isnan(measurement["covariance"]["variance"])).tolist() == unknown
    assert (measurement["covariance"]["xy"] == 0.0) == (measurement["covariance"]["xt"] == 0.0) == bool(unknown)


def test_two_axes_that_are_both_bad_are_both_known() -> None:
    scan, measurement = scans()[0], empty()
    scan["displacement_covariance"][:2, :2] = np.diag([0.02**2, 0.01**2])
    measure(scan, measurement)
    assert not np.isnan(measurement["covariance"]["variance"]).any()


def test_what_remains_of_a_contact_has_a_pose_only_where_it_is_ok_or_on_a_line() -> None:
    for quality, whole, partial in ((OK, True, True), (AMBIGUOUS, True, False), (LOST, False, False)):
        scan = scans(quality=quality)[0]
        assert (has_pose(scan, False), has_pose(scan, True)) == (whole, partial)
    scan = scans(quality=AMBIGUOUS)[0]
    scan["displacement_covariance"][1, 1] = 1.0
    assert has_pose(scan, True)
    scan["displacement"] = np.nan
    assert not has_pose(scan, False)


def raised(variances: list[float], covariance_xy: float = 0.0) -> list[Any]:
    mean, found = np.zeros(3), []
    for poses, variance in enumerate(variances, 1):
        covariance = records(Covariance, 1)[0]
        covariance["variance"], covariance["xy"] = [variance, 1.0, np.nan], covariance_xy
        raise_to_mean(poses, mean, covariance)
        found.append(covariance)
    return found


@given(variances=st.lists(st.floats(0.1, 10), min_size=1, max_size=40))
def test_a_covariance_is_raised_to_the_mean_and_never_lowered(variances: list[float]) -> None:
    found = raised(variances)
    assert all(one["variance"][0] >= own * (1 - 1e-12) for one, own in zip(found, variances, strict=True))
    assert all(one["variance"][0] <= max(variances) * (1 + 1e-12) for one in found)
    assert all(one["variance"][1] == 1.0 and np.isnan(one["variance"][2]) for one in found)


def test_a_mean_is_over_twenty_poses_and_an_outlier_counts_four_times_at_most() -> None:
    assert [one["variance"][0] for one in raised([4.0, 1.0])] == pytest.approx([4.0, 2.5])
    last = raised([1.0] * 50 + [1000.0, 1.0], 0.5)[-1]
    assert last["variance"][0] == pytest.approx(1.0 + 0.05 * 3.0 - 0.05 * 0.15)
    assert last["xy"] == pytest.approx(0.5 * np.sqrt(last["variance"][0]))


def test_parameters_of_the_kernels_are_those_of_the_monitor() -> None:
    held = parameter_records(alarms_per_hour=7200.0, creep_m_s=1.0, load_m=2.0, settle_s=3.0)
    assert held.tolist() == [(0.5, 2.0, 1.0, 3.0)]
