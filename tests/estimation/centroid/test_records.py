from __future__ import annotations

import numpy as np

from synthetic import grid_sensor
from taxelflow.estimation.centroid.records import pads_of


def test_a_pad_has_its_entries_pitch_and_gains() -> None:
    sensor = grid_sensor(4, 7, pads=2, pitch_m=(0.01, 0.006))
    pads = pads_of(sensor.layout, np.array([[1.0, 2.0], [3.0, 4.0]]))
    assert (pads["begin"].tolist(), pads["end"].tolist()) == ([0, 28], [28, 56])
    assert [pads[field][1].item() for field in ("pitch_x", "pitch_y", "gain_x", "gain_y")] == [0.01, 0.006, 3.0, 4.0]


def test_only_full_grids_with_long_rows_are_summed_row_by_row() -> None:
    lengths = []
    for shape, missing in (((4, 15), ()), ((4, 16), ()), ((4, 16), ((1, 2),))):
        layout = grid_sensor(*shape, missing=missing).layout
        lengths += pads_of(layout, np.ones((1, 2)))["row_length"].tolist()
    assert lengths == [0, 16, 0]
