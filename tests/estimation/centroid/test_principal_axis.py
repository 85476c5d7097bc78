from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from costly import mostly_long
from synthetic import assert_same, dome, grid_sensor, pieces, scans_of, slips_by
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.centroid.principal_axis import PrincipalAxis
from taxelflow.pipeline.api import estimate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats, Slips

PITCH = 0.0034
SIDE = 23
PAD = grid_sensor(SIDE, SIDE, pitch_m=(PITCH, PITCH))
TWO = grid_sensor(SIDE, SIDE, pads=2, pitch_m=(PITCH, PITCH))
TAXELS = SIDE**2


def bar(angle: float, x_m: float = 0.0, y_m: float = 0.0, *, long: float = 2.6, wide: float = 1.2) -> Floats:
    """One scan with an elongated Gaussian; long, wide: its standard deviations in pitches."""
    dx, dy = PAD.layout.x_m - x_m, PAD.layout.y_m - y_m
    along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
    pressure: Floats = 20e3 * np.exp(-((along / (long * PITCH)) ** 2 + (across / (wide * PITCH)) ** 2) / 2)
    return pressure


def seen(values: Any, *, bounds: dict[str, float] | None = None, **more: Any) -> Slips:
    return slips_by("principal_axis", PAD, scans_of(PAD, values, **{"noise": 1.0, **more}), **(bounds or {}))


@given(
    start=st.floats(-np.pi, np.pi),
    turns=st.lists(st.floats(-1.3, 1.3), min_size=2, max_size=12),
    place=st.tuples(*[st.floats(-0.003, 0.003)] * 2),
)
def test_a_turn_of_the_pattern_is_the_turn_of_theta(
    start: float, turns: list[float], place: tuple[float, float]
) -> None:
    angles = start + np.cumsum([0.0, *turns])
    slips = seen([bar(angle, *place) for angle in angles])
    np.testing.assert_allclose(slips.pose[:, 0, 2], angles - start, atol=2e-3)
    np.testing.assert_allclose(slips.displacement[1:, 0, 2], turns, atol=2e-3)
    np.testing.assert_allclose(slips.pose[:, 0, :2], [place] * len(angles), atol=2e-5)


@given(angle=st.floats(-np.pi, np.pi), quarters=st.integers(1, 3), seed=st.integers(0, 1000))
def test_a_quarter_turn_of_the_scans_turns_the_answer(angle: float, quarters: int, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, 30, (4, TAXELS))
    values = np.array([bar(angle + 0.1 * k, 0.002, 0.001 * k) for k in range(4)]) + noise
    turned = np.rot90(values.reshape(4, SIDE, SIDE), quarters, axes=(1, 2)).reshape(4, -1)
    one, other = seen(values, noise=30.0), seen(turned, noise=30.0)
    phi = quarters * np.pi / 2
    turn = np.array([[np.cos(phi), -np.sin(phi), 0], [np.sin(phi), np.cos(phi), 0], [0, 0, 1]])
    for part in ("pose", "displacement"):
        np.testing.assert_allclose(getattr(other, part)[:, 0], getattr(one, part)[:, 0] @ turn.T, atol=1e-10)
    for part in ("covariance", "displacement_covariance"):
        expected = turn @ getattr(one, part)[:, 0] @ turn.T
        np.testing.assert_allclose(getattr(other, part)[:, 0], expected, atol=1e-14)


@given(x=st.floats(-0.004, 0.004), y=st.floats(-0.004, 0.004), size=st.floats(1.0, 2.5), seed=st.integers(0, 2**32 - 1))
def test_a_round_contact_has_no_theta(x: float, y: float, size: float, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, 50, (6, TAXELS))
    slips = seen(bar(0.0, x, y, long=size, wide=size) + noise, noise=50.0)
    assert np.isnan(slips.pose[..., 2]).all()
    assert np.isnan(slips.displacement[..., 2]).all()
    assert np.isnan(slips.covariance[..., 2, :]).all()
    assert np.isfinite(slips.pose[..., :2]).all()
    assert np.isfinite(slips.displacement[1:, :, :2]).all()


def test_an_axis_less_sure_than_the_bound_is_silent() -> None:
    values = [bar(0.3)] * 3
    sure, unsure = (seen(values, noise=noise) for noise in (10.0, 5000.0))
    assert np.isfinite(sure.pose[..., 2]).all()
    assert np.isnan(unsure.pose[..., 2]).all()


