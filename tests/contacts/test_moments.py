from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import dome, grid_sensor, recorded, scans_of
from taxelflow.contacts.features import ContactFeatures
from taxelflow.contacts.moments import FeatureExtractor
from taxelflow.pipeline.api import estimate, read

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

    from taxelflow.messages import Contacts, Floats
    from taxelflow.sensors.sensor import Sensor

GRID = grid_sensor(24, 24, pitch_m=(0.002, 0.002), full_scale=140e3)
TAXEL = 0.002**2


def described(pressure: Floats, sensor: Sensor = GRID, threshold: float = 4.0, **more: Any) -> Contacts:
    scans = scans_of(sensor, np.atleast_2d(pressure), **{"noise": 10.0, **more})
    return FeatureExtractor(sensor, ContactFeatures(threshold).threshold).step(scans)


def ellipse(length: float, width: float, angle: float, x: float = 0.0, y: float = 0.0, peak: float = 2e4) -> Floats:
    """An evenly loaded ellipse, each taxel by the share of it that is covered."""
    layout = GRID.layout
    fine = (np.arange(12) + 0.5) / 12 - 0.5
    dx, dy = np.meshgrid(0.002 * fine, 0.002 * fine)
    px = layout.x_m[:, np.newaxis] + dx.ravel() - x
    py = layout.y_m[:, np.newaxis] + dy.ravel() - y
    along, across = np.cos(angle) * px + np.sin(angle) * py, np.cos(angle) * py - np.sin(angle) * px
    inside = (2 * along / length) ** 2 + (2 * across / width) ** 2 <= 1
    values: Floats = peak * inside.mean(axis=1)
    return values


def test_force_is_pressure_times_area() -> None:
    values = ellipse(0.03, 0.02, 0.4)
    contacts = described(values)
    assert contacts.force[0, 0] == pytest.approx(2e4 * np.pi * 0.03 * 0.02 / 4, rel=0.01)
    assert contacts.force_std[0, 0] == pytest.approx(10.0 * TAXEL * np.sqrt((values != 0).sum()))


def test_area_and_peak_are_of_the_taxels_above_the_noise() -> None:
    values = np.zeros(576)
    values[[3, 4, 40]] = [41.0, 39.0, 900.0]
    contacts = described(values)
    assert contacts.area[0, 0] == pytest.approx(2 * TAXEL)
    assert contacts.peak[0, 0] == 900.0
    assert described(values, threshold=3.0).area[0, 0] == pytest.approx(3 * TAXEL)


@given(
    angle=st.floats(-1.5, 1.5),
    x=st.floats(-0.004, 0.004),
    y=st.floats(-0.004, 0.004),
    width=st.floats(0.012, 0.02),
)
def test_axes_orientation_and_centroid_are_those_of_an_even_ellipse(
    angle: float, x: float, y: float, width: float
) -> None:
    contacts = described(ellipse(0.028, width, angle, x, y))
    np.testing.assert_allclose(contacts.centroid[0, 0], [x, y], atol=5e-5)
    np.testing.assert_allclose(contacts.axes[0, 0], [0.028, width], rtol=0.03, atol=2e-4)
    turn = contacts.orientation[0, 0] - angle
    assert abs(turn - np.pi * np.round(turn / np.pi)) < 0.02
    assert contacts.eccentricity[0, 0] == pytest.approx(np.sqrt(1 - (width / 0.028) ** 2), abs=0.03)


@given(peak=st.floats(1e3, 1e4), column=st.integers(0, 22), first=st.integers(0, 20))
def test_two_columns_of_taxels_point_up_whatever_rounding_does(peak: float, column: int, first: int) -> None:
    values = np.zeros((24, 24))
    values[first : first + 4, column : column + 2] = peak * np.array([[1.0], [2.0], [1.7], [0.6]])
    assert described(values.ravel()).orientation[0, 0] == pytest.approx(np.pi / 2)


@given(peak=st.floats(1e3, 1e4), count=st.integers(2, 9))
def test_taxels_in_a_line_do_not_show_how_the_object_is_turned(peak: float, count: int) -> None:
    values = np.zeros((24, 24))
    values[5, 3 : 3 + count] = peak
    contacts = described(values.ravel())
    assert np.isnan(contacts.orientation[0, 0])
    assert np.isnan(contacts.orientation_std[0, 0])
    assert contacts.eccentricity[0, 0] > 0.8


