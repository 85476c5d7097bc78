"""The colour scale with its unit, what the rings stand for, and the time, beside the hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.view import shapes
from taxelflow.publish.view.arrows import RINGS
from taxelflow.publish.view.batch import add_batch
from taxelflow.publish.view.palette import number

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.publish.view.camera import Axes

_STEPS = 64
_FONT = 1.0
_HIGH = 0.026
_BELOW = 0.07
"""Height of the scale, and its distance from the hand, as shares of the hand's size."""


class Legend:
    """Stands below the hand, in the plane of the hand laid flat or in that of the picture."""

    def __init__(self, server: Any) -> None:
        self._bar = add_batch(server, "/scale/bar", shapes.box(), _STEPS, flat_shading=True)
        look: dict[str, Any] = {"font_screen_scale": _FONT, "anchor": "center-left"}
        label = server.scene.add_label
        self._top = label("/scale/top", "", **look)
        self._rings = label("/scale/rings", "", **look)
        self._clock = label("/scale/clock", "", visible=False, **look)

    def place(self, points: Floats, axes: Axes) -> Floats:
        """Move it below points (n, 3) as seen along the axes; return its own corners (m, 3)."""
        own = points @ np.stack(axes, axis=1)
        low, high = own.min(axis=0), own.max(axis=0)
        size = float((high - low).max())
        depth = 0.0 if np.allclose(axes.out, (0.0, 0.0, 1.0)) else float((low[2] + high[2]) / 2)
        length, y = 0.36 * size, low[1] - _BELOW * size
        left = (low[0] + high[0]) / 2 - 0.5 * size

        def at(x: float, up: float = 0.0) -> Floats:
            found: Floats = x * axes.right + (y + up) * axes.up + depth * axes.out
            return found

        steps = left + (np.arange(_STEPS) + 0.5) * length / _STEPS
        turned = shapes.along(axes.out[np.newaxis], axes.right[np.newaxis])
        self._bar.batched_positions = np.stack([at(x) for x in steps])
        self._bar.batched_wxyzs = np.repeat(turned, _STEPS, axis=0)
        self._bar.batched_scales = np.tile((length / _STEPS, _HIGH * size, shapes.NONE), (_STEPS, 1))
        self._top.position = tuple(at(left + 1.04 * length))
        self._rings.position = tuple(at(left + 1.04 * length + 0.2 * size))
        self._clock.position = tuple(at(left + 0.84 * size))
        return np.stack([at(left, -_HIGH * size), at(left + size, -_HIGH * size)])

    def show(self, colours: Any, top: float, unit: str, ring_m_s: float) -> None:
        """colours: (n, 3), of pressure from 0 to top in the unit."""
        self._bar.batched_colors = colours[np.linspace(0, len(colours) - 1, _STEPS).astype(int)]
        self._top.text = f"0 to {number(top)} {unit}"
        self._rings.text = "rings " + ", ".join(number(1e3 * ring_m_s * (k + 1)) for k in range(RINGS)) + " mm/s"

    def tell(self, words: str) -> None:
        """Write something, such as the time, to the right; nothing if empty."""
        self._clock.visible, self._clock.text = bool(words), words
