"""The rest filter against a Kalman filter in matrix form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiled import compiled
from taxelflow.messages import Floats
from taxelflow.numerics.records import records
from taxelflow.slip.measurement import Measurement, Parameters
from taxelflow.slip.rest_filter import (
    RestState,
)
from taxelflow.slip.rest_filter import (
    correlation_inflation as _correlation_inflation,
)
from taxelflow.slip.rest_filter import (
    discount_noise_scale as _discount_noise_scale,
)
from taxelflow.slip.rest_filter import (
    noise_scale as _noise_scale,
)
from taxelflow.slip.rest_filter import (
    start_rest as _start_rest,
)
from taxelflow.slip.rest_filter import (
    update_rest as _update_rest,
)

noise_scale = compiled(_noise_scale)
correlation_inflation = compiled(_correlation_inflation)
start_rest = compiled(_start_rest)
discount_noise_scale = compiled(_discount_noise_scale)
update_rest = compiled(_update_rest)

STD, LOAD_M, CREEP_M_S = np.array([2e-5, 3e-5, 1e-3]), 1e-3, 1e-4


class Filter:
    """The kernels with their records."""

    def __init__(self, position: Floats, log_load: float = 0.0) -> None:
        self.measurement, self.parameters, self.rest = (
            records(fields, 1)[0] for fields in (Measurement, Parameters, RestState)
        )
        self.parameters["load_m"], self.parameters["creep_m_s"] = LOAD_M, CREEP_M_S
        start_rest(position, STD[0] ** 2, log_load, self.parameters, self.rest)

    def update(self, t_s: float, position: Floats, log_load: float = 0.0, yaw: bool = True) -> Any:
        self.measurement["previous_s"], self.measurement["t_s"] = self.measurement["t_s"], t_s
        self.measurement["position"], self.measurement["log_load"] = position, log_load
        self.measurement["covariance"]["variance"] = STD**2 * [1, 1, 1 if yaw else np.nan]
        update_rest(self.measurement, self.parameters, self.rest)
        return self.rest["innovation"]


@given(seed=st.integers(0, 99), dt_s=st.floats(0.002, 0.5), walk=st.sampled_from([0.0, 0.5]))
@settings(max_examples=20, deadline=None)
def test_it_is_a_kalman_filter(seed: int, dt_s: float, walk: float) -> None:
    random = np.random.default_rng(seed)
    poses, load = STD * random.standard_normal((20, 3)), np.cumsum(0.3 * random.standard_normal(20))
    kernel, x = Filter(poses[0], load[0]), np.array([poses[0], np.zeros(3), np.zeros(3)])
    kernel.measurement["walk"] = walk
    prior = np.diag([0.0, LOAD_M**2, CREEP_M_S**2])
    p, keep = np.diag([STD[0] ** 2, 0.0, 0.0]) + prior, np.exp(-dt_s)
    for k in range(1, 20):
        scale = noise_scale(kernel.rest)
        step = kernel.update(k * dt_s, poses[k], load[k])
        model = np.array([[1.0, load[k] - load[k - 1], dt_s], [0.0, keep, 0.0], [0.0, 0.0, keep]])
        x, p = model @ x, model @ p @ model.T + (1 - keep**2) * prior
        r = scale * (STD[0] ** 2 + STD[1] ** 2) / 2
        p[0, 0] += walk * r
        gain, u = p[:, 0] / (p[0, 0] + r), (poses[k] - x[0]) / STD * np.sqrt(r / (p[0, 0] + r))
        x, p = x + np.outer(gain, poses[k] - x[0]), p - np.outer(gain, p[0])
        np.testing.assert_allclose([step["gain_a"], step["gain_b"], step["gain_c"]], gain, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(step["whitened"], u, rtol=1e-6, atol=1e-9)
        assert step["variance"] == pytest.approx(r)
    rest = kernel.rest
    np.testing.assert_allclose([rest["position"], rest["load_gain"], rest["creep"]], x, rtol=1e-6, atol=1e-12)
    upper = [rest[f"p_{name}"] for name in ("aa", "ab", "ac", "bb", "bc", "cc")]
    np.testing.assert_allclose(upper, p[np.triu_indices(3)], rtol=1e-6, atol=1e-18)


def after_noise(scale: float, correlation: float = 0.0, count: int = 3000) -> Any:
    random, kernel, noise = np.random.default_rng(1), Filter(np.zeros(3)), np.zeros(3)
    kernel.rest["p_bb"] = kernel.rest["p_cc"] = 0.0
    for k in range(1, count):
        noise = correlation * noise + np.sqrt(1 - correlation**2) * random.standard_normal(3)
        kernel.update(k / 100, scale * STD * noise)
    return kernel.rest


@pytest.mark.parametrize(
    ("scale", "learned"), [(1.0, 1.0), (2.0, 4.0), (0.5, 0.9), (9.0, 25.0)], ids=["right", "small", "large", "limit"]
)
def test_the_scale_of_the_noise_is_learned_within_limits(scale: float, learned: float) -> None:
    assert noise_scale(after_noise(scale)) == pytest.approx(learned, rel=0.1)


def test_before_any_pose_the_scale_is_1() -> None:
    assert noise_scale(records(RestState, 1)[0]) == 1.0


def test_noise_that_hangs_together_inflates_the_variance_of_a_mean() -> None:
    assert correlation_inflation(after_noise(1.0)) < 1.1
    inflated = correlation_inflation(after_noise(1.0, 0.5))
    assert 2.0 < inflated < 3.2  # (1 + 0.5) / (1 - 0.5) is 3; the filter takes some of the slowest noise
    assert correlation_inflation(after_noise(1.0, 0.97)) <= 9.0


def test_products_count_a_block_later_so_that_a_slip_not_yet_found_is_not_among_them() -> None:
    kernel = Filter(np.zeros(3))
    sums = []
    for k in range(1, 49):
        kernel.update(k / 100, STD * [3, 3, 3])
        sums.append(float(kernel.rest["product_sum"]))
    assert sums[:31] == [0.0] * 31
    assert sums[31] > 0.0


def test_a_scale_below_1_counts_at_steady_load_only() -> None:
    rest = after_noise(0.5, count=500)
    assert noise_scale(rest) < 1.0
    rest["load_variance"] = 0.06
    assert noise_scale(rest) == 1.0


def test_another_contact_keeps_a_scale_above_1_with_the_weight_of_the_prior() -> None:
    for scale, kept in ((2.0, 4.0), (0.5, 1.0)):
        rest = after_noise(scale)
        discount_noise_scale(rest)
        assert rest["components"] == 20.0
        assert noise_scale(rest) == pytest.approx(kept, rel=0.1)
        assert correlation_inflation(rest) == 1.0


def test_a_turn_counts_again_after_twenty_poses_from_their_mean() -> None:
    kernel = Filter(np.zeros(3))
    assert kernel.update(0.01, np.zeros(3))["yaw_used"]
    assert not kernel.update(0.02, np.zeros(3), yaw=False)["yaw_used"]
    used = [bool(kernel.update(0.03 + k / 100, STD * [0, 0, k])["yaw_used"]) for k in range(20)]
    assert not any(used)
    assert kernel.rest["position"][2] == pytest.approx(STD[2] * 9.5)
    assert kernel.update(0.3, np.zeros(3))["yaw_used"]


def test_only_what_is_known_counts_in_the_scale() -> None:
    kernel = Filter(np.zeros(3))
    assert kernel.rest["components"] == 20.0
    kernel.update(0.01, np.zeros(3))
    three = float(kernel.rest["components"])
    kernel.update(0.02, np.zeros(3), yaw=False)
    assert three == pytest.approx(23, abs=0.1)
    assert kernel.rest["components"] == pytest.approx(25, abs=0.1)
