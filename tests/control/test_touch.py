from __future__ import annotations

import numpy as np
import pytest

from taxelflow import Conditioner, Live
from taxelflow.control.base import Touch
from taxelflow.control.hold import Hold
from taxelflow.control.touch import Facing
from taxelflow.simulation.mujoco.gripper import sensor_of
from taxelflow.simulation.mujoco.skin import Skin

DT_S, SCANS, MOST_N = 0.01, 60, 40.0


def felt(stamps: np.ndarray, lost: tuple[int, ...] = (), dead: int | None = None) -> list[Touch]:
    """A round contact that slides down from scan 30 on at 50 mm/s, by a live loop. lost: scans without readings."""
    sensor = sensor_of(Skin(noise_pa=100.0))
    live = Live(sensor, "registration", condition=Conditioner(tare="none"))
    facing, random, layout = Facing(sensor), np.random.default_rng(0), sensor.layout
    touches = []
    for scan, t_s in enumerate(stamps):
        middle_m = -0.05 * DT_S * max(scan - 30, 0)
        image = 6e4 * np.exp(-0.5 * (layout.x_m[:256] ** 2 + (layout.y_m[:256] - middle_m) ** 2) / 0.003**2)
        readings = np.maximum((scan > 14) * np.stack([image, image]) + random.normal(0.0, 100.0, (2, 256)), 0.0)
        if dead is not None:
            readings[:, dead] = np.nan
        if scan in lost:
            readings[:] = np.nan
        touches.append(facing.touch(float(t_s), readings, live.step(float(t_s), readings.ravel())))
    return touches


@pytest.mark.parametrize("jump_s", [-1000.0, 1000.0, -DT_S])
def test_the_time_of_a_grip_goes_on_after_a_jump_of_the_clock(jump_s: float) -> None:
    """A clock set back by 1000 s once asked for a force below 0."""
    stamps = DT_S * np.arange(SCANS)
    stamps[40:] += jump_s
    touches, controller = felt(stamps), Hold().start(3.0, MOST_N)
    forces = [controller.step(touch) for touch in touches]
    assert min(touch.dt_s for touch in touches) >= 0.0
    assert (np.diff([touch.t_s for touch in touches]) >= 0.0).all()
    assert 2.9 < min(forces) <= max(forces) < MOST_N


def test_a_missing_reading_counts_as_the_last_one() -> None:
    """The force of a grip was no number then, and that of `hold` none from there on."""
    touches, controller = felt(DT_S * np.arange(SCANS), lost=(35, 36)), Hold().start(3.0, MOST_N)
    forces = [controller.step(touch) for touch in touches]
    assert touches[36].force_n == touches[35].force_n == touches[34].force_n > 1.0
    assert np.isfinite(forces).all()


def test_a_taxel_that_never_reads_bears_nothing() -> None:
    touches = felt(DT_S * np.arange(SCANS), dead=3)
    assert np.isfinite([touch.force_n for touch in touches]).all()
    assert touches[-1].pressure[0, 3] == 0.0
