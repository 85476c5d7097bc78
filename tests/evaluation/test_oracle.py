from __future__ import annotations

import numpy as np
import pytest

from taxelflow.evaluation.oracle import called
from taxelflow.messages import Bools, Floats

HOUR_S = 3600.0
RUNS = [(60, 90), (150, 170), (230, 260)]
T_S = np.arange(320) / 100


def moved(speed_m_s: float, *, first_step: float = 1.0) -> Floats:
    """Places (scans, 2) of an object that slips in RUNS; it has moved by first_step in the first scan of each."""
    way = sum(np.clip(np.arange(320) - begin + first_step, 0, end - begin) for begin, end in RUNS)
    return np.asarray(way)[:, np.newaxis] * [0.01 * speed_m_s, 0.0]


def truth() -> Bools:
    flags = np.zeros(320, dtype=np.bool_)
    for begin, end in RUNS:
        flags[begin:end] = True
    return flags


def f1(speed_m_s: float, sigma_m: float, alarm_s: float = HOUR_S, *, first_step: float = 1.0) -> float:
    covariance = np.broadcast_to(np.eye(2) * sigma_m**2, (320, 2, 2))
    seen = called(T_S, moved(speed_m_s, first_step=first_step), covariance, RUNS, alarm_s, 1)
    return float(2 * (seen & truth()).sum() / (seen.sum() + truth().sum()))


def test_without_noise_every_scan_that_has_moved_is_called() -> None:
    assert f1(0.01, 1e-8) == 1.0


def test_a_first_scan_that_has_not_moved_yet_cannot_be_called() -> None:
    # Each slip loses its first scan, and the first after it has moved: 160 scans, 6 of them wrong.
    assert f1(0.01, 1e-8, first_step=0.0) == pytest.approx(1 - 3 / 80, abs=0.02)


def test_noise_costs_scans_and_so_do_fewer_false_alarms() -> None:
    sharp, blurred = f1(0.01, 1e-5), f1(0.01, 4e-5)
    assert blurred < sharp
    assert f1(0.01, 4e-5, 1e4 * HOUR_S) < blurred


def test_what_moves_by_less_than_noise_in_all_its_time_is_missed() -> None:
    covariance = np.broadcast_to(np.eye(2) * 1e-2**2, (320, 2, 2))
    assert not called(T_S, moved(0.001), covariance, RUNS, HOUR_S, 0).any()


def test_the_direction_that_is_known_well_counts() -> None:
    seen = [
        called(T_S, moved(0.01), np.broadcast_to(np.diag(variance), (320, 2, 2)), RUNS, HOUR_S, 0)
        for variance in ((1e-10, 1e-4), (1e-4, 1e-10))
    ]
    assert (seen[0] & truth()).sum() > 70
    assert (seen[1] & truth()).sum() < 20
