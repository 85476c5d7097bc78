from __future__ import annotations

import numpy as np
import pytest

from synthetic import dome, grid_sensor, scans_of, slips_by
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.centroid.lnorm import LNorm
from taxelflow.messages import Floats, Slips

PITCH = (0.01, 0.006)
PALM = grid_sensor(4, 7, pitch_m=PITCH, unseen_error=0.0)
TWO = grid_sensor(4, 7, pads=2)


def peak(row: int, col: int, value: float = 1e3) -> Floats:
    scan = np.zeros((4, 7))
    scan[row, col] = value
    return scan.ravel()


def one_pad(*images: Floats, **more: object) -> Slips:
    return slips_by("lnorm", PALM, scans_of(PALM, np.array(images), **more))  # type: ignore[arg-type]


def test_the_position_is_the_place_of_the_largest_taxel() -> None:
    slips = one_pad(peak(0, 0), peak(1, 2), peak(3, 6))
    np.testing.assert_allclose(slips.pose[:, 0, :2], [[-0.03, 0.009], [-0.01, 0.003], [0.03, -0.009]], atol=1e-15)
    np.testing.assert_array_equal(slips.lag_s[:, 0], 0)


def test_the_displacement_is_the_step_between_places() -> None:
    slips = one_pad(peak(0, 0), peak(1, 2), peak(1, 2), t_s=[0.0, 0.25, 0.75])
    np.testing.assert_allclose(slips.displacement[1:, 0, :2], [[0.02, -0.006], [0, 0]], atol=1e-15)
    np.testing.assert_allclose(slips.span_s[1:, 0], [0.25, 0.5])
    np.testing.assert_allclose(slips.velocity[1, 0, :2], [0.08, -0.024])


def test_the_position_needs_one_scan_and_the_displacement_two() -> None:
    slips = one_pad(*[dome(PALM)] * 3)
    assert np.isfinite(slips.pose[:, 0, 0]).all()
    assert slips.valid[:, 0].tolist() == [False, True, True]


def test_of_equal_maxima_the_first_in_scan_order_counts() -> None:
    slips = one_pad(peak(2, 5) + peak(1, 6) + peak(2, 0))
    np.testing.assert_allclose(slips.pose[0, 0, :2], [0.03, 0.003], atol=1e-15)


def test_rotation_is_unknown() -> None:
    slips = one_pad(*[dome(PALM)] * 2)
    assert np.isnan(slips.pose[..., 2]).all()
    assert np.isnan(slips.displacement[..., 2]).all()


def test_nothing_is_carried_over_a_lift_off() -> None:
    slips = one_pad(
        peak(0, 0), peak(0, 0), np.zeros(28), peak(3, 6), peak(3, 6), contact=[True, True, False, True, True]
    )
    assert slips.valid[:, 0].tolist() == [False, True, False, False, True]
    np.testing.assert_array_equal(slips.displacement[[1, 4], 0, :2], 0)
    assert np.isnan(slips.pose[2, 0]).all()


def test_a_scan_with_a_missing_loaded_taxel_begins_anew() -> None:
    slips = one_pad(*[dome(PALM)] * 5, complete=[True, True, False, True, True])
    assert slips.valid[:, 0].tolist() == [False, True, False, False, True]


def test_a_masked_taxel_is_never_the_largest() -> None:
    noise = np.ones(28)
    noise[0] = 0.0
    values = -np.arange(28.0) - 1  # taxel 0 would be the largest, all are negative
    values[0] = 0.0
    slips = one_pad(values, noise=noise)
    assert slips.pose[0, 0, 0] == pytest.approx(PALM.layout.x_m[1])


def test_a_plateau_of_saturated_taxels_does_not_wander() -> None:
    scans = [np.minimum(dome(PALM, x, radius_m=0.02), 20e3) for x in (0.0, 0.0001, 0.0002)]
    slips = one_pad(*scans)
    np.testing.assert_array_equal(slips.displacement[1:, 0, :2], 0)


def test_a_clear_maximum_is_known_to_within_its_taxel() -> None:
    slips = one_pad(*[peak(1, 3, 1e6)] * 2, noise=1.0)
    np.testing.assert_allclose(
        slips.covariance[1, 0, :2, :2], np.diag([PITCH[0] ** 2 / 12, PITCH[1] ** 2 / 12]), rtol=1e-9, atol=1e-20
    )
    np.testing.assert_allclose(slips.displacement_covariance[1, 0, :2, :2], 0, atol=1e-20)


