from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from taxelflow.publish.view.look import CAMERA

pytest.importorskip("viser", reason="viser is not installed (extra `view`)")

from taxelflow.publish.view.camera import picture_axes
from taxelflow.publish.view.framing import Framing
from taxelflow.publish.view.scene import Scene
from taxelflow.publish.view.server import PageServer
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def scene() -> Iterator[Scene]:
    with PageServer(port=0) as server:
        yield Scene(server.viser, load_sensor("schunk-sdh2"))


def opened(scene: Scene, aspect: float, number: int = 0) -> Any:
    """The camera of a browser that has just loaded the page."""
    place = scene._server.initial_camera
    client = SimpleNamespace(client_id=number, atomic=nullcontext)
    return SimpleNamespace(aspect=aspect, position=place.position, look_at=place.look_at, client=client)


def half_width(scene: Scene, camera: Any) -> float:
    """Largest distance from the middle of what the scene shows, and of its scales, over half the picture's width."""
    axes = picture_axes(camera.position - camera.look_at)
    scales = scene.legend.place(scene._points, axes, scene._view.wide_m)  # type: ignore[union-attr]
    seen = (np.concatenate([scene._points, scales]) - camera.position) @ np.stack(axes, axis=1)
    return float((np.abs(seen[:, 0]) / -seen[:, 2]).max() / (np.tan(CAMERA.fov_rad / 2) * camera.aspect))


@pytest.mark.parametrize("aspect", [1.0, 0.6])
def test_a_window_that_is_narrower_than_usual_shows_all(scene: Scene, aspect: float) -> None:
    camera = opened(scene, aspect)
    assert half_width(scene, camera) > 1.0
    Framing(scene).fit(camera)
    assert half_width(scene, camera) < 1.0


def test_each_window_is_fitted_as_it_changes_until_its_user_moves_the_camera(scene: Scene) -> None:
    framing, camera = Framing(scene), opened(scene, 1.5)
    first = np.array(camera.position)
    framing.fit(camera)
    np.testing.assert_array_equal(camera.position, first)  # a wider one leaves more to the sides
    camera.aspect = 0.9
    framing.fit(camera)
    assert np.linalg.norm(camera.position - camera.look_at) > 1.1 * np.linalg.norm(first - camera.look_at)
    other = opened(scene, 0.7, number=1)
    framing.fit(other)
    assert half_width(scene, other) < 1.0
    camera.aspect = 2.0
    framing.fit(camera)
    np.testing.assert_allclose(camera.position, first, rtol=1e-9, atol=1e-12)
    camera.aspect, camera.position = 0.9, 1.2 * first
    framing.fit(camera)
    np.testing.assert_array_equal(camera.position, 1.2 * first)


def test_windows_that_open_at_once_are_all_fitted(scene: Scene) -> None:
    framing, cameras = Framing(scene), [opened(scene, 0.9, number) for number in range(3)]
    for camera in cameras:
        framing.fit(camera)
    assert all(half_width(scene, camera) < 1.0 for camera in cameras)