@given(patch=st.integers(0, 2**32 - 1), scale=st.floats(1e-3, 1e3))
def test_the_scale_of_pressure_changes_nothing(patch: int, scale: float) -> None:
    values = np.random.default_rng(patch).random((5, TAXELS)) * bar(0.4)
    one, other = seen(values, noise=2.0), seen(scale * values, noise=scale * 2.0)
    for part in ("pose", "displacement", "covariance", "displacement_covariance"):
        np.testing.assert_allclose(getattr(other, part), getattr(one, part), atol=1e-9)


def test_the_predicted_covariance_is_that_of_noisy_scans() -> None:
    draws = 6000
    random = np.random.default_rng(7)
    sigma = np.linspace(10, 60, TAXELS)
    still = bar(0.5, 0.003, -0.002)
    noisy = seen(still + random.normal(0, 1, (draws, TAXELS)) * sigma, noise=sigma)
    exact = seen([still] * 3, noise=sigma)
    steps = noisy.displacement[1::2, 0]  # every other one shares no scan
    predicted = exact.displacement_covariance[2, 0]
    np.testing.assert_allclose(steps.std(axis=0), np.sqrt(np.diag(predicted)), rtol=0.1)
    drawn = np.cov(steps.T)
    scale = np.sqrt(np.outer(np.diag(predicted), np.diag(predicted)))
    np.testing.assert_allclose(drawn / scale, predicted / scale, atol=0.08)
    np.testing.assert_allclose(2 * exact.covariance[2, 0, :2, :2], predicted[:2, :2], rtol=1e-9)
    assert exact.covariance[2, 0, 2, 2] == pytest.approx(predicted[2, 2])  # theta is a difference to the first scan's


def test_theta_starts_at_0_and_again_after_lift_off() -> None:
    angles = np.array([0.4, 0.6, 0.8, 0.0, 1.9, 2.0])
    contact = np.array([True, True, True, False, True, True])
    slips = seen([bar(angle) for angle in angles], contact=contact)
    np.testing.assert_allclose(slips.pose[contact, 0, 2], [0.0, 0.2, 0.4, 0.0, 0.1], atol=2e-3)
    assert slips.valid[:, 0].tolist() == [False, True, True, False, False, True]
    assert (slips.covariance[[0, 4], 0, 2, 2] == 0).all()
    assert (slips.lag_s[contact] == 0).all()


def test_a_missing_taxel_interrupts_the_displacement_and_not_the_turn() -> None:
    complete = [True, True, False, True, True]
    slips = seen([bar(angle) for angle in (0.4, 0.6, 0.8, 1.0, 1.2)], complete=complete)
    np.testing.assert_allclose(slips.pose[[0, 1, 3, 4], 0, 2], [0, 0.2, 0.6, 0.8], atol=2e-3)
    assert np.isnan(slips.pose[2]).all()
    assert slips.valid[:, 0].tolist() == [False, True, False, False, True]


def test_the_turn_goes_on_after_a_round_moment() -> None:
    slips = seen([bar(0.1), bar(0.2), bar(0.0, long=1.5, wide=1.5), bar(0.4), bar(0.5)])
    np.testing.assert_allclose(slips.pose[[0, 1, 3, 4], 0, 2], [0, 0.1, 0.3, 0.4], atol=2e-3)
    assert np.isfinite(slips.displacement[:, 0, 2]).tolist() == [False, True, False, False, True]
    assert slips.valid[1:, 0].all()


@given(seed=st.integers(0, 2**32 - 1), cuts=st.lists(st.integers(0, 20), max_size=8))
def test_blocks_of_any_size_and_the_future_give_the_same_bits(seed: int, cuts: list[int]) -> None:
    random = np.random.default_rng(seed)
    angles = np.cumsum(random.normal(0, 0.3, 20))
    values = np.array(
        [np.concatenate([bar(a), dome(PAD, radius_m=0.004) + 1e3 * random.random(TAXELS)]) for a in angles]
    )
    scans = scans_of(
        TWO, values, noise=20.0, contact=random.random((20, 2)) < 0.9, complete=random.random((20, 2)) < 0.9
    )
    assert_same(slips_by("principal_axis", TWO, *pieces(scans, cuts)), slips_by("principal_axis", TWO, scans))


