from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.slip.slip_fit import fit_slip, integrate_slip

STD_M, STD_RAD, RATE_HZ = 1e-4, 2e-3, 30.0


def fitted(
    velocity: Floats, *, seed: int = 0, std_m: float = STD_M, turns: bool = True
) -> tuple[Floats, Floats, Floats]:
    """Times, noisy poses and covariances of an object with a velocity per scan (scans, 3)."""
    t = np.arange(len(velocity)) / RATE_HZ
    pose = np.cumsum(velocity, axis=0) / RATE_HZ
    std = np.array([std_m, std_m, STD_RAD if turns else np.nan])
    pose = pose + np.random.default_rng(seed).normal(0.0, 1.0, pose.shape) * std
    return t, pose, np.tile(np.diag(std**2), (len(t), 1, 1))


def constant(scans: int, *velocity: float) -> Floats:
    return np.tile(velocity, (scans, 1))


@pytest.mark.long
@given(st.floats(0.005, 0.2), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.integers(8, 60), st.integers(0, 10**6))
def test_a_constant_velocity_is_found_within_its_standard_deviations(
    speed: float, direction: float, rate: float, scans: int, seed: int
) -> None:
    velocity = constant(scans, speed * np.cos(direction), speed * np.sin(direction), rate)
    t, pose, covariance = fitted(velocity, seed=seed)
    found = fit_slip(t, pose, covariance, t[0], t[-1])
    assert abs(found.speed_m_s - speed) < 6 * found.std_speed_m_s
    assert abs(found.turn_rad - rate * t[-1]) < 6 * found.std_turn_rad
    assert found.path_m == pytest.approx(found.speed_m_s * found.duration_s)
    assert found.duration_s == pytest.approx(t[-1])
    assert abs(np.angle(np.exp(1j * (found.direction_rad - direction)))) < 6 * STD_M / found.path_m


@pytest.mark.parametrize(("scans", "turning"), [(20, 0.3), (20, 3.0), (8, 3.0)])
def test_the_standard_deviations_are_those_of_many_slips(scans: int, turning: float) -> None:
    """Each slip begins and ends somewhere between scans, each of its dates is found somewhere between them as well."""
    random, velocity = np.random.default_rng(1), np.array([0.02, 0.01, turning])
    duration_s = scans / RATE_HZ
    right = [np.hypot(*velocity[:2]), np.hypot(*velocity[:2]) * duration_s, turning * duration_s, duration_s]
    error, claimed = [], []
    for seed in range(200):
        t, noise, covariance = fitted(constant(scans + 2, 0.0, 0.0, 0.0), seed=seed)
        t = t - random.uniform(0.0, 1.0) / RATE_HZ
        pose = noise + np.clip(t, 0.0, duration_s)[:, np.newaxis] * velocity
        start_s, end_s = np.array([0.0, duration_s]) + random.uniform(-0.5, 0.5, 2) / RATE_HZ
        own = (t >= start_s) & (t <= end_s)
        one = fit_slip(t[own], pose[own], covariance[own], start_s, end_s)
        error.append(np.array([one.speed_m_s, one.path_m, one.turn_rad, one.duration_s]) - right)
        claimed.append([one.std_speed_m_s, one.std_path_m, one.std_turn_rad, one.std_duration_s])
    share = np.sqrt(np.mean(np.square(error), axis=0) / np.mean(np.square(claimed), axis=0))
    assert (share > 0.6).all()
    assert (share < 1.2).all()


def test_an_object_that_turns_round_has_the_length_of_its_path() -> None:
    velocity = np.concatenate([constant(30, 0.03, 0.0, 0.0), constant(30, -0.03, 0.0, 0.0)])
    t, pose, covariance = fitted(velocity)
    found = fit_slip(t, pose, covariance, t[0], t[-1])
    assert found.path_m == pytest.approx(0.03 * t[-1], rel=0.03)
    assert found.speed_m_s == pytest.approx(0.03, rel=0.03)


def test_an_object_that_goes_round_a_circle_has_the_length_of_its_path() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 120)
    velocity = 0.04 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    t, pose, covariance = fitted(velocity)
    assert fit_slip(t, pose, covariance, t[0], t[-1]).path_m == pytest.approx(0.04 * t[-1], rel=0.03)


def test_noise_alone_makes_no_path_longer() -> None:
    """The sum of displacements would be 21 mm."""
    t, pose, covariance = fitted(constant(100, 0.003, 0.0, 0.0))
    assert fit_slip(t, pose, covariance, t[0], t[-1]).path_m == pytest.approx(0.003 * t[-1], rel=0.05)
    assert np.hypot(*np.diff(pose[:, :2], axis=0).T).sum() > 0.02


