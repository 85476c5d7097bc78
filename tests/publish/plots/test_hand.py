from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import svg_words
from taxelflow.publish.plots.hand import Moment, at_contacts, field_figure
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
        words = svg_words(save(field_figure(layout, {"mine": moments}, "Slip vectors."), tmp_path / "field.svg"))
    assert "Slip vectors. The longest vector is 50 mm/s." in words
    assert words.count("x in mm") == 2
    assert words.count("y in mm") == 1


def test_a_motion_that_rounds_to_nothing_has_no_minus(tmp_path: Path) -> None:
    pad = Pad(name="pad0", rows=4, cols=6, pitch_m=(0.01, 0.01), origin_m=(0.0, 0.0))
    moment = Moment("1 s", np.zeros((1, 2)), np.array([[0.03, 0.04]]), np.full(3, -1e-6), np.full(2, np.nan))
    with styled():
        figure = field_figure(Sensor(name="grid", unit="Pa", pads=(pad,)).layout, {"mine": [moment]}, "")
        words = " ".join(svg_words(save(figure, tmp_path / "field.svg")))
    assert "(+0.0, +0.0) mm/s, +0.00 rad/s" in words


def two_pads() -> Sensor:
    pads = [
        Pad(name=f"pad{k}", rows=4, cols=6, pitch_m=(0.01, 0.01), origin_m=(0.1 * k, 0.0), angle_rad=k * np.pi / 2)
        for k in range(2)
    ]
    return Sensor(name="grid", unit="Pa", pads=tuple(pads))


@pytest.mark.long
def test_each_method_has_a_row_under_its_name(tmp_path: Path) -> None:
    layout = two_pads().layout
    unknown = np.full(2, np.nan)
    moment = Moment("1 s", layout.T_hand[:, :2], np.full((2, 2), 0.01), np.full(3, np.nan), unknown)
    with styled():
        path = save(field_figure(layout, {"this": [moment] * 3, "that": [moment] * 3}, ""), tmp_path / "field.svg")
    words = svg_words(path)
    assert words.count("x in mm") == 6
    assert {"this", "that"} <= set(words)


def test_vectors_stand_at_the_centre_of_pressure_of_the_object_that_turns_there() -> None:
    layout = two_pads().layout
    pressure = np.zeros(48)
    pressure[[0, 24 + 23]] = 5.0  # upper left of the first pad, lower right of the second
    pose, velocity = np.zeros((2, 3)), np.array([[0.01, 0.0, 2.0]] * 2)
    places, vectors = at_contacts(layout, pose, velocity, pressure)
    np.testing.assert_allclose(places, [[-0.025, 0.015], [0.1 + 0.015, 0.025]], atol=1e-12)
    # v + omega x r in the pad's frame; the second pad is turned by a quarter
    np.testing.assert_allclose(vectors, [[0.01 - 0.03, -0.05], [-0.05, 0.01 + 0.03]], atol=1e-12)


def test_without_pressure_vectors_stand_at_their_poses() -> None:
    layout = two_pads().layout
    pose, velocity = np.array([[0.01, 0.02], [np.nan, np.nan]]), np.full((2, 2), 0.01)
    for pressure in (None, np.zeros(48)):
        places, vectors = at_contacts(layout, pose, velocity, pressure)
        np.testing.assert_allclose(places, pose)
        np.testing.assert_allclose(vectors, [[0.01, 0.01], [-0.01, 0.01]])
