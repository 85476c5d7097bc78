from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taxelflow.control.balance import Balance
from taxelflow.control.base import Touch
from taxelflow.control.hold import Hold
from taxelflow.numerics.gravity import G_M_S2

DT_S, MOST_N = 0.01, 40.0
UNKNOWN = np.full((2, 3), np.nan)


def touch(scan: int, down_m_s: float) -> Touch:
    """Both pads of a grip of 5 N have this velocity."""
    velocity, noise = np.tile([0.0, -down_m_s, 0.0], (2, 1)), np.tile(np.diag([0.002, 0.002, 0.05]) ** 2, (2, 1, 1))
    silent, axes, pressure = np.zeros(2, dtype=bool), np.tile(np.eye(2), (2, 1, 1)), np.full((2, 4), 1e4)
    detail_m, place_m = np.full(2, 0.002), np.zeros((2, 2))
    return Touch(scan * DT_S, DT_S, pressure, 5.0, silent, velocity, axes, noise, detail_m, place_m)


def least_n(std_m_s: float, usual: float) -> float:
    """Of an object that speeds up by a quarter of gravity under 6 N."""
    balance = Balance(usual=usual)
    for scan in range(4):
        balance.add(scan * DT_S, G_M_S2 / 4 * scan * DT_S, 6.0, std_m_s**2)
    return balance.least_n()


@pytest.mark.parametrize(("std_m_s", "usual"), [(0.0, 2.0), (0.05, np.inf), (0.001, 2.0)])
def test_a_clear_acceleration_shows_the_least_force(std_m_s: float, usual: float) -> None:
    assert least_n(std_m_s, usual) == pytest.approx(8.0, rel=0.01)


def test_an_acceleration_counts_by_its_variance_and_that_of_the_object() -> None:
    std_m_s = 2.0 * DT_S * np.sqrt(5.0)  # of four speeds, whose slope then has a standard deviation of 2 m/s^2
    assert least_n(std_m_s, 2.0) == pytest.approx(6.0 / (1.0 - 0.125))
    assert least_n(1.0, 2.0) == pytest.approx(6.0, rel=0.01)


def test_scans_at_one_time_have_no_acceleration() -> None:
    balance = Balance()
    balance.add(1.0, 0.1, 5.0)
    balance.add(1.0, 0.3, 5.0)
    assert balance.least_n() == 5.0


@pytest.mark.parametrize("scans", [4, 300])
def test_a_contact_that_is_lost_in_a_slip_opens_no_grip(scans: int) -> None:
    """Its force of 0 carried the object, by the balance: the grip of 5 N that had slipped was opened to 0.4 N."""
    controller = Hold().start(5.0, MOST_N)
    for scan in range(36):
        controller.step(touch(scan, 0.02 * max(scan - 20, 0)))
    forces = []
    for scan in range(36, 336):
        now = touch(scan, 0.0)
        if scan < 36 + scans:
            now = replace(now, force_n=0.0, velocity=UNKNOWN, covariance=np.full((2, 3, 3), np.nan))
        forces.append(controller.step(now))
    assert min(forces) > 5.0
