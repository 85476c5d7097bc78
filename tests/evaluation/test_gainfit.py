from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taxelflow.acquire.trajectory import Trajectory
from taxelflow.errors import GainsUnknown
from taxelflow.evaluation import gainfit
from taxelflow.evaluation.gainfit import GainFit, Sightings, fit_gains
from taxelflow.messages import Floats
from taxelflow.numerics.geometry import inverse_transform

PITCH = np.array([0.01, 0.01])
GAIN = np.array([1.08, 0.94])
FRAME = np.array([0.4, -0.3, 2.2])
OFFSET_S = 0.37
NOISE_M = 2e-4


def zigzag(t_s: Floats) -> Floats:
    """Positions in the pad's frame: to and fro along a diagonal while a second diagonal is climbed slowly."""
    to_and_fro = 2 * np.abs((t_s / 4) % 2 - 1) - 1
    climb = 2 * np.abs((t_s / 15) % 2 - 1) - 1
    return 0.02 * np.stack([to_and_fro + climb, to_and_fro - climb], axis=1)


def line(t_s: Floats) -> Floats:
    return np.stack([0.03 * (2 * np.abs((t_s / 4) % 2 - 1) - 1), np.full(len(t_s), 0.003)], axis=1)


def made(way: Any = zigzag, *, seed: int = 0, averaged: bool = False, edge: Any = 0.0) -> tuple[Sightings, Trajectory]:
    """What a method of these gains would see of a way, and the robot's log of it, on another clock and in its frame."""
    random = np.random.default_rng(seed)
    t_s = np.arange(200) * 0.15
    noise = random.normal(0, NOISE_M, (201, 2))
    noise = (noise[1:] + noise[:-1]) / 2**0.5 if averaged else noise[1:]
    seen = Sightings(t_s, way(t_s) / GAIN + noise, np.full((200, 2), NOISE_M), np.broadcast_to(edge, (200, 2)) * 1.0)
    logged = np.arange(-2, 33, 0.02)
    return seen, Trajectory(logged + OFFSET_S, inverse_transform(FRAME, way(logged)))


def scores(fit: GainFit) -> Floats:
    return np.array(
        [
            *((fit.gain - GAIN) / fit.std),
            *((fit.T_pad_robot - FRAME) / fit.std_frame),
            (fit.offset_s - OFFSET_S) / fit.std_offset_s,
        ]
    )


def test_gains_frame_and_clock_come_out_together() -> None:
    fit = fit_gains(*made(), PITCH, 1.0)
    np.testing.assert_allclose(fit.gain, GAIN, atol=0.005)
    np.testing.assert_allclose(fit.T_pad_robot, FRAME, atol=0.003)
    assert fit.offset_s == pytest.approx(OFFSET_S, abs=0.01)
    assert fit.used.all()
    assert fit.note == ""


@pytest.mark.long
@pytest.mark.parametrize("averaged", [False, True], ids=["each scan by itself", "scans that share a centroid"])
def test_standard_errors_are_those_of_many_seeds(averaged: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        gainfit, "_SEARCH", replace(gainfit._SEARCH, starts=2)
    )  # any angle of the frame is the next test's
    drawn = np.array([scores(fit_gains(*made(seed=seed, averaged=averaged), PITCH, 1.0)) for seed in range(16)])
    spread = drawn.std(axis=0)
    assert (spread > 0.5).all(), spread
    assert (spread < 2.0).all(), spread
    assert (np.abs(drawn.mean(axis=0)) < 0.7).all()


@pytest.mark.long
@pytest.mark.parametrize("turn", [-3.0, -2.2, -1.0, 1.0, 3.0])
def test_the_robots_frame_may_be_turned_at_will(turn: float) -> None:
    seen, _ = made()
    frame = np.array([-0.2, 0.1, turn])
    t_s = np.arange(-2, 33, 0.02)
    fit = fit_gains(seen, Trajectory(t_s, inverse_transform(frame, zigzag(t_s))), PITCH, 1.0)
    np.testing.assert_allclose(fit.gain, GAIN, atol=0.005)
    assert fit.T_pad_robot[2] == pytest.approx(turn, abs=0.015)  # within +-pi