def test_scans_count_by_their_covariance() -> None:
    t, pose, covariance = fitted(constant(30, 0.02, 0.0, 0.0))
    pose, covariance = pose.copy(), covariance.copy()
    pose[::5, 0] += 0.01
    covariance[::5] *= 1e6
    assert fit_slip(t, pose, covariance, t[0], t[-1]).speed_m_s == pytest.approx(0.02, rel=0.02)


def test_an_axis_that_is_not_observable_adds_no_path() -> None:
    t, pose, covariance = fitted(constant(30, 0.02, 0.0, 0.0), turns=False)
    pose, covariance = pose.copy(), covariance.copy()
    pose[:, 1] = np.random.default_rng(1).normal(0, 0.02, 30)
    covariance[:, 1, 1] = 0.02**2
    found = fit_slip(t, pose, covariance, t[0], t[-1])
    assert found.speed_m_s == pytest.approx(0.02, rel=0.02)
    assert (found.direction_rad, np.isnan(found.turn_rad)) == (0.0, True)


def test_residuals_above_the_noise_widen_the_standard_deviations() -> None:
    t, pose, covariance = fitted(constant(30, 0.02, 0.0, 0.0))
    fair = fit_slip(t, pose, covariance, t[0], t[-1])
    bold = fit_slip(t, pose, covariance / 100, t[0], t[-1])
    assert bold.std_speed_m_s > 0.5 * fair.std_speed_m_s


def test_residuals_that_are_alike_from_scan_to_scan_count_as_few() -> None:
    """The variance grows by (1 + r) / (1 - r), r being the autocorrelation: here 0.86, and 0.997 counted as 0.95."""
    t, _, covariance = fitted(constant(120, 0.0, 0.0, 0.0))
    line, phase = t[:, np.newaxis] * [0.02, 0.01, 0.3], 2 * np.pi * np.arange(120)
    std = 0.3 * np.array([STD_M, STD_M, STD_RAD])
    alternating, short, long = (
        fit_slip(t, line + std * wave[:, np.newaxis], covariance, t[0], t[-1])
        for wave in (np.cos(phase / 2), np.sin(phase / 12), np.sin(phase / 119))
    )
    inflation = [(one.std_speed_m_s / alternating.std_speed_m_s) ** 2 for one in (short, long)]
    assert inflation == pytest.approx([1.86 / 0.14, 1.95 / 0.05], rel=0.1)


def test_displacements_are_summed() -> None:
    steps = np.array([[0.01, 0.0, np.nan], [np.nan, np.nan, np.nan], [0.01, 0.0, np.nan]])
    found = integrate_slip(steps, np.tile(np.eye(3) * 1e-6, (3, 1, 1)), 1.0, 1.5, 0.2)
    assert (found.path_m, found.speed_m_s, found.direction_rad) == pytest.approx((0.02, 0.04, 0.0))
    assert found.std_path_m == pytest.approx(np.sqrt(2) * 1e-3)
    assert np.isnan(found.turn_rad)


def test_a_direction_that_is_certain_to_rounding_has_a_standard_deviation_of_0() -> None:
    """As of the L norm, whose maximum moves from taxel to taxel, uncertain along one diagonal."""
    for angle in np.linspace(0.0, np.pi, 100):
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        steps, covariance = np.full((3, 3), np.nan), np.full((3, 3, 3), np.nan)
        steps[:, :2], covariance[:, :2, :2] = 1e-3 * along, 1e-6 * np.outer(across, across)
        found = integrate_slip(steps, covariance, 0.0, 0.06, 0.03)
        assert found.std_path_m == pytest.approx(0.0, abs=1e-9)


def test_without_a_displacement_only_the_duration_is_known() -> None:
    found = integrate_slip(np.full((3, 3), np.nan), np.full((3, 3, 3), np.nan), 1.0, 1.5, 0.2)
    assert found.duration_s == 0.5
    assert np.isnan([found.path_m, found.speed_m_s, found.std_path_m]).all()


def test_a_slip_shorter_than_a_scan_has_the_mean_speed_of_its_scan() -> None:
    """A method in whole pitches dates begin and end of a step nearly alike: 7 m/s, of a step between slow scans."""
    steps = np.array([[0.0, 0.0, np.nan], [0.0034, 0.0, np.nan]])
    found = integrate_slip(steps, np.tile(np.eye(3) * 1e-6, (2, 1, 1)), 1.0, 1.0005, 0.14)
    assert (found.duration_s, found.path_m, found.speed_m_s) == pytest.approx((0.14, 0.0034, 0.0034 / 0.14))
    assert found.std_duration_s == pytest.approx(0.14 / np.sqrt(6))
