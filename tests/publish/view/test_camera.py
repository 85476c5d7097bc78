from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.publish.view.camera import clearest, fitted, picture_axes
from taxelflow.publish.view.lighting import as_lit, seen
from taxelflow.publish.view.look import CAMERA
from taxelflow.publish.view.palette import DARK, GREEN, LIGHT, VERMILION, ramp


@given(st.integers(0, 10_000), st.floats(0.7, 2.5))
def test_all_points_are_in_the_picture_and_fill_it(seed: int, aspect: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 0.1, (20, 3)) + rng.normal(0, 1, 3)
    direction = rng.normal(0, 1, 3)
    camera = fitted(points, direction, aspect)
    axes = np.stack(picture_axes(direction), axis=1)
    own = (points - camera.position) @ axes
    tangent = np.tan(CAMERA.fov_rad / 2)
    across = np.abs(own[:, :2] / -own[:, 2:]) / (tangent * np.array([aspect, 1.0]))
    assert (own[:, 2] < 0).all()
    assert 0.85 < across.max() < 1.0


def test_a_camera_turned_by_its_quaternion_looks_at_its_target() -> None:
    camera = fitted(np.random.default_rng(0).normal(0, 1, (10, 3)), np.array([0.3, -0.5, 0.8]), 1.3)
    w, x, y, z = camera.wxyz
    ahead = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    towards = camera.look_at - camera.position
    assert ahead == pytest.approx(towards / np.linalg.norm(towards))


def test_lit_surfaces_look_as_asked_up_to_the_brightest_that_the_lights_allow() -> None:
    greys = np.repeat(np.arange(20.0, 225.0)[:, np.newaxis], 3, axis=1)
    assert np.abs(seen(as_lit(greys)) - greys).max() < 4
    asked = np.vstack([ramp(DARK.idle), ramp(LIGHT.idle), [GREEN, VERMILION, DARK.plate, LIGHT.plate]]).astype(float)
    assert np.abs(seen(as_lit(asked)) - asked).mean() < 5  # pure colours are clipped


def test_the_clearest_view_faces_the_skin_and_is_hidden_by_no_other_pad() -> None:
    grid = np.stack(np.meshgrid(np.linspace(-0.02, 0.02, 5), np.linspace(0.0, 0.04, 5)), axis=-1).reshape(-1, 2)
    wall = np.column_stack([grid[:, 0], np.zeros(25), grid[:, 1]])
    place, normal = np.concatenate([wall, wall - 0.08 * np.eye(3)[1]]), np.tile((0.0, -1.0, 0.0), (50, 1))
    pad = np.repeat([0, 1], 25)
    found = clearest(place, normal, pad, 0.01)
    assert found[1] < -0.5
    ahead = np.array([0.0, -np.cos(np.radians(30)), np.sin(np.radians(30))])
    one = clearest(place[:25], normal[:25], pad[:25], 0.01)
    assert one == pytest.approx(ahead)  # alone the wall is seen from straight ahead
    assert found[2] > one[2] or abs(found[0]) > 0.1  # the other one stands before it there
