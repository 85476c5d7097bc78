"""Fits the view into narrow browser windows, until their user moves the camera."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view.look import CAMERA

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.scene import Scene


_MOST_OFFERED = 64
"""Places of the camera that are remembered, as those at which a browser may have opened."""


class Framing:
    """The aspect ratio that each browser's view was fitted to, and the place that its camera was given.

    A browser opens at the place that was the latest one when it asked for the page. By the time that it is fitted,
    another browser may have been, and the latest place be that one's.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._fitted: dict[int, tuple[float, Floats]] = {}
        self._offered: deque[tuple[float, Floats]] = deque([(scene.aspect, scene.position)], _MOST_OFFERED)

    def fit(self, camera: Any) -> None:
        """Fit the view into a browser whose aspect ratio has changed, unless its user has moved the camera."""
        client, scene = camera.client, self._scene
        if scene.position is not self._offered[-1][1]:
            self._offered.append((scene.aspect, scene.position))
        aspect = min(float(camera.aspect), CAMERA.aspect)
        own = self._fitted.get(client.client_id)
        position, look_at = np.array(camera.position), np.array(camera.look_at)
        near = CAMERA.same_fit * float(np.linalg.norm(position - look_at))
        given = reversed(self._offered) if own is None else [own]
        before = next((ratio for ratio, place in given if float(np.linalg.norm(position - place)) <= near), None)
        if before is None or not aspect > 0 or abs(aspect - before) < CAMERA.same_fit:
            return
        found = scene.frame(position - look_at, aspect)
        self._offered.append((scene.aspect, scene.position))
        self._fitted[client.client_id] = aspect, found.position
        with client.atomic():
            camera.position, camera.look_at = found.position, found.look_at
