"""What every method owes to equivalent inputs: mirrored pads, pads in another order, declared offsets."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from elastic_skin import PLACES, RATE_HZ, SENSOR, on_skin, pressed
from synthetic import conditioned, dome, grid_sensor, recorded
from taxelflow.numerics.rest_or_slide import compare
from taxelflow.numerics.slid import Skin
from taxelflow.pipeline import api

SKIN = Skin.of(PLACES.T)
MIRRORED = np.array([np.flatnonzero((place * (-1, 1) == PLACES).all(axis=1))[0] for place in PLACES])
"""(taxels,), the taxel in the place of each one's mirror image."""


@pytest.mark.parametrize("seed", range(5))
def test_the_mirror_image_of_a_slide_is_the_slide_of_the_mirror_image(seed: int) -> None:
    random = np.random.default_rng(seed)
    before, after = (np.round(1e3 * pressed(x=x, y=-0.5 * x) * random.uniform(0.5, 1.5, len(PLACES))) for x in (0, 0.6))
    one, other = (
        compare(SKIN, before[order], after[order], 1.0, np.zeros(3)) for order in (np.arange(len(PLACES)), MIRRORED)
    )
    np.testing.assert_allclose(other, one._replace(x=-one.x), rtol=1e-6)


@pytest.mark.parametrize("method", ["lnorm", "convolution", "registration"])
def test_in_a_batch_the_order_of_the_pads_does_not_matter(method: str) -> None:
    t_s = np.arange(round(4.0 * RATE_HZ)) / RATE_HZ
    rocked, slid = 0.08 * np.sin(2 * np.pi * 0.7 * t_s), np.clip(t_s - 1.0, 0.0, 2.0) - 1.0
    raw = [on_skin(slid, rocked, seed=seed).load() for seed in (0, 1)]
    pads = tuple(msgspec.structs.replace(SENSOR.pads[0], name=name) for name in ("one", "other"))
    sensor = msgspec.structs.replace(SENSOR, pads=pads)
    results = [
        api.estimate(recorded(np.hstack([raw[a].values, raw[1 - a].values]), sensor, raw[0].t_s), method).slips
        for a in (0, 1)
    ]
    for part in ("pose", "covariance", "quality"):
        one, other = (getattr(each, part) for each in results)
        np.testing.assert_allclose(one, other[:, ::-1], rtol=1e-6, atol=1e-12, err_msg=part)


@pytest.mark.parametrize("gain", [1.0, 0.8])
def test_offsets_that_a_sensor_declares_change_no_noise_where_numbers_end_at_0(gain: float) -> None:
    random = np.random.default_rng(0)
    load = dome(grid_sensor(6, 6), -0.015, 0.015, peak=1e3) * np.repeat([[0.0], [1.0]], 100, axis=0)
    numbers = np.maximum(np.round(load + random.normal(0.0, 4.0, load.shape)), 0.0)
    plain = grid_sensor(6, 6, unit="count")
    offset, gains = random.integers(0, 4, 36).astype(float), (gain,) * 36
    declared = msgspec.structs.replace(plain, offset=tuple(offset.tolist()), gain=gains)
    (one, _), (other, _) = conditioned(numbers, plain), conditioned((numbers - offset) * gain, declared)
    np.testing.assert_allclose(other.noise, gain * one.noise, rtol=0.05)
    np.testing.assert_array_equal(other.contact, one.contact)
