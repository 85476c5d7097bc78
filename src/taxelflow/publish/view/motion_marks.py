"""What the drawings of the object's motion on the flat hand and in space share: thickness, and arrow of the twist."""

from __future__ import annotations

from typing import Any

import numpy as np

from taxelflow.publish.view.look import MOTION
from taxelflow.publish.view.palette import MAGENTA


def thickness(size_m: float) -> float:
    """Thickness of the arc for a hand of this size."""
    return MOTION.thick * size_m


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
