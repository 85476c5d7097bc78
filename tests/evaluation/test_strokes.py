from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigged import rigged
from taxelflow.evaluation.strokes import (
    TABLE1,
    Seen,
    Stroke,
    bounds,
    cut,
    passes,
    rms_of,
    rows_of,
    slope,
    strokes_by,
    trial,
    ungrouped,
)
from taxelflow.pipeline.api import conditioned
from taxelflow.simulation.simulate import simulate


@given(speed=st.floats(-50, 50), start=st.floats(-100, 100), seed=st.integers(0, 100))
def test_a_straight_way_has_its_speed_whatever_the_weights_and_pieces(speed: float, start: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    t_s = np.sort(random.uniform(0, 5, 20))
    piece = np.sort(random.integers(0, 4, 20))
    x = start + speed * t_s + 7.0 * piece
    used, weight = np.ones(20, dtype=np.bool_), random.uniform(0.1, 2, 20)
    assert slope(t_s, x, used, weight, piece) == pytest.approx(speed, abs=1e-6)


def test_it_is_the_regression_line_of_the_used_positions() -> None:
    random = np.random.default_rng(0)
    t_s, x, used = np.arange(30.0), random.normal(size=30), random.uniform(size=30) > 0.3
    x[~used] = np.nan
    assert slope(t_s, x, used) == pytest.approx(np.polyfit(t_s[used], x[used], 1)[0])
    weight = random.uniform(0.5, 3, 30)
    fitted = np.polyfit(t_s[used], x[used], 1, w=np.sqrt(weight[used]))[0]
    assert slope(t_s, x, used, weight) == pytest.approx(fitted)


def test_fewer_than_three_positions_or_pieces_of_one_have_no_slope() -> None:
    t_s, x, none = np.arange(5.0), np.arange(5.0), np.zeros(5, dtype=np.bool_)
    assert np.isnan(slope(t_s, x, none))
    assert np.isnan(slope(t_s, x, np.array([1, 1, 0, 0, 0], dtype=np.bool_)))
    assert np.isnan(slope(t_s, x, ~none, piece=np.arange(5)))


def test_the_standard_errors_of_a_row_are_how_its_rmse_and_factor_scatter() -> None:
    random = np.random.default_rng(0)
    found = []
    for _ in range(200):
        seen: Seen = {}
        for what, speed in (("fit", 25), *((speed, speed) for speed in TABLE1.speeds_mm_s)):
            drawn = random.normal(0.95 * speed, 0.04 * speed, 40)
            seen[what, "flow"] = [
                Stroke(number % 2 == 0, *2 * [-one if number % 2 == 0 else one])
                for number, one in enumerate(drawn.tolist())
            ]
        found.append(rows_of(seen, ("flow",)))
    for rows in zip(*found, strict=True):
        claimed = np.sqrt(np.mean([row.standard_error_percent**2 for row in rows]))
        assert claimed == pytest.approx(np.std([row.rmse_percent for row in rows]), rel=0.2)
        if rows[0].factor != 1.0:
            claimed = np.sqrt(np.mean([row.factor_standard_error**2 for row in rows]))
            assert claimed == pytest.approx(np.std([row.factor for row in rows]), rel=0.2)


def test_every_stroke_is_cut_in_its_order() -> None:
    truth = simulate(rigged("stroke", motion={"strokes": 5})).known_truth
    assert [backward for backward, _ in passes(truth)] == [True, False, True, False, True]
    found = list(cut(truth, truth.pose[:, 0]))
    assert [stroke.all for stroke in found] == pytest.approx([-25.0, 25.0, -25.0, 25.0, -25.0], rel=0.01)
    assert not np.any(np.sum([own for _, own in passes(truth)], axis=0) > 1)


def test_an_object_at_rest_makes_no_stroke() -> None:
    assert passes(simulate(rigged("roll")).known_truth) == []


def test_the_bound_of_a_slope_is_what_positions_at_their_bound_scatter_by() -> None:
    scenario = trial(0, 25)
    truth = simulate(scenario).known_truth
    random = np.random.default_rng(0)
    found = bounds(scenario, truth)
    assert [stroke.backward for stroke in found] == [True, False]
    inside = np.flatnonzero(passes(truth)[0][1] & (np.abs(truth.pose[:, 0]) < 0.03))
    weight = np.zeros(len(truth.t_s))
    weight[inside] = 1 / 0.06**2
    drawn = [slope(truth.t_s, 0.06 * random.standard_normal(len(weight)), weight > 0, weight) for _ in range(1000)]
    assert found[0].all == pytest.approx(np.std(drawn), rel=0.6)  # edges tell some more, the middle is not even
    assert found[0].all < found[0].interior


def test_errors_of_one_object_count_as_one() -> None:
    random = np.random.default_rng(0)
    single = [np.array([error]) for error in random.standard_normal(400)]
    rms, own = rms_of(single)
    assert own is not None
    assert (rms, own) == pytest.approx((1.0, 1 / np.sqrt(2 * 400)), rel=0.15)
    again = rms_of([np.repeat(error, 5) for error in single])
    assert again == pytest.approx((rms, own))
    assert rms_of([np.ones(3)]) == (1.0, None)
    assert rms_of([np.zeros(3)] * 2) == (0.0, None)


@pytest.mark.long
def test_without_groups_the_pads_are_estimated_as_with_them() -> None:
    recording = simulate(trial(0, 25))
    bare = ungrouped(recording)
    assert len(bare.layout.pads) == bare.layout.pad_count < len(recording.layout.pads)
    for method in ("convolution", "principal_axis"):
        both = [strokes_by(method, each, conditioned(each)) for each in (recording, bare)]
        for one, two in zip(*both, strict=True):
            assert (one.all, one.interior) == pytest.approx((two.all, two.interior), rel=1e-12)