@pytest.mark.parametrize(("noise", "known"), [(0.95, True), (1.05, False)])
def test_an_axis_is_known_up_to_the_largest_standard_deviation(noise: float, known: bool) -> None:
    """It is proportional to the noise. Half of the variance of a turn is that of each axis."""
    free = {"sigmas": 0.0, "least_anisotropy": 0.0}
    turn_std = np.sqrt(seen([bar(0.3)] * 2, noise=10.0, bounds=free).displacement_covariance[1, 0, 2, 2])
    most = noise * 10.0 * 0.1 / (turn_std / np.sqrt(2))
    slips = seen([bar(0.3)] * 2, noise=most, bounds=free)
    assert (np.isfinite(slips.pose[..., 2]) == known).all()


@pytest.mark.parametrize(("ratio", "known"), [(0.95, False), (1.05, True)])
def test_an_axis_is_known_from_the_least_anisotropy_on(ratio: float, known: bool) -> None:
    """The second moments of a Gaussian are its squared standard deviations."""
    oblong = bar(0.3, long=2.0 * np.sqrt(1.0 + 0.05 * ratio), wide=2.0 * np.sqrt(1.0 - 0.05 * ratio))
    slips = seen([oblong] * 2)
    assert (np.isfinite(slips.pose[..., 2]) == known).all()


@pytest.mark.parametrize(("sigmas", "known"), [(5.5, True), (4.5, False)])
def test_an_axis_is_known_where_the_anisotropy_exceeds_its_noise_five_times(sigmas: float, known: bool) -> None:
    """The anisotropy's standard deviation is drawn from scans with other noise than that which bounds it."""
    random, noise = np.random.default_rng(0), 20.0
    x, y = PAD.layout.x_m, PAD.layout.y_m
    scans = bar(0.0) + random.normal(0, noise, (2000, TAXELS))
    load = scans.sum(axis=1)
    dx, dy = x - (scans @ x / load)[:, np.newaxis], y - (scans @ y / load)[:, np.newaxis]
    u, v = (scans * (dx**2 - dy**2)).sum(axis=1) / load, (scans * 2 * dx * dy).sum(axis=1) / load
    drawn = np.hypot(u, v)
    at = noise * drawn.mean() / drawn.std() / sigmas
    slips = seen([bar(0.0)] * 2, noise=at, bounds={"most_std_rad": 1e3, "least_anisotropy": 0.0})
    assert (np.isfinite(slips.pose[..., 2]) == known).all()


def test_one_loaded_taxel_has_a_place_within_half_a_pitch_and_no_axis() -> None:
    """What a reading of noise does half a pitch aside, as taxels that read 0 have none."""
    values = np.zeros((3, TAXELS))
    values[:, TAXELS // 2] = 1e4
    slips = seen(values)
    np.testing.assert_allclose(slips.pose[..., :2], 0, atol=1e-15)
    assert np.isnan(slips.pose[..., 2]).all()
    std = np.sqrt(slips.covariance[:, 0, [0, 1], [0, 1]])
    np.testing.assert_allclose(std, 0.5 * PITCH * 1.0 / 1e4)


def test_the_axis_of_two_loaded_taxels_turns_with_half_a_pitch_beside_one_of_them() -> None:
    values = np.zeros((2, TAXELS))
    values[:, [TAXELS // 2 - 2, TAXELS // 2 + 2]] = 5e3
    turn_variance = seen(values).displacement_covariance[1, 0, 2, 2]
    assert turn_variance == pytest.approx(2 * (0.5 * PITCH * 1.0 / 1e4) ** 2 / (2 * PITCH) ** 2)


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
def test_the_teapots_handle_turns_by_110_to_120_degrees(recordings: Path, mode: str) -> None:
    result = estimate(recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa", "principal_axis", mode=mode)  # type: ignore[arg-type]
    pad = result.pads.index("finger2_distal")
    held = result.slips.load[:, pad] > 0.2 * result.slips.load[:, pad].max()
    theta = np.degrees(result.slips.pose[held, pad, 2])
    assert np.isfinite(theta).all()
    assert 105 < np.median(theta[-5:]) - theta[0] < 125
    assert (np.sqrt(result.slips.covariance[held, pad, 2, 2]) < np.radians(3)).all()


@pytest.mark.parametrize(
    "parameters",
    [
        {"most_std_rad": 0.0},
        {"most_std_rad": float("nan")},
        {"sigmas": -1.0},
        {"sigmas": float("nan")},
        {"least_anisotropy": 1.0},
        {"least_anisotropy": -0.1},
    ],
    ids=str,
)
def test_bounds_that_cannot_work_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ParameterInvalid, match=next(iter(parameters))):
        PrincipalAxis(**parameters)
