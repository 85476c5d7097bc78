from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.errors import ParameterInvalid
from taxelflow.simulation.mujoco.skin import Skin, balanced

SKIN = Skin(rows=4, cols=6, fine=2)
depths = st.lists(st.floats(0.0, 3e-3), min_size=2, max_size=30).map(np.array).filter(lambda depth: depth.max() > 1e-6)


@given(depths, st.floats(1e-6, 1e-1))
def test_balanced_depths_sum_to_what_is_asked_and_keep_their_order(depth: np.ndarray, sum_m: float) -> None:
    balance = balanced(depth, sum_m)
    assert balance.sum() == pytest.approx(sum_m, rel=1e-9)
    assert (balance >= 0).all()
    assert (np.diff(balance[np.argsort(depth)]) >= -1e-15).all()


@given(st.integers(0, 2**32), st.floats(0.01, 50.0))
def test_taxels_sum_to_the_force(seed: int, force_n: float) -> None:
    depth = np.maximum(np.random.default_rng(seed).normal(0.0, 1e-3, len(SKIN.places_m())), 0.0)
    assert SKIN.pressure(depth, force_n).sum() * SKIN.pitch_m**2 == pytest.approx(force_n, rel=1e-9)


def test_where_taxels_are_missing_there_is_no_skin() -> None:
    gapped = replace(SKIN, missing=((0, 0), (0, 5)))
    depth = np.random.default_rng(0).uniform(0.0, 1e-3, len(SKIN.places_m()))
    pressure = gapped.pressure(depth, 5.0)
    assert pressure.shape == (22,)
    assert pressure.sum() * gapped.pitch_m**2 == pytest.approx(5.0, rel=1e-9)
    corner = np.zeros((8, 12))
    corner[:2, :2] = 1e-3
    assert not gapped.pressure(corner.ravel(), 5.0).any()


def test_a_deep_contact_is_lifted_and_a_shallow_one_scaled() -> None:
    np.testing.assert_allclose(balanced(np.array([0.0, 1.0, 3.0]), 1.0), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(balanced(np.array([0.0, 1.0, 3.0]), 8.0), [0.0, 2.0, 6.0])


@pytest.mark.parametrize("force_n", [0.15, 0.35, 1.0])
def test_the_image_of_a_narrow_rib_moves_as_the_rib_does(force_n: float) -> None:
    """A bottle's rib, from the least force that carries a light one on. Vertices 1 mm apart: 180 um off, in stairs."""
    skin = Skin()
    (x_m, y_m), up_m = skin.places_m().T, skin.pitch_m * (7.5 - np.arange(16))
    ways_m = np.arange(0.0, skin.pitch_m, 0.05e-3)
    middles_m = []
    for way_m in ways_m:
        depth = np.maximum(1.5e-3 - (y_m - way_m) ** 2 / (2 * 1.2e-3) - x_m**2 / (2 * 0.03), 0.0)
        rows = skin.pressure(depth, force_n).reshape(16, 16).sum(axis=1)
        middles_m.append(rows @ up_m / rows.sum())
    assert np.abs(middles_m - ways_m).max() < 25e-6


def test_no_force_and_no_depth_give_no_pressure() -> None:
    depth = np.ones(len(SKIN.places_m()))
    assert not SKIN.pressure(depth, 0.0).any()
    assert not SKIN.pressure(0 * depth, 1.0).any()


def test_places_run_from_the_top_left_row_by_row() -> None:
    places = SKIN.places_m()
    np.testing.assert_allclose(places[[0, 1, -1]], [[-0.0055, 0.0035], [-0.0045, 0.0035], [0.0055, -0.0035]])


def test_readings_are_clipped_at_zero_and_at_full_scale() -> None:
    read = SKIN.read(np.array([0.0, 1e7]), np.random.default_rng(0))
    assert read[0] >= 0.0
    assert read[1] == SKIN.full_scale_pa


@pytest.mark.parametrize(("name", "value"), [("rows", 0), ("pitch_m", 0.0), ("noise_pa", -1.0), ("cover_m", np.inf)])
def test_a_parameter_out_of_range_is_named(name: str, value: float) -> None:
    with pytest.raises(ParameterInvalid, match=rf"skin\.{name} must be"):
        Skin(**{name: value})
