"""The view fitted into windows that are narrower than usual, until their user moves the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view.scene import ASPECT

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.scene import Scene

_SAME = 1e-3
"""Change of a form, and of a place as a share of its distance, that is none."""


class Framing:
    """Of each browser the form that its view was fitted into, and where its camera was put."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._fitted: dict[int, tuple[float, Floats]] = {}

    def fit(self, camera: Any) -> None:
        """Fit the view into a browser whose form has changed, if its camera is where it was put."""
        client, scene = camera.client, self._scene
        aspect = min(float(camera.aspect), ASPECT)
        before, place = self._fitted.get(client.client_id, (scene.aspect, scene.position))
        position, look_at = np.array(camera.position), np.array(camera.look_at)
        away = float(np.linalg.norm(position - place)) > _SAME * float(np.linalg.norm(position - look_at))
        if away or not aspect > 0 or abs(aspect - before) < _SAME:
            return
        found = scene.frame(position - look_at, aspect)
        self._fitted[client.client_id] = aspect, found.position
        with client.atomic():
            camera.position, camera.look_at = found.position, found.look_at
