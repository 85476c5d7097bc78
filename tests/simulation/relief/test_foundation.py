from __future__ import annotations

import numpy as np
import pytest

from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.relief.cases import PLACES, sensor_at
from taxelflow.simulation.relief.foundation import foundation_of
from taxelflow.simulation.relief.parameters import Skin

LAYOUT = load_sensor("grid:8x6@4x3mm,kPa").layout


@pytest.mark.parametrize("place", PLACES)
def test_a_taxel_reads_a_uniform_pressure_as_it_is(place: str) -> None:
    layout = sensor_at(PLACES[place]).layout
    pad = layout.pads.index(PLACES[place].pad)
    pitch = layout.pitch_m[pad]
    skin = foundation_of(layout, pad, Skin(cover_m=(0.15 * pitch[0], 0.1 * pitch[1])))
    ones = np.ones(len(skin.x_m))
    assert skin.bare @ ones == pytest.approx(np.ones(len(layout.x_m[layout.of_pad(pad)])))
    assert skin.weights @ ones == pytest.approx(1.0, abs=1e-3)
    assert 24_000 < len(skin.x_m) < 40_000


def test_a_linear_pressure_is_read_at_the_taxels_centre() -> None:
    for skin in (foundation_of(LAYOUT, 0, Skin()), foundation_of(LAYOUT, 0, Skin(cover_m=(4e-4, 4e-4)))):
        slope = 5e6 * skin.x_m - 2e6 * skin.y_m
        assert skin.weights @ slope == pytest.approx(5e6 * LAYOUT.x_m - 2e6 * LAYOUT.y_m, abs=50.0)


def test_a_cover_spreads_by_its_own_width_along_each_axis() -> None:
    taxel = 21
    for cover_m in ((6e-4, 0.0), (0.0, 6e-4), (9e-4, 5e-4)):
        skin, plain = foundation_of(LAYOUT, 0, Skin(cover_m=cover_m)), foundation_of(LAYOUT, 0, Skin())
        for axis, sigma_m in zip((skin.x_m, skin.y_m), cover_m, strict=True):
            variances = []
            for weights in (skin.weights, plain.weights):
                row = weights[[taxel]].toarray()[0]
                variances.append(row @ (axis - row @ axis) ** 2)
            assert variances[0] - variances[1] == pytest.approx(sigma_m**2, rel=0.05, abs=1e-10)


def test_the_skin_is_a_pitch_wider_than_the_taxels() -> None:
    skin = foundation_of(LAYOUT, 0, Skin())
    area = len(skin.x_m) * skin.cell_m2
    assert area == pytest.approx((5 + 2) * 4e-3 * (7 + 2) * 3e-3)
