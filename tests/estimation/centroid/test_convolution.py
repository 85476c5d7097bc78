from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from costly import mostly_long
from synthetic import dome, grid_sensor, scans_of, slips_by
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.centroid.convolution import Convolution
from taxelflow.estimation.centroid.paper_reference import convolution_index, slip_vector
from taxelflow.estimation.completion import start_slips
from taxelflow.messages import Floats, Slips

PITCH = (0.01, 0.006)
PALM = grid_sensor(4, 7, pitch_m=PITCH)
TWO = grid_sensor(4, 7, pads=2)


def assert_literal(images: Floats) -> None:
    """Position and displacement are pitch / 2 times the paper's index and slip vector, y up against rows down."""
    scans, rows, cols = images.shape
    sensor = grid_sensor(rows, cols, pitch_m=PITCH)
    slips = slips_by("convolution", sensor, scans_of(sensor, images.reshape(scans, -1)))
    index = [convolution_index(images[k - 1], images[k]) for k in range(1, scans)]
    half = np.array([PITCH[0] / 2, -PITCH[1] / 2])
    np.testing.assert_allclose(slips.pose[1:, 0, :2] / half, index, rtol=0, atol=1e-12)
    slip = [slip_vector(*images[k - 2 : k + 1]) for k in range(2, scans)]
    np.testing.assert_allclose(slips.displacement[2:, 0, :2] / half, slip, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rows", mostly_long(range(1, 65), *range(1, 18), 32, 33))
def test_the_fast_form_is_the_literal_form(rows: int) -> None:
    random = np.random.default_rng(rows)
    short = range(1, 17) if rows <= 8 else random.integers(1, 17, 1).tolist()
    long = [] if rows % 4 else random.integers(17, 65, 1).tolist()
    for cols in (*short, 65 - rows, *long):
        assert_literal(random.random((4, rows, cols)))


@pytest.mark.parametrize("shape", [(33, 32), *mostly_long([((64, 64),), ((63, 64),), ((64, 63),), ((48, 64),)])])
def test_the_fast_form_is_the_literal_form_on_large_pads(shape: tuple[int, int]) -> None:
    assert_literal(np.random.default_rng(0).random((3, *shape)))


@given(
    shape=st.tuples(st.integers(1, 6), st.integers(1, 6)),
    seed=st.integers(0, 10_000),
    filled=st.floats(0.1, 1.0),
    size=st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_the_fast_form_is_the_literal_form_on_sparse_scans(
    shape: tuple[int, int], seed: int, filled: float, size: float
) -> None:
    random = np.random.default_rng(seed)
    images = random.random((4, *shape)) * (random.random((4, *shape)) < filled)
    images[:, 0, 0] += 0.01
    assert_literal(size * images)


def one_pad(*images: Floats, **more: object) -> Slips:
    return slips_by("convolution", PALM, scans_of(PALM, np.array(images), **more))  # type: ignore[arg-type]


def test_a_position_is_the_mean_of_two_centroids_half_a_step_late() -> None:
    first, second = np.zeros(28), np.zeros(28)
    first[1 * 7 + 2] = 5.0  # row 1, column 2: x = -10 mm, y = +3 mm
    second[3 * 7 + 5] = 9.0  # row 3, column 5: x = +20 mm, y = -9 mm
    slips = one_pad(first, second, t_s=[0.0, 0.3])
    np.testing.assert_allclose(slips.pose[1, 0, :2], [0.005, -0.003], atol=1e-15)
    assert slips.lag_s[1, 0] == pytest.approx(0.15)


def test_a_displacement_is_half_of_the_motion_over_two_steps_in_half_their_time() -> None:
    slips = one_pad(dome(PALM, -0.01), dome(PALM, 0.0), dome(PALM, 0.01), t_s=[0.0, 0.1, 0.5])
    assert slips.span_s[2, 0] == pytest.approx(0.25)
    np.testing.assert_allclose(slips.velocity[2, 0, 0], slips.displacement[2, 0, 0] / 0.25)
    assert slips.displacement[2, 0, 0] > 0


def test_the_index_needs_two_scans_and_the_slip_vector_three() -> None:
    slips = one_pad(*[dome(PALM)] * 4)
    assert np.isfinite(slips.pose[:, 0, 0]).tolist() == [False, True, True, True]
    assert np.isfinite(slips.displacement[:, 0, 0]).tolist() == [False, False, True, True]
    assert slips.valid[:, 0].tolist() == [False, False, True, True]


def test_everything_known_of_a_pose_or_a_displacement_is_known_together() -> None:
    slips = one_pad(*[dome(PALM)] * 3, np.zeros(28), *[dome(PALM)] * 3, contact=[True] * 3 + [False] + [True] * 3)
    pose, displacement = (np.isfinite(part[:, 0, 0]) for part in (slips.pose, slips.displacement))
    for part in (slips.pose[..., 1], slips.covariance[..., 0, 0], slips.covariance[..., 0, 1], slips.lag_s):
        np.testing.assert_array_equal(np.isfinite(part[:, 0]), pose)
    for part in (slips.displacement[..., 1], slips.displacement_covariance[..., 1, 1], slips.span_s):
        np.testing.assert_array_equal(np.isfinite(part[:, 0]), displacement)


def test_rotation_is_unknown() -> None:
    slips = one_pad(*[dome(PALM)] * 3)
    for part in (slips.pose[..., 2], slips.displacement[..., 2], slips.velocity[..., 2]):
        assert np.isnan(part).all()
    for part in (slips.covariance, slips.displacement_covariance):
        assert np.isnan(part[..., 2, :]).all()
        assert np.isnan(part[..., :, 2]).all()


def test_a_contact_far_away_after_a_lift_off_is_a_new_contact_and_no_slip() -> None:
    here, there, nothing = dome(PALM, -0.02), dome(PALM, 0.02), np.zeros(28)
    contact = [True] * 3 + [False] * 2 + [True] * 4
    slips = one_pad(*[here] * 3, *[nothing] * 2, *[there] * 4, contact=contact)
    known = slips.displacement[:, 0, :2][slips.valid[:, 0]]
    assert slips.valid[:, 0].tolist() == [False, False, True] + [False] * 4 + [True] * 2
    np.testing.assert_array_equal(known, 0)
    assert slips.pose[6, 0, 0] > 0 > slips.pose[2, 0, 0]


def test_the_gap_of_a_single_scan_is_a_gap_as_well() -> None:
    here, there = dome(PALM, -0.02), dome(PALM, 0.02)
    slips = one_pad(here, here, np.zeros(28), there, there, there, contact=[True, True, False, True, True, True])
    assert slips.valid[:, 0].tolist() == [False] * 5 + [True]
    assert slips.displacement[5, 0, 0] == 0


def test_a_scan_with_a_missing_loaded_taxel_begins_anew() -> None:
    slips = one_pad(*[dome(PALM)] * 7, complete=[True] * 3 + [False] + [True] * 3)
    assert np.isfinite(slips.pose[:, 0, 0]).tolist() == [False, True, True, False, False, True, True]
    assert slips.valid[:, 0].tolist() == [False, False, True, False, False, False, True]


def test_what_happens_on_one_pad_does_not_matter_to_another() -> None:
    random = np.random.default_rng(0)
    values = np.array([dome(TWO, x) + dome(TWO, pad=1) for x in np.linspace(-0.01, 0.01, 9)])
    other = values.copy()
    other[:, 28:] = random.normal(0, 1e4, (9, 28))
    flags = np.ones((9, 2), bool)
    broken = flags.copy()
    broken[3:5, 1] = False
    one = slips_by("convolution", TWO, scans_of(TWO, values, contact=flags, complete=flags))
    two = slips_by("convolution", TWO, scans_of(TWO, other, contact=broken, complete=broken))
    np.testing.assert_array_equal(one.pose[:, 0], two.pose[:, 0])
    np.testing.assert_array_equal(one.displacement[:, 0], two.displacement[:, 0])


def test_negative_readings_count_as_they_are() -> None:
    image = dome(PALM)
    image[0] = -500.0
    slips = one_pad(image, image)
    expected = image @ PALM.layout.x_m / image.sum()
    assert slips.pose[1, 0, 0] == pytest.approx(expected, abs=1e-15)


def test_a_saturated_contact_that_moves_is_still_followed() -> None:
    wide = grid_sensor(9, 15)
    scans = [np.minimum(dome(wide, x, radius_m=0.015), 20e3) for x in np.linspace(-0.02, 0.02, 9)]
    slips = slips_by("convolution", wide, scans_of(wide, scans))
    np.testing.assert_allclose(slips.displacement[2:, 0, 0], 0.005, rtol=0.02)


def test_a_masked_taxel_has_no_weight_and_no_noise() -> None:
    values = np.array([dome(PALM, x) for x in (0.0, 0.002, 0.004)])
    noise = np.full(28, 100.0)
    values[:, 9], noise[9] = 0.0, 0.0
    slips = slips_by("convolution", PALM, scans_of(PALM, values, noise=noise))
    centroids = values @ PALM.layout.x_m / values.sum(axis=1)
    np.testing.assert_allclose(slips.pose[2, 0, 0], centroids[1:].mean(), atol=1e-15)
    assert (slips.covariance[2, 0, 0, 0] > 0).all()


def test_missing_places_of_the_grid_are_no_taxels() -> None:
    sensor = grid_sensor(2, 2, missing=((0, 0),))
    slips = slips_by("convolution", sensor, scans_of(sensor, [[1.0, 1.0, 1.0]] * 2))
    np.testing.assert_allclose(slips.pose[1, 0, :2], [0.005 / 3, -0.005 / 3])


@pytest.mark.parametrize("gain", [0.5, 1.05, 10.5])
def test_the_gain_scales_lengths_and_their_deviations(gain: float) -> None:
    values = np.array([dome(PALM, x) for x in np.linspace(-0.005, 0.01, 6)])
    scans = scans_of(PALM, values, noise=100.0)
    plain, scaled = (slips_by("convolution", PALM, scans, gain=g) for g in (1.0, gain))
    for length in ("pose", "displacement"):
        np.testing.assert_allclose(getattr(scaled, length), gain * getattr(plain, length), rtol=1e-12)
    for squared in ("covariance", "displacement_covariance"):
        np.testing.assert_allclose(getattr(scaled, squared), gain**2 * getattr(plain, squared), rtol=1e-12)
    np.testing.assert_array_equal(scaled.span_s, plain.span_s)


@pytest.mark.parametrize("gain", [0.0, -1.0, float("nan"), float("inf")])
def test_a_gain_that_cannot_work_is_refused(gain: float) -> None:
    with pytest.raises(ParameterInvalid, match="gain"):
        Convolution(gain=gain)


def test_contact_that_reaches_a_border_names_it() -> None:
    inside, right, top = np.zeros(28), np.zeros(28), np.zeros(28)
    inside[1 * 7 + 3] = right[1 * 7 + 6] = top[3] = 1e3
    corner = np.zeros(28)
    corner[27] = 1e3
    slips = one_pad(inside, right, top, corner, inside + 5.9, inside + 6.1, noise=1.0)
    border = slips.border[:, 0].tolist()
    assert border == [[False, False], [True, False], [False, True], [True, True], [False, False], [True, True]]


def test_a_pad_one_taxel_wide_is_all_border_along_x() -> None:
    column = grid_sensor(5, 1)
    values = np.zeros((1, 5))
    values[0, 2] = 1e3
    assert slips_by("convolution", column, scans_of(column, values, noise=1.0)).border[0, 0].tolist() == [True, False]


@pytest.mark.parametrize("x_m", [0.0, 0.021])
def test_the_predicted_deviations_are_those_of_noisy_scans(x_m: float) -> None:
    draws = 8000
    random = np.random.default_rng(11)
    still = dome(PALM, x_m, 0.004, radius_m=0.01)
    sigma = np.linspace(100, 900, 28)
    values = still + random.normal(0, 1, (draws, 28)) * sigma
    noisy = slips_by("convolution", PALM, scans_of(PALM, values, noise=sigma))
    exact = slips_by("convolution", PALM, scans_of(PALM, [still] * 3, noise=sigma))
    for seen, predicted, apart in (
        (noisy.pose, exact.covariance, 2),  # every other position shares no scan
        (noisy.displacement, exact.displacement_covariance, 1),
    ):
        drawn = seen[2::apart, 0, :2]
        np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(np.diag(predicted[2, 0])[:2]), rtol=0.05)
        correlation = predicted[2, 0, 0, 1] / np.sqrt(predicted[2, 0, 0, 0] * predicted[2, 0, 1, 1])
        assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(correlation, abs=0.06)


def test_predicted_deviations_do_not_depend_much_on_the_noise_drawn() -> None:
    random = np.random.default_rng(1)
    values = dome(PALM) + random.normal(0, 500, (500, 28))
    slips = slips_by("convolution", PALM, scans_of(PALM, values, noise=500.0))
    exact = slips_by("convolution", PALM, scans_of(PALM, [dome(PALM)] * 3, noise=500.0))
    np.testing.assert_allclose(slips.covariance[2:, 0, 0, 0], exact.covariance[2, 0, 0, 0], rtol=0.2)


def test_sessions_do_not_share_their_memory() -> None:
    estimator = Convolution()
    scans = scans_of(PALM, [dome(PALM)] * 3)
    first, second = (start_slips(estimator, PALM.layout, "stream") for _ in range(2))
    first.step(scans)
    assert second.step(scans).valid[:, 0].tolist() == [False, False, True]
