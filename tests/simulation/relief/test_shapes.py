from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from taxelflow.simulation.relief.body import body_of
from taxelflow.simulation.relief.parameters import Object, Shape
from taxelflow.simulation.relief.shapes import DEEPEST, SHAPES, height_of

S, T = np.meshgrid(np.linspace(-1.3, 1.3, 261), np.linspace(-1.3, 1.3, 261))
NAMES = get_args(Shape)


def test_every_shape_has_a_height_map() -> None:
    assert len(NAMES) == 12
    assert {*SHAPES, "cloth"} == set(NAMES)


@pytest.mark.parametrize("shape", NAMES)
def test_a_shape_is_continuous_and_ends_within_its_size(shape: Shape) -> None:
    height = height_of(shape, S, T)
    assert np.isfinite(height).all()
    assert height.min() >= -DEEPEST
    steepest = max(np.abs(np.diff(height, axis=axis)).max() for axis in (0, 1)) / 0.01
    assert steepest < 80  # an edge falls by its own height within an eightieth of half the size
    near = height > height.max() - 1.0
    assert near.any()
    assert np.hypot(S, T)[near].max() < 1.3


@pytest.mark.parametrize("shape", [name for name in NAMES if name != "dome"])
def test_only_the_dome_is_round(shape: Shape) -> None:
    height = height_of(shape, S, T)
    turned = height_of(shape, np.cos(0.5) * S + np.sin(0.5) * T, np.cos(0.5) * T - np.sin(0.5) * S)
    assert np.abs(turned - height)[height > height.max() - 1].max() > 0.1


def test_a_dome_is_round() -> None:
    assert height_of("dome", np.cos(T), np.sin(T)) == pytest.approx(-1.2 * np.ones_like(T))


def test_cloths_of_other_seeds_are_other_cloths() -> None:
    assert np.array_equal(height_of("cloth", S, T, 1), height_of("cloth", S, T, 1))
    assert np.abs(height_of("cloth", S, T, 1) - height_of("cloth", S, T, 2)).max() > 0.3


@pytest.mark.parametrize("shape", NAMES)
def test_the_load_point_is_the_origin_and_the_top_is_at_0(shape: Shape) -> None:
    body = body_of(Object(shape=shape, size_m=0.02, relief_m=1e-3))
    nodes = np.linspace(-0.016, 0.016, 321)
    u, v = np.meshgrid(nodes, nodes)
    height = body.height(u, v)
    assert height.max() == pytest.approx(0.0, abs=4e-5)
    near = np.maximum(height + 0.8e-3, 0.0)
    assert np.array([(near * u).sum(), (near * v).sum()]) / near.sum() == pytest.approx([0, 0], abs=5e-5)
    touching = height > -0.9e-3 * DEEPEST
    assert np.hypot(u, v)[touching].max() <= body.reach_m


def test_a_relief_is_as_deep_as_asked_for_beyond_its_raster() -> None:
    body = body_of(Object(shape="nut", relief_m=2e-3))
    assert body.height(np.array([1.0]), np.array([0.0])) == pytest.approx(-2e-3 * DEEPEST)
