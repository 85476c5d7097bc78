from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigged import rigged
from taxelflow.messages import Floats, no_scans
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.simulate import simulate
from taxelflow.slip.cut_contact import (
    BorderLoss,
    Steps,
    Velocity,
    at_velocity,
    joined_steps,
    steady_velocity,
    within,
)
from taxelflow.slip.slip_fit import SlipMotion

SPEED, SPAN = 0.02, 0.1


def steps(loss: Floats, speeds: Floats | None = None, *, cut: bool = True, judged: bool = False) -> Steps:
    """Motion along x, of which the centroid follows what the border does not hide. loss: (scans,), of x along x."""
    count = len(loss)
    followed = (np.full(count, SPEED) if speeds is None else speeds) * (1.0 - loss)
    matrix = np.zeros((count, 2, 2))
    matrix[:, 0, 0] = loss
    moved = np.stack([followed * SPAN, np.zeros(count)], axis=1)
    flags = np.full(count, cut), np.full(count, judged)
    return Steps(moved, np.full((count, 2), 1e-10), matrix, np.full(count, SPAN), *flags)


def test_scans_count_by_what_the_border_hides() -> None:
    loss = np.array([0.7, 0.4, 0.1, 0.0, 0.0, 0.1, 0.4, 0.7])
    found = steady_velocity(steps(loss))
    assert found is not None
    assert found.x == pytest.approx(SPEED, rel=0.01)
    assert np.mean(1.0 - loss) < 0.8
    assert abs(found.x - SPEED) < found.std_m_s


def test_the_standard_deviation_is_what_is_hidden_if_all_scans_are_cut_alike() -> None:
    found = steady_velocity(steps(np.full(200, 0.4)))
    assert found is not None
    assert found.std_m_s == pytest.approx(0.4 * found.x, rel=0.05)


@pytest.mark.parametrize("changes", [{"cut": False}, {"judged": True}])
def test_other_slips_keep_their_fit(changes: dict[str, bool]) -> None:
    assert steady_velocity(steps(np.full(9, 0.1), **changes)) is None


def test_a_slip_that_changes_its_speed_keeps_its_fit() -> None:
    assert steady_velocity(steps(np.zeros(20), np.repeat([0.01, 0.03], 10))) is None
    assert steady_velocity(None) is None
    assert steady_velocity(steps(np.zeros(2))) is None


@pytest.mark.parametrize("size", [1, 7, 40, 100])
def test_a_long_slip_holds_all_scans_in_bounded_memory_whatever_the_blocks(size: int) -> None:
    loss = np.repeat([0.3, 0.0], [60, 40])
    whole, held = steps(loss), None
    whole.moved[5], whole.span_s[71] = np.nan, np.nan
    for start in range(0, len(loss), size):
        new = Steps(*(array[start : start + size] for array in whole))
        held = within(new if held is None else joined_steps([held, new]), 16)
    assert held is not None
    assert len(held.span_s) < 16
    for one, other in zip(held, within(whole, 16), strict=True):
        np.testing.assert_array_equal(one, other)
    assert held.span_s.sum() == pytest.approx(98 * SPAN)
    found, each = steady_velocity(held), steady_velocity(whole)
    assert found is not None
    assert each is not None
    assert found.x == pytest.approx(each.x, rel=0.02)


def test_a_fit_within_the_standard_deviation_stays_and_gets_it() -> None:
    fitted = SlipMotion(0.012, 0.012, 0.0, np.nan, 1.0, 1e-4, 1e-4, np.nan, 0.05)
    wide = at_velocity(fitted, Velocity(0.013, 0.0, 0.004))
    assert (wide.speed_m_s, wide.path_m, wide.std_speed_m_s) == (0.012, 0.012, 0.004)
    other = at_velocity(fitted, Velocity(0.0, -0.02, 0.004))
    assert (other.speed_m_s, other.path_m, other.direction_rad) == (0.02, 0.02, -np.pi / 2)
    assert other.std_path_m > other.std_speed_m_s == 0.004


def test_the_loss_is_that_of_the_centroid_of_a_pattern_that_moves_over_the_border() -> None:
    layout = load_sensor("grid-16x16").layout
    pitch_m = layout.pitch_m[0, 0]
    step = 0.01 * pitch_m

    def pressed(middle: float) -> tuple[Floats, float]:
        """A wide dome, near the right border, and its centroid."""
        square = (layout.x_m - middle) ** 2 + (layout.y_m - layout.y_m.mean()) ** 2
        pressure = 1e4 * np.exp(-0.5 * square / (4.0 * pitch_m) ** 2)
        return pressure, float(pressure @ layout.x_m / pressure.sum())

    middle = float(layout.x_m.max()) - 4.0 * pitch_m
    pressure, centroid = pressed(middle)
    followed = (pressed(middle + step)[1] - centroid) / step
    scans = replace(no_scans(layout.entries, len(layout.pads), 1), pressure=pressure[np.newaxis])
    loss = BorderLoss(layout).of(scans)[0, 0]
    assert followed < 0.8
    assert 1.0 - followed < loss[0, 0] < 1.2 * (1.0 - followed)  # taxels read half a pitch inside of the border
    assert loss[0, 1] < 0.3 * loss[0, 0]


@pytest.mark.parametrize("seed", [31, 32])
def test_a_cut_contact_gives_the_slips_of_the_truth_by_a_centroid(seed: int) -> None:
    result = api.estimate(simulate(replace(rigged("stroke"), seed=seed)), "convolution")
    slips = [event for event in result.events if event.pad == "palm" and event.event == "slip_stop"]
    assert len(slips) == 2
    for slip in slips:
        assert slip.speed_m_s == pytest.approx(0.025, rel=0.05)
        assert abs(slip.speed_m_s - 0.025) < 2 * slip.std_speed_m_s
