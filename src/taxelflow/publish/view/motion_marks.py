"""What the drawings of the object's motion on the flat hand and in space share: sizes, and the arrow of the twist."""

from __future__ import annotations

from typing import Any

import numpy as np

from taxelflow.publish.view.palette import MAGENTA

STEPS = 60
"""Pieces of the path, and of the arc that shows the rate of turn."""
TURN_S = 0.5
"""The arc, or sector, is what the object turns in this time."""
MOST_RAD = 5.5
"""Longest arc that is drawn: below a full turn, so that both of its ends are seen."""
SIGMAS = 2.0
"""Standard deviations that the ellipse, or ellipsoid, of the place reaches to."""
WIDEST = 0.1
"""Largest half axis of it that is drawn, as a share of the hand's size: a larger one is cut to this, and grey."""
_THICK = 0.0055
"""Thickness of the arc, as a share of the hand's size."""


def thickness(size_m: float) -> float:
    """Thickness of the arc for a hand of this size."""
    return _THICK * size_m


def twist_arrow(server: Any, size_m: float) -> Any:
    """An arrow for the object's velocity, hidden."""
    thick = thickness(size_m)
    return server.scene.add_arrows(
        "/object/twist",
        np.zeros((1, 2, 3)),
        MAGENTA,
        shaft_radius=0.7 * thick,
        head_radius=2.2 * thick,
        head_length=5.0 * thick,
        visible=False,
    )
