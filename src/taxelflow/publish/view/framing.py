"""Fits the view into narrow browser windows, until their user moves the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view.scene import ASPECT

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.scene import Scene

_SAME = 1e-3
"""Change of the aspect ratio, and of the camera's place as a share of its distance, that is ignored."""


class Framing:
    """The aspect ratio that each browser's view was fitted to, and the place that its camera was given."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._fitted: dict[int, tuple[float, Floats]] = {}

    def fit(self, camera: Any) -> None:
        """Fit the view into a browser whose aspect ratio has changed, unless its user has moved the camera."""
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
