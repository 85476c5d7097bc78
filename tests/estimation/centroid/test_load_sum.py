from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import METHODS, dome, grid_sensor, recorded, scans_of, slips_by
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.centroid.load_sum import Sum
from taxelflow.pipeline.api import estimate

if TYPE_CHECKING:
    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7, full_scale=140e3)
TWO = grid_sensor(4, 7, pads=2)


def held(loads: Floats, *, noise: float = 200.0, seed: int = 0) -> Floats:
    """A dome of these loads, relative to its own, under noise."""
    random = np.random.default_rng(seed)
    return loads[:, np.newaxis] * dome(PALM) + random.normal(0, noise, (len(loads), 28))


@pytest.mark.parametrize("method", [*METHODS, "sum", "principal_axis"])
def test_every_method_gives_the_load(method: str) -> None:
    values = np.random.default_rng(0).normal(1, 1, (9, 56))
    slips = slips_by(method, TWO, scans_of(TWO, values, contact=np.arange(9) > 3))
    np.testing.assert_allclose(slips.load, [[row[:28].sum(), row[28:].sum()] for row in values], rtol=1e-12)
    assert np.isnan(slips.disturbance).all() == (method != "sum")


def test_it_has_no_position_and_no_direction() -> None:
    slips = slips_by("sum", PALM, scans_of(PALM, held(np.ones(9)), noise=200.0))
    for part in (slips.pose, slips.displacement, slips.covariance, slips.displacement_covariance, slips.lag_s):
        assert np.isnan(part).all()
    assert not slips.valid.any()


def test_its_disturbance_is_the_recursion_of_the_docs() -> None:
    values, sigma = held(np.linspace(1, 1.5, 12) ** 2), 200.0
    t_s = np.cumsum(np.random.default_rng(3).uniform(0.05, 0.3, 12))
    seen = slips_by("sum", PALM, scans_of(PALM, values, t_s=t_s, noise=sigma), cutoff_hz=0.7).disturbance[:, 0]
    tau = 1 / (2 * np.pi * 0.7)
    weights = np.zeros((12, 12))  # of each scan's load in each scan's y
    for k in range(1, 12):
        a = tau / (tau + t_s[k] - t_s[k - 1])
        weights[k] = a * (weights[k - 1] + np.eye(12)[k] - np.eye(12)[k - 1])
    deviation = sigma * 28**0.5 * np.sqrt((weights**2).sum(axis=1))
    expected = np.abs(weights @ values.sum(axis=1))[1:] / deviation[1:]
    np.testing.assert_allclose(seen[1:], expected, rtol=1e-10)
    assert np.isnan(seen[0])


def test_a_steady_load_disturbs_as_much_as_its_noise() -> None:
    seen = slips_by("sum", PALM, scans_of(PALM, held(np.ones(5000)), noise=200.0)).disturbance[1:, 0]
    assert np.sqrt(np.mean(seen**2)) == pytest.approx(1.0, rel=0.05)


def test_a_load_that_changes_is_a_slip_to_it_and_a_slip_at_constant_load_is_none() -> None:
    wide = grid_sensor(9, 21, full_scale=140e3)
    random = np.random.default_rng(1)
    noise = random.normal(0, 100, (80, 189))
    idle = np.zeros((20, 189))
    gripped = np.array([dome(wide) * (1.0 if k < 30 else 1.3) for k in range(60)])
    pulled = np.array([dome(wide, x) for x in np.clip(np.arange(60) - 20, 0, 20) * 0.002 - 0.02])
    grip, pull = (
        estimate(recorded(np.concatenate([idle, part]) + noise, wide), "sum").slipping[:, 0]
        for part in (gripped, pulled)
    )
    assert grip[50]
    assert not grip[70:].any()
    assert np.count_nonzero(pull[32:]) < 24  # a pad judged restless takes its evidence from the pattern


def test_it_begins_anew_at_lift_off() -> None:
    contact = [True] * 4 + [False] + [True] * 4
    slips = slips_by("sum", PALM, scans_of(PALM, held(np.arange(1.0, 10.0)), noise=200.0, contact=contact))
    assert np.isnan(slips.disturbance[:, 0]).tolist() == [True] + [False] * 3 + [True, True] + [False] * 3


@pytest.mark.parametrize("cutoff_hz", [0.0, -1.0, float("nan"), float("inf")])
def test_a_cutoff_that_cannot_work_is_refused(cutoff_hz: float) -> None:
    with pytest.raises(ParameterInvalid, match="cutoff_hz"):
        Sum(cutoff_hz=cutoff_hz)