@pytest.mark.parametrize("threshold", [0.0, 4.0])
def test_a_round_contact_has_no_orientation(threshold: float) -> None:
    layout = GRID.layout
    round_ = np.where(np.hypot(layout.x_m, layout.y_m) < 0.01, 1e4, 0.0)
    contacts = described(round_, threshold=threshold)
    assert np.isnan(contacts.orientation[0, 0])
    assert np.isnan(contacts.orientation_std[0, 0])
    assert contacts.eccentricity[0, 0] == pytest.approx(0, abs=1e-3)


def test_the_orientations_standard_deviation_is_what_noise_does() -> None:
    random = np.random.default_rng(0)
    clean = ellipse(0.03, 0.02, 0.5)
    noisy = clean + random.normal(0, 50, (400, 576)) * (clean > 0)
    contacts = described(noisy, noise=50.0)
    assert contacts.orientation[:, 0].std() == pytest.approx(float(contacts.orientation_std[:, 0].mean()), rel=0.15)
    assert contacts.force[:, 0].std() == pytest.approx(float(contacts.force_std[:, 0].mean()), rel=0.15)


def test_a_single_taxel_has_its_own_size_and_no_direction() -> None:
    values = np.zeros(576)
    values[100] = 5e3
    contacts = described(values)
    np.testing.assert_allclose(contacts.axes[0, 0], 4 * np.sqrt(TAXEL / 12))
    assert contacts.eccentricity[0, 0] == pytest.approx(0, abs=1e-6)
    assert np.isnan(contacts.orientation[0, 0])
    assert contacts.area[0, 0] == pytest.approx(TAXEL)


def test_without_contact_or_a_whole_scan_nothing_is_known() -> None:
    values = np.stack([ellipse(0.03, 0.02, 0.4)] * 3)
    contacts = described(values, contact=[True, False, True], complete=[True, True, False])
    known = np.isfinite(contacts.force[:, 0])
    assert known.tolist() == [True, False, False]
    for name in ("area", "peak", "eccentricity", "orientation"):
        assert np.isfinite(getattr(contacts, name)[:, 0]).tolist() == [True, False, False]


def test_counts_without_a_scale_are_no_force() -> None:
    sensor = grid_sensor(24, 24, pitch_m=(0.002, 0.002), unit="count")
    contacts = described(ellipse(0.03, 0.02, 0.4), sensor)
    assert np.isnan(contacts.force).all()
    assert np.isfinite(contacts.area).all()


def test_a_group_has_features_of_its_own() -> None:
    from taxelflow.sensors.pads import Group, Patch

    sensor = grid_sensor(4, 7, groups=(Group("left", (Patch("pad0", cols=(0, 2)),)),))
    values = dome(sensor)
    contacts = estimate(recorded(np.stack([values] * 20), sensor)).contacts
    assert contacts.force.shape == (20, 2)
    layout = sensor.layout
    left = values[layout.source[layout.of_pad(1)]].sum() * 1e-4
    assert contacts.force[-1].tolist() == pytest.approx([values.sum() * 1e-4, left])


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_every_scan_of_a_result_has_its_features(mode: str) -> None:
    palm = grid_sensor(4, 7, full_scale=140e3)
    values = np.array([dome(palm, x) for x in np.linspace(-0.01, 0.01, 40)])
    result = estimate(recorded(values + np.random.default_rng(0).normal(0, 50, values.shape), palm), mode=mode)  # type: ignore[arg-type]
    np.testing.assert_array_equal(result.contacts.t_s, result.slips.t_s)
    np.testing.assert_array_equal(result.contacts.contact, result.slips.contact)
    np.testing.assert_allclose(result.contacts.force[:, 0], result.slips.load[:, 0] * 1e-4)


def test_the_teapots_handle_turns_as_its_axis_does(recordings: Path) -> None:
    result = estimate(read(recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa"))
    pad = result.pads.index("finger2_distal")
    assert 0.05 < float(np.nanmax(result.contacts.force[:, pad])) < 0.3
    axis = result.contacts.orientation[:, pad]
    steps = np.diff(axis[np.isfinite(axis)])
    turned = float(np.sum(steps - np.pi * np.round(steps / np.pi)))
    assert abs(turned) > 0.5