def test_a_way_along_one_axis_leaves_the_others_gain_assumed() -> None:
    fit = fit_gains(*made(line), PITCH, 1.0)
    assert fit.gain[0] == pytest.approx(GAIN[0], abs=3 * fit.std[0])
    assert fit.gain[1] == fit.gain[0]
    assert np.isnan(fit.std[1])
    assert "line" in fit.note


@pytest.mark.long
def test_an_axis_that_the_border_spoils_is_not_observed() -> None:
    fit = fit_gains(*made(edge=[0.0, 0.3]), PITCH, 1.0)
    assert fit.std[0] < 0.01
    assert np.isnan(fit.std[1])
    assert fit.gain[1] == fit.gain[0]
    assert "along y" in fit.note


@pytest.mark.long
def test_scans_at_the_edge_have_the_weight_that_was_given() -> None:
    seen, truth = made()
    cut = np.abs(zigzag(seen.t_s)[:, 0]) > 0.025
    bias = np.where(cut, -0.006 * np.sign(seen.place_m[:, 0]), 0.0)
    place = seen.place_m + np.stack([bias, 0 * bias], axis=1)
    edge = np.stack([np.where(cut, 0.012, 0.0), np.zeros(len(cut))], axis=1)
    trusted = fit_gains(Sightings(seen.t_s, place, seen.noise_m, 0 * edge), truth, PITCH, 1.0)
    told = fit_gains(Sightings(seen.t_s, place, seen.noise_m, edge), truth, PITCH, 1.0)
    assert abs(told.gain[0] - GAIN[0]) < 3 * told.std[0] < 0.05
    assert abs(trusted.gain[0] - GAIN[0]) > 3 * abs(told.gain[0] - GAIN[0])


@pytest.mark.long
def test_outliers_do_not_carry_the_fit() -> None:
    seen, truth = made()
    seen.place_m[::20] += 0.02
    np.testing.assert_allclose(fit_gains(seen, truth, PITCH, 1.0).gain, GAIN, atol=0.03)


def test_a_single_stroke_cannot_separate_time_from_place() -> None:
    def stroke(t_s: Floats) -> Floats:
        return np.stack([0.002 * t_s - 0.03, 0 * t_s], axis=1)

    fit = fit_gains(*made(stroke), PITCH, 1.0)
    assert fit.gain[0] == pytest.approx(GAIN[0], rel=0.01)
    assert fit.std_offset_s > 0.5
    assert "time offset" in fit.note


@pytest.mark.long
def test_a_search_of_zero_takes_the_clocks_as_one() -> None:
    seen, truth = made()
    fit = fit_gains(seen, Trajectory(truth.t_s - OFFSET_S, truth.place_m), PITCH, 0.0)
    assert abs(fit.offset_s) < 1e-6
    np.testing.assert_allclose(fit.gain, GAIN, atol=0.005)


def test_a_trajectory_in_mm_is_named_as_such() -> None:
    seen, truth = made()
    says = (
        r"the trajectory spans 1\d\.\d m, the positions on the pad 0\.0\d+ m \(standard deviations\); "
        "give the trajectory in m, and check that it is that of the object on this pad"
    )
    with pytest.raises(GainsUnknown, match=says):
        fit_gains(seen, Trajectory(truth.t_s, 1e3 * truth.place_m), PITCH, 1.0)


def test_gains_that_are_too_uncertain_are_in_words() -> None:
    seen, truth = made(edge=0.5)
    says = (
        r"^gains cannot be estimated: the gain along x is not observed, the gain along y would be 1\.\d+ ± \d+; "
        "let the object move further, away from the pad's border$"
    )
    with pytest.raises(GainsUnknown, match=says):
        fit_gains(seen, truth, PITCH, 1.0)


