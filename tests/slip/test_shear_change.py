from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from costly import mostly_long
from restless import SENSOR, texture
from sheared import let_go, sheared
from synthetic import grid_sensor, scans_of
from taxelflow.messages import cut
from taxelflow.pipeline import api
from taxelflow.slip.pattern_change import PatternWatch
from taxelflow.slip.shear_change import ShearNoise, spread

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Floats, Scans

LAYOUT = SENSOR.layout
STARTS = LAYOUT.starts[:-1]
PATTERN = texture(np.zeros(1))[0]
NONE = np.zeros((LAYOUT.taxels, 2))
both = pytest.mark.parametrize("mode", ["batch", "stream"])
batch_first = pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))


def spread_of(change: Floats, pressure: Floats = PATTERN) -> float:
    return float(np.sqrt(spread((pressure, pressure), (NONE, change), STARTS)[0][0]))


def twist() -> Floats:
    """(taxels, 2), a torsion about the load's centre."""
    arm = np.stack([LAYOUT.x_m, LAYOUT.y_m], axis=1)
    arm = arm - PATTERN @ arm / PATTERN.sum()
    return PATTERN[:, np.newaxis] * np.stack([-arm[:, 1], arm[:, 0]], axis=1) / 0.01


@given(st.floats(-np.pi, np.pi), st.integers(0, 9))
def test_the_frame_of_the_pad_does_not_matter(angle: float, seed: int) -> None:
    change = PATTERN[:, np.newaxis] * let_go(1, seed)[0]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert spread_of(change @ turn.T) == pytest.approx(spread_of(change), rel=1e-9)


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_a_pull_in_proportion_to_the_pressure_is_no_spread(x: float, y: float) -> None:
    pulled = PATTERN[:, np.newaxis] * np.array([x, y])
    change = pulled + 0.05 * twist()
    assert spread_of(change) == pytest.approx(spread_of(0.05 * twist()), rel=1e-6)
    assert spread_of(pulled + 1e-9) < 1e-6


def test_a_single_loaded_taxel_shows_no_spread() -> None:
    one = np.where(np.arange(LAYOUT.taxels) == 5, 1e4, 0.0)
    assert np.isnan(spread_of(one[:, np.newaxis] * np.array([0.3, 0.1]), one))


def test_a_torsion_is_spread() -> None:
    assert spread_of(twist()) == pytest.approx(np.linalg.norm(twist()) / np.linalg.norm(PATTERN), rel=1e-9)


@given(st.floats(0.01, 100))
def test_the_unit_does_not_matter(scale: float) -> None:
    change = PATTERN[:, np.newaxis] * let_go(1)[0]
    assert spread_of(scale * change, scale * PATTERN) == pytest.approx(spread_of(change), rel=1e-9)


def test_shear_that_never_changes_is_no_evidence() -> None:
    assert np.isnan(spread_of(NONE))


def test_noise_adds_what_is_announced() -> None:
    noise = np.random.default_rng(0).normal(0, 100.0, (4000, LAYOUT.taxels, 2))
    found = [spread((PATTERN, PATTERN), (NONE, one), STARTS) for one in noise]
    announced = found[0][1][0] * 100.0**2
    assert np.mean([power[0] for power, _ in found]) == pytest.approx(announced, rel=0.05)  # but for the total's two


def test_noise_is_learned_from_idle_scans() -> None:
    scans = api.conditioned(sheared(np.zeros(50), np.zeros(50)))
    assert scans.shear is not None
    variance = ShearNoise(LAYOUT).step(scans, scans.shear)
    assert variance[0, 0] == 0.0
    np.testing.assert_allclose(np.sqrt(variance[[19, 30, -1], 0]), 100.0, rtol=0.12)  # the tare follows


