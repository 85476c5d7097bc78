"""Frames on the skin of a pad."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.sensors.pads import Pad
from taxelflow.sensors.surface import PadSurface

ARC = tuple(
    (0.02 * np.sin(a), y, 0.02 * (np.cos(a) - 1.0), np.sin(a), 0.0, np.cos(a))
    for y in (-0.004, 0.0, 0.004)
    for a in np.linspace(-0.5, 0.5, 6).tolist()
)
PLANE = tuple((x, y) for y in (0.0, 0.004, 0.008) for x in (0.0, 0.004, 0.008, 0.012))


@pytest.mark.parametrize("taxels", [ARC, PLANE])
def test_no_frame_depends_on_how_many_are_asked_for(taxels: tuple[tuple[float, ...], ...]) -> None:
    surface = PadSurface(Pad(name="tip", taxels=taxels))
    places = np.random.default_rng(0).uniform(-0.005, 0.005, (40, 2))
    one_by_one = [surface.frames(places[k : k + 1]) for k in range(40)]
    assert np.array_equal(surface.frames(places), np.concatenate(one_by_one))
