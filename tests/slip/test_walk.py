"""Poses that are sums of steps with noise of their own, as of registration on a face without detail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compiled import compiled
from sliding import RATE_HZ, STD, kinds, noise, slips_of, watched
from taxelflow.messages import Floats, Slips
from taxelflow.numerics.records import records
from taxelflow.slip.walk import Walk
from taxelflow.slip.walk import begin_walk as _begin_walk
from taxelflow.slip.walk import learn_walk as _learn_walk

begin_walk, learn_walk = compiled(_begin_walk), compiled(_learn_walk)


def walking(share: float, scans: int, seed: int = 0, velocity_m_s: float = 0.0, begin: int = 0) -> Slips:
    """Poses with the noise STD that walk along x and y by its share per scan, as their covariances say, and slide."""
    random = np.random.default_rng(seed)
    q = share * STD**2 * [1.0, 1.0, 0.0]
    moved = np.clip(np.arange(scans) - begin, 0, None)[:, np.newaxis] / RATE_HZ * np.array([velocity_m_s, 0.0, 0.0])
    walk = np.cumsum(np.sqrt(q) * random.standard_normal((scans, 3)), axis=0)
    slips = slips_of(noise(scans, seed) + walk + moved)
    own = np.eye(3) * (2 * STD**2 + q)
    grown = np.eye(3) * (STD**2 + np.arange(scans)[:, np.newaxis, np.newaxis] * q)
    known = np.isfinite(slips.displacement_covariance)
    return replace(
        slips,
        displacement_covariance=np.where(known, own, np.nan),
        covariance=grown[:, np.newaxis] * np.ones((1, 1, 3, 3)),
    )


@pytest.mark.parametrize("share", [0.0, 0.1, 1.4])
def test_a_pose_that_walks_within_its_covariance_is_no_slip(share: float) -> None:
    """A minute at rest; without the walk in the rest filter it is more than twenty slips at a share of 1.4."""
    assert kinds(watched(walking(share, 6000))[1]) == ["contact"]


@pytest.mark.parametrize("share", [0.0, 0.1, 1.4])
def test_a_slip_of_a_pose_that_walks_is_found(share: float) -> None:
    flags, _, _ = watched(walking(share, 800, velocity_m_s=0.04, begin=700))
    assert not flags[:700].any()
    assert flags[700:710].any()


def test_a_scan_that_does_not_fit_hardly_changes_the_learned_growth() -> None:
    walk, usual = records(Walk, 1)[0], STD**2
    begin_walk(walk)
    for scan in range(400):
        learn_walk(np.diag((1.0 + 0.2 * scan) * STD**2), usual, 0.0, True, walk)
    np.testing.assert_allclose(walk["growth"], 0.2 * STD**2, rtol=0.01)
    learn_walk(np.diag(1e4 * STD**2), usual, 0.0, True, walk)
    assert (walk["growth"] < 1.07 * 0.2 * STD**2).all()


@pytest.mark.parametrize("log_load", [0.0, 3.0])
def test_the_growth_is_that_at_a_load_of_1(log_load: float) -> None:
    walk = records(Walk, 1)[0]
    begin_walk(walk)
    variance: Floats = STD**2 * np.exp(-2.0 * log_load)
    for scan in range(200):
        learn_walk(np.diag((1.0 + 0.2 * scan) * variance), variance, log_load, True, walk)
    np.testing.assert_allclose(walk["growth"], 0.2 * STD**2, rtol=0.1)