def test_a_contact_has_the_noise_of_its_pad() -> None:
    sensor = api.recording(np.arange(2), np.zeros((2, 36)), grid_sensor(6, 6, pitch_m=(0.005, 0.005))).with_contacts(2)
    layout = sensor.layout
    shear = np.random.default_rng(0).normal(0, 7.0, (500, layout.entries, 2))
    shear[:, layout.taxels :] = 0.0
    scans = scans_of(sensor.sensor, np.ones((500, layout.entries)), contact=False)
    np.testing.assert_allclose(np.sqrt(ShearNoise(layout).step(scans, shear)[-1]), 7.0, rtol=0.02)


def watched(scans: Scans, size: int) -> list[Floats]:
    watch = PatternWatch(LAYOUT, 1e-4, 2)
    edges = [*range(0, len(scans), size), len(scans)]
    parts = [watch.step(cut(scans, *edge)) for edge in pairwise(edges)]
    return [np.concatenate([getattr(part, name) for part in parts]) for name in ("spread", "spread_noise")]


@pytest.mark.parametrize("size", [1, 7])
def test_the_blocks_do_not_matter(size: int) -> None:
    scans = api.conditioned(sheared(np.zeros(60), np.zeros(60), rate_hz=31.0))
    for one, whole in zip(watched(scans, size), watched(scans, len(scans)), strict=True):
        np.testing.assert_array_equal(one, whole)
        assert np.isfinite(whole).any()


def test_a_block_of_no_scans_changes_nothing() -> None:
    scans = api.conditioned(sheared(np.zeros(30), np.zeros(30)))
    watch = PatternWatch(LAYOUT, 1e-4, 2)
    parts = [watch.step(cut(scans, *edge)) for edge in ((0, 0), (0, 25), (25, 25), (25, len(scans)))]
    found = np.concatenate([part.spread for part in parts])
    np.testing.assert_array_equal(found, watched(scans, len(scans))[0])


@batch_first
def test_without_shear_or_with_one_that_never_changes_nothing_is_different(mode: Mode) -> None:
    recording = sheared(np.zeros(100), np.zeros(100))
    raw = recording.load()
    plain = api.recording(raw.t_s, raw.values, SENSOR)
    dead = api.recording(raw.t_s, raw.values, SENSOR, shear=np.full((len(raw), 36, 2), 9.0))
    one, other = (api.estimate(some, mode=mode) for some in (plain, dead))
    np.testing.assert_array_equal(one.evidence, other.evidence)
    np.testing.assert_array_equal(one.slipping, other.slipping)
    assert np.isfinite(one.evidence).any()


def highest(slides: Floats, mode: Mode) -> float:
    """Log odds of a slip while the skin lets go (or may), of a pattern that does not change."""
    result = api.estimate(sheared(np.zeros(200), slides), mode=mode)
    during = (result.slips.t_s > 14.0) & (result.slips.t_s < 16.3)
    return float(np.nanmax(result.evidence[during]))


@pytest.mark.long
@both
def test_skin_that_lets_go_is_a_witness_where_the_pattern_does_not_change(mode: Mode) -> None:
    slides = np.zeros(200)
    stuck = highest(slides, mode)
    slides[120:135] = 1.0
    assert stuck < -1
    assert highest(slides, mode) > 0


@batch_first
def test_an_object_that_sticks_while_it_is_pulled_does_not_slip(mode: Mode) -> None:
    result = api.estimate(sheared(np.zeros(300), np.zeros(300)), mode=mode)
    settled = result.slips.t_s > 5.0
    assert result.slipping[settled].mean() < 0.02


def test_a_missing_number_of_shear_counts_as_none() -> None:
    recording = sheared(np.zeros(60), np.zeros(60))
    scans = api.conditioned(recording)
    assert scans.shear is not None
    holed = replace(scans, shear=np.where(np.arange(len(scans))[:, None, None] == 40, 0.0, scans.shear))
    assert np.isfinite(PatternWatch(LAYOUT, 1e-4, 2).step(holed).spread).sum() > 20