def test_what_cannot_be_known_is_an_error() -> None:
    seen, truth = made()
    with pytest.raises(GainsUnknown, match="mirror"):
        fit_gains(seen, Trajectory(truth.t_s, truth.place_m * [1, -1]), PITCH, 1.0)
    with pytest.raises(GainsUnknown, match="only 0 scans"):
        fit_gains(seen, Trajectory(truth.t_s + 100, truth.place_m), PITCH, 1.0)
    with pytest.raises(GainsUnknown, match="spans only"):
        fit_gains(seen, Trajectory(truth.t_s, 0 * truth.place_m), PITCH, 1.0)


def circling(t_s: Floats) -> Floats:
    """Not quite circles."""
    return 0.004 * np.stack([np.sin(1.95 * t_s), np.sin(1.45 * t_s + 0.4)], axis=1)


def watched(way: Any, *, noise_m: float, rate_hz: float, log_hz: float, log_noise_m: float, seed: int) -> GainFit:
    """The fit of 12 s of scans that see a way, on a pad with a pitch of 3 mm, and a robot's log with noise."""
    random = np.random.default_rng(seed)
    t_s = np.arange(0, 12, 1 / rate_hz)
    seen = way(t_s) / GAIN + random.normal(0, noise_m, (len(t_s), 2))
    known = np.full((len(t_s), 2), noise_m)
    logged = np.arange(-2, 14, 1 / log_hz)
    place = inverse_transform(FRAME, way(logged)) + random.normal(0, log_noise_m, (len(logged), 2))
    return fit_gains(Sightings(t_s, seen, known, 0 * known), Trajectory(logged + OFFSET_S, place), 0.3 * PITCH, 1.0)


@pytest.mark.long
def test_noise_of_the_robots_log_is_not_taken_for_the_slope_of_its_path() -> None:
    fits = [watched(circling, noise_m=8e-5, rate_hz=50, log_hz=200, log_noise_m=3e-4, seed=seed) for seed in range(12)]
    drawn = np.sqrt(np.mean([scores(fit) ** 2 for fit in fits], axis=0))
    assert (drawn > 0.4).all(), drawn
    assert (drawn < 1.5).all(), drawn
    assert np.mean([fit.offset_s for fit in fits]) == pytest.approx(OFFSET_S, abs=0.002)


@pytest.mark.long
def test_lines_between_the_samples_of_a_slow_log_do_not_lower_the_gains() -> None:
    fits = [watched(circling, noise_m=4e-5, rate_hz=50, log_hz=3, log_noise_m=0.0, seed=seed) for seed in range(4)]
    np.testing.assert_allclose(np.mean([fit.gain for fit in fits], axis=0), GAIN, rtol=0.005)


@pytest.mark.long
def test_precise_positions_are_fitted_to_the_end() -> None:
    for seed in range(4):
        fit = watched(circling, noise_m=1e-6, rate_hz=50, log_hz=200, log_noise_m=0.0, seed=seed)
        assert np.abs(scores(fit)).max() < 4
        assert fit.std.max() < 1e-3


def test_steps_at_the_taxels_leave_the_gain_of_a_short_way_uncertain() -> None:
    """The gain that the largest taxel of a short way gives is that of the way's place, however often it is gone."""

    def stepping(t_s: Floats) -> Floats:
        return 0.003 * GAIN * (np.floor(circling(t_s) / 0.003) + 0.5)

    random, t_s, logged = np.random.default_rng(0), np.arange(0, 30, 0.02), np.arange(-2, 33, 0.02)
    seen = stepping(t_s) / GAIN + random.normal(0, 1e-5, (len(t_s), 2))
    known = np.full(seen.shape, 0.003 / 12**0.5)
    truth = Trajectory(logged + OFFSET_S, inverse_transform(FRAME, circling(logged)))
    fit = fit_gains(Sightings(t_s, seen, known, 0 * known), truth, 0.3 * PITCH, 1.0)
    away = np.abs(fit.gain - 1.0)  # a step of one pitch a pitch is gain 1
    assert away.max() > 0.05
    assert (away < 2 * fit.std)[np.isfinite(fit.std)].all()
