from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rigged import svg_words
from taxelflow.publish.plots.hand import Moment, field_figure
from taxelflow.publish.plots.style import save, styled
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from pathlib import Path


def test_slip_vectors_have_their_scale_and_axes_their_unit(tmp_path: Path) -> None:
    pad = Pad(name="pad0", rows=4, cols=6, pitch_m=(0.01, 0.01), origin_m=(0.0, 0.0))
    layout = Sensor(name="grid", unit="Pa", pads=(pad,)).layout
    vectors = np.array([[0.03, 0.04]])
    moments = [
        Moment(f"{t_s} s", np.zeros((1, 2)), share * vectors, np.array([0.03, 0.04, np.nan]), np.full(2, np.nan))
        for t_s, share in ((1, 1.0), (2, 0.2))
    ]
    with styled():
        words = svg_words(save(field_figure(layout, moments, "Slip vectors."), tmp_path / "field.svg"))
    assert "Slip vectors. The longest vector is 50 mm/s." in words
    assert words.count("x in mm") == 2
    assert words.count("y in mm") == 1