def test_a_tie_of_neighbours_adds_up_to_a_pitch_squared() -> None:
    slips = one_pad(*[peak(1, 3, 1e6) + peak(1, 4, 1e6)] * 2, noise=1.0)
    tie = slips.covariance[1, 0, 0, 0] - PITCH[0] ** 2 / 12
    assert 0 < tie <= PITCH[0] ** 2
    assert slips.covariance[1, 0, 1, 1] == pytest.approx(PITCH[1] ** 2 / 12)
    assert slips.displacement_covariance[1, 0, 0, 0] == pytest.approx(2 * tie)


def test_a_tie_fades_as_the_maximum_becomes_clear() -> None:
    variances = []
    for lead in (0.0, 1.0, 2.0, 4.0, 8.0):
        slips = one_pad(peak(1, 3, 1e6 + lead) + peak(1, 4, 1e6), noise=1.0)
        variances.append(slips.covariance[0, 0, 0, 0] - PITCH[0] ** 2 / 12)
    assert (np.diff(variances) < 0).all()
    assert variances[-1] < 1e-6 * PITCH[0] ** 2


def test_a_tie_across_a_diagonal_is_correlated() -> None:
    falling = one_pad(peak(1, 3, 1e6) + peak(2, 4, 1e6), noise=1.0)
    rising = one_pad(peak(2, 3, 1e6) + peak(1, 4, 1e6), noise=1.0)
    assert falling.covariance[0, 0, 0, 1] < 0 < rising.covariance[0, 0, 0, 1]


def test_jumps_of_a_tie_fit_their_standard_deviation() -> None:
    random = np.random.default_rng(3)
    values = peak(1, 3, 1e5) + peak(1, 4, 1e5) + random.normal(0, 100, (6000, 28))
    slips = one_pad(*values, noise=100.0)
    predicted = np.sqrt(np.mean(slips.displacement_covariance[1:, 0, 0, 0]))
    assert 0.5 < slips.displacement[1:, 0, 0].std() / predicted < 1.5


def test_gains_of_taxels_tie_a_pose_but_no_displacement() -> None:
    scan = peak(1, 3, 1e6) + peak(1, 4, 9e5)
    clear, tied = (
        slips_by("lnorm", sensor, scans_of(sensor, np.array([scan, scan]), noise=1.0))
        for sensor in (PALM, grid_sensor(4, 7, pitch_m=PITCH))
    )
    assert clear.covariance[1, 0, 0, 0] == pytest.approx(PITCH[0] ** 2 / 12)
    assert tied.covariance[1, 0, 0, 0] > PITCH[0] ** 2 / 6
    np.testing.assert_array_equal(
        clear.displacement_covariance[1, 0, :2, :2], tied.displacement_covariance[1, 0, :2, :2]
    )


@pytest.mark.parametrize("gain", [0.5, 1.05])
def test_the_gain_scales_lengths_and_their_deviations(gain: float) -> None:
    scans = scans_of(PALM, [dome(PALM, x) for x in np.linspace(-0.02, 0.02, 6)], noise=2e3)
    plain, scaled = (slips_by("lnorm", PALM, scans, gain=g) for g in (1.0, gain))
    for length in ("pose", "displacement"):
        np.testing.assert_allclose(getattr(scaled, length), gain * getattr(plain, length), rtol=1e-12)
    for squared in ("covariance", "displacement_covariance"):
        np.testing.assert_allclose(getattr(scaled, squared), gain**2 * getattr(plain, squared), rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("gain", [0.0, -1.0, float("nan"), float("inf")])
def test_a_gain_that_cannot_work_is_refused(gain: float) -> None:
    with pytest.raises(ParameterInvalid, match="gain"):
        LNorm(gain=gain)


def test_a_border_is_marked_as_for_the_other_method() -> None:
    scans = scans_of(PALM, [dome(PALM, x, radius_m=0.006) for x in np.linspace(-0.04, 0.04, 30)], noise=50.0)
    np.testing.assert_array_equal(slips_by("lnorm", PALM, scans).border, slips_by("convolution", PALM, scans).border)


def test_taxels_that_cannot_be_the_largest_add_no_variance_however_many_they_are() -> None:
    variances = []
    for size in (9, 33):
        sensor = grid_sensor(size, size, pitch_m=(0.002, 0.002), unseen_error=0.05)
        slips = slips_by("lnorm", sensor, scans_of(sensor, np.array([dome(sensor, radius_m=0.004)] * 2), noise=1.0))
        variances.append(slips.covariance[1, 0, 0, 0])
    assert variances[1] == pytest.approx(variances[0], rel=1e-6)
