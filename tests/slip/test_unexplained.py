"""What load and tilt leave unexplained, beside a fit by least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor
from taxelflow.messages import Floats
from taxelflow.sensors.layout import Layout
from taxelflow.slip.unexplained import Pads, Patterns, compare_patterns

HAND = grid_sensor(5, 6, pads=2).layout
LINE = grid_sensor(1, 6).layout
CREEP_M = 1e-4


def patterns_of(layout: Layout, seed: int, noise: float = 30.0) -> Patterns:
    """Of two scans before and one after, with an uneven change of up to a tenth."""
    random = np.random.default_rng(seed)
    before = random.uniform(100.0, 1000.0, layout.entries)
    after = before * random.uniform(0.9, 1.1, layout.entries)
    nowhere = np.zeros(layout.entries, dtype=np.bool_)
    return Patterns(before, after, 1.5, nowhere, np.full(layout.entries, noise))


def compared(layout: Layout, patterns: Patterns, creep_m: float = CREEP_M) -> Floats:
    known, found = np.ones(len(layout.pads), dtype=np.bool_), np.empty((4, len(layout.pads)))
    compare_patterns(Pads.of(layout), patterns, known, creep_m, found)
    return found


def fitted(layout: Layout, patterns: Patterns, pad: int) -> float:
    """Share of the power that the best load and tilt leave."""
    own = layout.of_pad(pad)
    q, y = patterns.before[own], patterns.after[own]
    modes = q[:, np.newaxis] * np.column_stack([np.ones(len(q)), 1e3 * layout.x_m[own], 1e3 * layout.y_m[own]])
    left = y - modes @ np.linalg.lstsq(modes, y)[0]
    return float(left @ left / (y @ y))


@pytest.mark.parametrize("layout", [HAND, LINE], ids=["grids", "line"])
@given(seed=st.integers(0, 1000))
def test_it_is_what_least_squares_leave(layout: Layout, seed: int) -> None:
    patterns = patterns_of(layout, seed)
    unexplained, noise, rise, _ = compared(layout, patterns)
    for pad in range(len(layout.pads)):
        own = layout.of_pad(pad)
        y = patterns.after[own]
        assert unexplained[pad] == pytest.approx(fitted(layout, patterns, pad), rel=1e-4, abs=1e-8)
        assert noise[pad] == pytest.approx(len(y) * 30.0**2 * 1.5 / (y @ y))
        assert rise[pad] == pytest.approx(np.log(y.sum() / patterns.before[own].sum()))


@given(st.integers(0, 1000), st.floats(0.92, 1.08), st.floats(-0.1, 0.1))
def test_load_and_tilt_stir_nothing_beyond_their_own_change(seed: int, gain: float, along: float) -> None:
    patterns = patterns_of(HAND, seed, noise=1e-3)
    tilted = gain * patterns.before * (1.0 + along * HAND.x_m / np.abs(HAND.x_m).max())
    assert np.all(compared(HAND, patterns._replace(after=tilted))[0] < 1e-8)


def test_a_taxel_at_the_end_of_its_range_counts_for_nothing() -> None:
    patterns = patterns_of(HAND, 1)
    clipped = patterns.clipped.copy()
    clipped[3] = True
    usual = compared(HAND, patterns._replace(clipped=clipped))
    louder = patterns.after.copy()
    louder[3] *= 10.0
    np.testing.assert_array_equal(compared(HAND, patterns._replace(clipped=clipped, after=louder)), usual)


def test_a_still_pattern_is_stirred_by_more_than_noise_and_creep_only() -> None:
    patterns = patterns_of(HAND, 2)
    stirred = patterns._replace(noise=np.full(HAND.entries, 1e-3))
    assert compared(HAND, stirred)[3].tolist() == [1.0, 1.0]
    assert compared(HAND, stirred, creep_m=1.0)[3].tolist() == [0.0, 0.0]
    assert compared(HAND, patterns._replace(noise=np.full(HAND.entries, 1e3)))[3].tolist() == [0.0, 0.0]


def test_nothing_is_known_of_a_closing_grip_nor_of_a_pad_that_is_apart_or_has_no_load() -> None:
    patterns = patterns_of(HAND, 3)
    rising = compared(HAND, patterns._replace(after=1.3 * patterns.after))
    assert np.isfinite(rising[:3]).all()
    assert np.isnan(rising[3]).all()
    found = np.empty((4, 2))
    compare_patterns(Pads.of(HAND), patterns, np.array([True, False]), CREEP_M, found)
    assert np.isfinite(found[:, 0]).all()
    assert np.isnan(found[:, 1]).all()
    assert np.isnan(compared(HAND, patterns._replace(before=np.zeros(HAND.entries)))).all()


def test_a_pad_without_taxels_has_no_pattern() -> None:
    empty = replace(HAND, pads=("one", "two", "none"), starts=np.append(HAND.starts, HAND.starts[-1]))
    found = np.empty((4, 3))
    compare_patterns(Pads.of(empty), patterns_of(HAND, 4), np.ones(3, dtype=np.bool_), CREEP_M, found)
    assert np.isfinite(found[:, :2]).all()
    assert np.isnan(found[:, 2]).all()


def test_a_single_loaded_taxel_stirs_nothing_wherever_it_is() -> None:
    patterns = patterns_of(HAND, 3)
    for taxel in range(30):
        alone = patterns.before * (np.arange(HAND.entries) == taxel)
        assert compared(HAND, patterns._replace(before=alone, after=1.02 * alone))[3, 0] == 0.0
