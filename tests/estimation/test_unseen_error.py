"""Poses of methods without a model of the skin, on taxels whose gains differ, are as good as they state."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import assert_same, dome, grid_sensor, recorded, scans_of
from taxelflow.estimation.unseen_error import UnseenError
from taxelflow.messages import Floats, cut
from taxelflow.pipeline import api

FAULTY, FAULTLESS = (grid_sensor(12, 16, pitch_m=(0.003, 0.003), unseen_error=error) for error in (0.05, 0.0))
METHODS = ("lnorm", "convolution", "principal_axis", "registration")
X_M = np.concatenate([np.full(20, -0.006), np.linspace(-0.006, 0.006, 80), np.full(20, 0.006)])


def slide(seed: int) -> Floats:
    """(scans, taxels), a dome that slides by four pitches over taxels whose gains scatter by 10 %, after idle scans."""
    random = np.random.default_rng(seed)
    touched = np.array([dome(FAULTY, x, radius_m=0.005) for x in X_M])
    values = np.concatenate([np.zeros((40, touched.shape[1])), touched * random.normal(1, 0.1, touched.shape[1])])
    return values + random.normal(0, 100, values.shape)


def nees(method: str, seed: int, unseen_error: float) -> float:
    sensor = FAULTY if unseen_error else FAULTLESS
    slips = api.estimate(recorded(slide(seed), sensor, np.arange(40 + len(X_M)) / 50.0), method).slips
    touched = slips.contact[:, 0] & np.isfinite(slips.pose[:, 0, 0])
    true = np.interp(slips.t_s - slips.lag_s[:, 0], (40 + np.arange(len(X_M))) / 50.0, X_M)[touched]
    error = slips.pose[touched, 0, 0] - true
    error -= error.mean()
    return float(np.mean(error**2 / slips.covariance[touched, 0, 0, 0]))


@pytest.mark.parametrize("method", METHODS)
def test_the_covariance_holds_gains_that_differ_where_the_sensor_declares_them(method: str) -> None:
    declared, undeclared = (np.mean([nees(method, seed, error) for seed in range(4)]) for error in (0.05, 0.0))
    assert declared < 1.2
    assert declared < undeclared


def test_centroids_that_know_noise_only_are_far_off_what_they_state() -> None:
    assert nees("convolution", 0, 0.0) > 3.0


def test_unseen_errors_change_poses_beside_a_rest_their_covariance_and_the_quality_of_what_forms_only() -> None:
    values, t_s = slide(0), np.arange(40 + len(X_M)) / 50.0
    faulty, faultless = (api.estimate(recorded(values, one, t_s), "convolution").slips for one in (FAULTY, FAULTLESS))
    same = {"pose": faultless.pose, "covariance": faultless.covariance, "quality": faultless.quality}
    assert_same(replace(faulty, **same), faultless)
    formed = np.flatnonzero(faulty.contact[:, 0])[0] + 5  # 0.1 s later
    assert (faulty.quality[formed:] == faultless.quality[formed:]).all()
    touched = faulty.contact[:, 0] & np.isfinite(faulty.pose[:, 0, 0])
    assert (faulty.covariance[touched, 0, 0, 0] > faultless.covariance[touched, 0, 0, 0]).all()
    assert faulty.unseen is None


@given(cuts=st.lists(st.integers(0, 10), max_size=3))
def test_each_scan_is_judged_by_itself(cuts: list[int]) -> None:
    scans = scans_of(FAULTY, np.array([dome(FAULTY, 1e-3 * k) for k in range(10)]))
    unseen, edges = UnseenError(FAULTY.layout), [0, *sorted(cuts), 10]
    parts = [unseen.of(cut(scans, start, stop)) for start, stop in itertools.pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), unseen.of(scans))


def test_without_contact_there_is_none() -> None:
    scans = scans_of(FAULTY, np.array([dome(FAULTY)] * 2))
    found = UnseenError(FAULTY.layout).of(replace(scans, contact=np.array([[True], [False]])))
    assert found[0, 0, 0, 0] > 0
    assert not found[1].any()
    assert not found[..., 2, :].any()
