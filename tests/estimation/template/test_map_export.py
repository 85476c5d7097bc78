from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from synthetic import grid_sensor, recorded
from taxelflow.estimation.template import map_export as mapped
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats, LearnedPattern
    from taxelflow.pipeline.result import Result

SENSOR = grid_sensor(12, 10, pitch_m=(0.004, 0.004))
NOISE = 200.0
IDLE = 20


def pressure_at(x: Floats, y: Floats) -> Floats:
    """Two unequal bumps: their turn can be seen."""
    one = np.exp(-((x - 0.006) ** 2 + y**2) / (2 * 0.004**2))
    other = np.exp(-((x + 0.006) ** 2 + (y - 0.002) ** 2) / (2 * 0.0035**2))
    return 60e3 * one + 40e3 * other


def moved(pose: Floats, block: int = 1024) -> Recording:
    """Scans of the object at poses (n, 3), after some idle ones, given out in blocks."""
    x, y = SENSOR.layout.x_m - pose[:, :1], SENSOR.layout.y_m - pose[:, 1:2]
    cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    scans = pressure_at(cos * x + sin * y, cos * y - sin * x)
    values = np.concatenate([np.zeros((IDLE, SENSOR.layout.taxels)), scans])
    return recorded(values + np.random.default_rng(0).normal(0, NOISE, values.shape), SENSOR, block=block)


def way(scans: int = 60, turn: float = 0.6) -> Floats:
    share = np.linspace(0.0, 1.0, scans)
    return np.stack([0.004 * np.sin(5 * share), 0.014 * share - 0.007, turn * share], axis=1)


@pytest.fixture(scope="module")
def turned() -> Result:
    return api.estimate(moved(way()), "template")


def explained(result: Result, pattern: LearnedPattern, truth: Floats) -> Floats:
    """(n,) RMS of scans less what the pattern says at the poses given out, for its own scans; Pa."""
    slips, layout = result.slips, SENSOR.layout
    look = RegularGridInterpolator((pattern.y_m, pattern.x_m), pattern.pressure, bounds_error=False)
    errors = []
    for k in np.flatnonzero((slips.t_s >= pattern.t_first_s) & (slips.t_s <= pattern.t_last_s)):
        x, y, theta = np.nan_to_num(slips.pose[k, 0])
        dx, dy = layout.x_m - x, layout.y_m - y
        cos, sin = np.cos(theta), np.sin(theta)
        said = look(np.stack([cos * dy - sin * dx, cos * dx + sin * dy], axis=1))
        px, py, angle = truth[k - IDLE]
        ex, ey = layout.x_m - px, layout.y_m - py
        c, s = np.cos(angle), np.sin(angle)
        errors.append(np.sqrt(np.nanmean((said - pressure_at(c * ex + s * ey, c * ey - s * ex)) ** 2)))
    return np.array(errors)


def test_a_pattern_at_the_poses_given_out_is_what_the_object_is(turned: Result) -> None:
    (pattern,) = turned.patterns
    assert (pattern.pad, pattern.scans, pattern.turns) == ("pad0", 60, True)
    assert (pattern.t_first_s, pattern.t_last_s) == pytest.approx((2.0, 7.9))
    errors = explained(turned, pattern, way())
    assert len(errors) == 60
    assert np.median(errors) < 2 * NOISE


def test_a_pattern_is_finer_than_the_taxels_and_unknown_where_none_looked(turned: Result) -> None:
    (pattern,) = turned.patterns
    assert pattern.pressure.shape == pattern.std.shape == (len(pattern.y_m), len(pattern.x_m))
    assert np.diff(pattern.x_m) == pytest.approx(0.0005)
    np.testing.assert_array_equal(np.isnan(pattern.pressure), np.isnan(pattern.std))
    assert np.isnan(pattern.pressure).any()
    assert np.nanmin(pattern.std) > 0


@pytest.mark.long
def test_the_std_of_a_pattern_is_that_of_its_error() -> None:
    still = np.tile([0.001, 0.0005, 0.0], (40, 1))
    result = api.estimate(moved(way(turn=0.0)), "template")
    (pattern,) = result.patterns
    x, y, theta = np.nan_to_num(result.slips.pose[IDLE, 0])
    u, v = np.meshgrid(pattern.x_m, pattern.y_m)
    cos, sin = np.cos(theta), np.sin(theta)
    start = way()[0]
    real = pressure_at(x + cos * u - sin * v - start[0], y + sin * u + cos * v - start[1])
    inside = real > 5e3
    off = ((pattern.pressure - real) / pattern.std)[inside & np.isfinite(pattern.pressure)]
    assert 0.3 < np.sqrt(np.mean(off**2)) < 5
    (unmoved,) = api.estimate(moved(still), "template").patterns
    assert np.nanmedian(unmoved.std) > np.nanmedian(pattern.std)


@pytest.mark.long
def test_windows_of_a_contact_have_patterns_in_the_frame_of_its_poses() -> None:
    truth = way(60)
    result = api.estimate(moved(truth), "template", window_scans=34)
    assert len(result.patterns) > 1
    for pattern in result.patterns:
        assert np.median(explained(result, pattern, truth)) < 6 * NOISE
    cut = api.estimate(moved(truth, block=7), "template", window_scans=34)
    for one, other in zip(result.patterns, cut.patterns, strict=True):
        np.testing.assert_array_equal(one.pressure, other.pressure)
    np.testing.assert_array_equal(result.slips.pose, cut.slips.pose)


@pytest.mark.long
def test_a_stream_keeps_the_pattern_of_each_contact() -> None:
    truth = np.repeat(way(30, turn=0.0), 2, axis=0)
    result = api.estimate(moved(truth), "template", mode="stream")
    (pattern,) = result.patterns
    assert pattern.t_last_s <= result.slips.t_s[-1]
    assert np.median(explained(result, pattern, truth)[-20:]) < 10 * NOISE


def test_a_contact_of_few_scans_has_no_pattern_and_other_methods_have_none() -> None:
    assert api.estimate(moved(way(3)), "template").patterns == []
    assert api.estimate(moved(way(20)), "convolution").patterns == []


def test_only_the_patterns_of_most_scans_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapped, "_LIMITS", mapped._LIMITS._replace(most=2))
    maps = mapped.Maps()
    for scans in (12, 6, 9):
        (pattern,) = api.estimate(moved(way(scans)), "template").patterns
        maps.keep(pattern)
    assert [one.scans for one in maps] == [12, 9]
    assert maps[:1] == [maps[0]]


def test_silent_taxels_are_named_in_pattern_and_summary() -> None:
    recording = moved(way())
    values = np.concatenate([block.values for block in recording.blocks()])
    silent = 64
    values[:, silent] = np.random.default_rng(1).normal(0, NOISE, len(values))
    result = api.estimate(recorded(values, SENSOR), "template")
    assert result.patterns[0].dead.tolist() == [silent]
    assert any(f"taxels {silent} of pad0" in note for note in result.summary.notes)
