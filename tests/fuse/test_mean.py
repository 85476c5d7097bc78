from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import assert_same, dome, grid_sensor, pieces, scans_of, slips_by
from taxelflow.fuse.mean import MeanTranslation
from taxelflow.messages import Floats, Motions, Slips, joined

TWO = grid_sensor(4, 7, pads=2)


def slips_of(values: Floats, **more: object) -> Slips:
    return slips_by("lnorm", TWO, scans_of(TWO, values, **more))  # type: ignore[arg-type]


def fused(*blocks: Slips) -> Motions:
    fusion = MeanTranslation()
    return joined([fusion.step(block) for block in blocks])


def moving(first: Floats, second: Floats) -> Floats:
    """Domes on both pads at these places along x."""
    return np.array([dome(TWO, x) + dome(TWO, x2, pad=1) for x, x2 in zip(first, second, strict=True)])


STEPS = np.arange(5) * 0.01 - 0.02


def test_the_motion_is_the_mean_over_pads() -> None:
    motions = fused(slips_of(moving(STEPS, 0 * STEPS)))
    np.testing.assert_allclose(motions.velocity[1:, 0], 0.05, atol=1e-12)
    np.testing.assert_allclose(motions.pose[:, 0], 0.005 * np.arange(5), atol=1e-12)
    assert motions.pads.tolist() == [0, 2, 2, 2, 2]


def test_a_pad_that_knows_nothing_has_no_say() -> None:
    contact = np.ones((5, 2), bool)
    contact[:, 1] = False
    motions = fused(slips_of(moving(STEPS, -STEPS), contact=contact))
    np.testing.assert_allclose(motions.velocity[1:, 0], 0.1, atol=1e-12)
    np.testing.assert_allclose(motions.pose[:, 0], 0.01 * np.arange(5), atol=1e-12)
    assert motions.pads.tolist() == [0, 1, 1, 1, 1]


def test_a_pad_that_joins_later_does_not_make_the_object_jump() -> None:
    contact = np.ones((5, 2), bool)
    contact[:2, 1] = False
    motions = fused(slips_of(moving(0 * STEPS, 0 * STEPS + 0.02), contact=contact))
    np.testing.assert_array_equal(motions.pose[:, :2], 0)


def test_nothing_is_known_while_nothing_touches() -> None:
    contact = np.array([True, True, False, False, True])
    motions = fused(slips_of(moving(STEPS, STEPS), contact=contact))
    assert np.isnan(motions.velocity[[0, 2, 3, 4]]).all()
    assert np.isfinite(motions.pose[:, 0]).tolist() == [True, True, False, False, True]
    assert motions.pads.tolist() == [0, 2, 0, 0, 0]


def test_a_new_contact_starts_at_zero() -> None:
    contact = np.array([True, True, False, True, True])
    motions = fused(slips_of(moving(STEPS, STEPS), contact=contact))
    np.testing.assert_allclose(motions.pose[:, 0], [0, 0.01, np.nan, 0, 0.01], atol=1e-12)


def test_rotation_is_unknown() -> None:
    motions = fused(slips_of(moving(STEPS, STEPS)))
    assert np.isnan(motions.velocity[:, 2]).all()
    assert np.isnan(motions.pose[:, 2]).all()
    assert np.isnan(motions.velocity_covariance[:, 2]).all()


def test_two_equal_independent_pads_halve_the_variance() -> None:
    values = np.array([dome(TWO) + dome(TWO, pad=1)] * 4)
    alone = np.ones((4, 2), bool)
    alone[:, 1] = False
    one, two = (
        fused(slips_by("convolution", TWO, scans_of(TWO, values, noise=100.0, contact=contact)))
        for contact in (alone, True)
    )
    np.testing.assert_allclose(two.velocity_covariance[2:, :2, :2], one.velocity_covariance[2:, :2, :2] / 2)


def test_the_covariance_is_that_of_the_velocity() -> None:
    t_s = np.array([0.0, 0.1, 0.3, 0.7])
    values = np.array([dome(TWO)] * 4)
    contact = np.ones((4, 2), bool)
    contact[:, 1] = False
    slips = slips_by("convolution", TWO, scans_of(TWO, values, noise=100.0, t_s=t_s, contact=contact))
    expected = slips.displacement_covariance[3, 0, 0, 0] / slips.span_s[3, 0] ** 2
    assert fused(slips).velocity_covariance[3, 0, 0] == pytest.approx(expected)


@given(
    seed=st.integers(0, 1000), cuts=st.lists(st.integers(0, 40), max_size=10), pads=st.sampled_from([1, 2, 7, 8, 9, 19])
)
def test_motions_do_not_depend_on_how_slips_are_cut(seed: int, cuts: list[int], pads: int) -> None:
    random = np.random.default_rng(seed)
    sensor = grid_sensor(2, 3, pads=pads)
    scans = scans_of(sensor, random.random((40, 6 * pads)), noise=0.1, contact=random.random((40, pads)) < 0.8)
    slips = slips_by("convolution", sensor, scans)
    assert_same(fused(*pieces(slips, cuts)), fused(slips))


def test_an_empty_block_gives_an_empty_block() -> None:
    assert len(fused(slips_of(np.zeros((0, 56))))) == 0
