from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taxelflow.control.agreement import Agreement
from taxelflow.control.base import Touch
from taxelflow.control.step_filter import StepFilter

DT_S, PLACE_M, SCANS = 0.01, 2e-4, 30
FACING = np.tile(np.eye(2), (2, 1, 1))
BOTH = np.ones(2, dtype=np.bool_)
NOISE = np.einsum("pq,ab->paqb", np.eye(2), 2.0 * (PLACE_M / DT_S) ** 2 * np.eye(2))
NO_MORE = np.zeros_like(NOISE)
LOADED = 10
"""Taxels of a pad that share its load."""


def touch(scan: int, velocity: np.ndarray, force_n: float, detail_m: float) -> Touch:
    covariance = np.tile(np.diag([0.005, 0.005, 0.05]) ** 2, (2, 1, 1))
    by_taxel_m2 = np.tile(detail_m**2 / LOADED * np.eye(2), (2, 1, 1))
    silent, felt, place = np.zeros(2, dtype=bool), np.full(2, detail_m), np.zeros((2, 2))
    seen = Touch(scan * DT_S, DT_S, np.zeros((2, 4)), force_n, silent, velocity, FACING, covariance, felt, place)
    return replace(seen, by_taxel_m2=by_taxel_m2)


def test_steps_of_a_steady_motion_give_the_line_through_the_places() -> None:
    """Not the mean of the steps, in which all places but the first and the last cancel."""
    places = np.random.default_rng(0).normal(0.0, PLACE_M, (SCANS + 1, 2, 2))
    places += 0.03 * DT_S * np.arange(SCANS + 1)[:, np.newaxis, np.newaxis]
    moves = StepFilter(2, 2)
    moves.predict(1e3, FACING)
    for step in np.diff(places, axis=0):
        moves.update(BOTH, step / DT_S, FACING, (NOISE, NO_MORE), DT_S)
    times = DT_S * np.arange(SCANS + 1)
    line = np.polyfit(times, places.mean(axis=1), 1)[0]
    np.testing.assert_allclose(moves.velocity, line, rtol=1e-4)
    expected = PLACE_M**2 / 2 / ((times - times.mean()) ** 2).sum()
    np.testing.assert_allclose(moves.covariance, expected * np.eye(2), rtol=1e-3, atol=1e-4 * expected)


def test_a_pad_that_missed_a_scan_begins_with_a_new_place() -> None:
    """Its next step is from a place whose noise no step before has shown."""
    moves, one = StepFilter(2, 2), np.array([True, False])
    moves.predict(1e3, FACING)
    for pads in (BOTH, one, BOTH):
        moves.update(pads, np.full((2, 2), 0.02), FACING, (NOISE, NO_MORE), DT_S)
    expected, covariance = moves.expected(FACING, DT_S)
    np.testing.assert_allclose(moves.velocity, 0.02, rtol=1e-6)
    np.testing.assert_allclose(expected, 0.02, rtol=1e-6)
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_an_object_moves_along_its_pads_and_not_into_them() -> None:
    """Pads of fingers are tilted by some degrees: noise along them would give any velocity along their normal."""
    tilt, random, moves = np.radians([3.0, -2.0]), np.random.default_rng(1), StepFilter(3, 2)
    axes = np.array([[[np.cos(a), np.sin(a), 0.0], [0.0, 0.0, 1.0]] for a in tilt])
    before, normal, along = random.normal(0.0, 2e-3, (2, 2)), [], []
    for _ in range(500):
        after = random.normal(0.0, 2e-3, (2, 2))
        moves.predict(0.02, axes)
        moves.update(BOTH, (after - before) / DT_S, axes, (100.0 * NOISE, NO_MORE), DT_S)
        before = after
        normal.append(moves.velocity[1])
        along.append(np.linalg.norm(moves.velocity[[0, 2]]))
    assert np.abs(normal).max() < np.median(along)


@pytest.mark.parametrize(("detail_m", "slips"), [(0.002, True), (0.05, False)])
def test_pads_of_little_detail_seem_to_move_as_the_load_grows(detail_m: float, slips: bool) -> None:
    """Along the edges of a case, pads read 0.1 m/s while the force grows by 10 % a scan."""
    both, velocity = Agreement().start(), np.tile([0.0, -0.1, 0.0], (2, 1))
    for scan in range(50):
        both.step(touch(scan, 0.0 * velocity, 3.0, detail_m))
    rising = [both.step(touch(50 + n, velocity, 3.0 * 1.1**n, detail_m)) for n in range(1, 5)]
    assert any(motion.slipping for motion in rising) is slips
