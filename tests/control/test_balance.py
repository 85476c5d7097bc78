from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taxelflow.control.base import Touch
from taxelflow.control.hold import Hold

DT_S, MOST_N = 0.01, 40.0
UNKNOWN = np.full((2, 3), np.nan)


def touch(scan: int, down_m_s: float) -> Touch:
    """Both pads of a grip of 5 N have this velocity."""
    velocity, noise = np.tile([0.0, -down_m_s, 0.0], (2, 1)), np.tile(np.diag([0.002, 0.002, 0.05]) ** 2, (2, 1, 1))
    silent, axes, pressure = np.zeros(2, dtype=bool), np.tile(np.eye(2), (2, 1, 1)), np.full((2, 4), 1e4)
    detail_m, place_m = np.full(2, 0.002), np.zeros((2, 2))
    return Touch(scan * DT_S, DT_S, pressure, 5.0, silent, velocity, axes, noise, detail_m, place_m)


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
