from __future__ import annotations

import numpy as np

from synthetic import grid_sensor
from taxelflow.sensors.skins import PadNoise, skin_of

HAND = grid_sensor(2, 3, pads=2).layout


def test_the_noise_of_a_pad_is_the_median_of_its_taxels() -> None:
    noise = np.array([1.0, 2.0, 3.0, 4.0, 50.0, 60.0, *[7.0] * 6])
    assert PadNoise(HAND).median(noise).tolist() == [3.5, 7.0]


def test_noise_that_is_learned_anew_is_used() -> None:
    pads = PadNoise(HAND)
    pads.median(np.ones(12))
    assert pads.median(np.full(12, 2.0)).tolist() == [2.0, 2.0]


def test_places_are_counted_in_pitches_and_one_skin_serves_all() -> None:
    skin = skin_of(HAND, 1)
    assert np.ptp(skin.places, axis=1).round(9).tolist() == [2.0, 1.0]
    assert skin_of(HAND, 1) is skin
