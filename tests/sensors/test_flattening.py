from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tabled import arched, square
from taxelflow.numerics.geometry import rotate
from taxelflow.sensors.flattening import MOST_CURVED, flatten

UP = np.array([0.0, 0.0, 1.0])


def dome(half_angle_rad: float, count: int = 60) -> np.ndarray:
    """Unit normals (taxels, 3) spread evenly over a cap of the sphere."""
    k = np.arange(count) + 0.5
    z = 1 - (1 - np.cos(half_angle_rad)) * k / count
    turn = np.pi * (1 + np.sqrt(5)) * k
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


@given(radius=st.floats(0.012, 10.0), cols=st.integers(2, 9))
def test_a_cylinder_is_unrolled_without_distortion(radius: float, cols: int) -> None:
    flat, table = arched(4, cols, radius)
    flattened = flatten(table[:, :3], table[:, 3:])
    np.testing.assert_allclose(flattened.xy, flat, atol=1e-8)
    assert flattened.stretch < 1e-6


@given(seed=st.integers(0, 1000))
def test_a_map_does_not_depend_on_where_the_pad_is_in_space_but_for_its_turn(seed: int) -> None:
    _, table = arched(4, 7, 0.02)
    random = np.random.default_rng(seed)
    quaternion, shift = random.normal(size=4), random.normal(size=3)
    moved = flatten(rotate(quaternion, table[:, :3]) + shift, rotate(quaternion, table[:, 3:])).xy
    still = flatten(table[:, :3], table[:, 3:]).xy
    left, _, right = np.linalg.svd(moved.T @ still)
    assert np.linalg.det(left @ right) > 0  # turned, never mirrored
    np.testing.assert_allclose(moved @ (left @ right), still, atol=1e-7)


def test_a_flat_tilted_pad_keeps_its_shape() -> None:
    flat = square(3, 4)
    tilted = rotate(np.array([0.0, np.sin(0.2), 0.0, np.cos(0.2)]), np.column_stack([flat, np.zeros(12)]))
    normals = np.tile(rotate(np.array([0.0, np.sin(0.2), 0.0, np.cos(0.2)]), UP), (12, 1))
    flattened = flatten(tilted, normals)
    np.testing.assert_allclose(flattened.xy, flat, atol=1e-12)
    assert flattened.stretch == 0


def test_viewed_from_below_x_stays_and_y_turns() -> None:
    flat = square(2, 3)
    flattened = flatten(np.column_stack([flat, np.zeros(6)]), np.tile(-UP, (6, 1)))
    np.testing.assert_allclose(flattened.xy, flat * [1, -1], atol=1e-12)


def test_a_dome_is_stretched_little_and_reports_how_much() -> None:
    shallow, deep = (flatten(0.01 * normals, normals) for normals in (dome(0.3), dome(1.2)))
    assert shallow.stretch < 0.02
    assert shallow.stretch < deep.stretch < 0.3


def test_skin_that_closes_upon_itself_is_no_pad() -> None:
    around = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    normals = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    with pytest.raises(ValueError, match="the skin is closed"):
        flatten(0.01 * normals, normals)


def test_a_curved_pad_has_its_limit() -> None:
    normals = dome(1.0, MOST_CURVED + 1)
    with pytest.raises(ValueError, match="at most 2048 taxels, this one 2049"):
        flatten(normals, normals)
