from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import poisson

from taxelflow.messages import AMBIGUOUS, Slips
from taxelflow.sensors.layout import Layout
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor
from taxelflow.slip.pad_agreement import PadAgreement, facing_pads
from taxelflow.slip.parameters import SlipMonitor

DT_S, STD_M = 0.01, 3e-6
LEFT, RIGHT = (0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, 0.5)
"""Pads that face each other along x, both with their y axis up."""
UP, MIRRORED = np.array([0.0, 1.0]), np.array([-1.0, 1.0])


def hand(*quaternions: tuple[float, float, float, float] | None) -> Layout:
    poses = [None if one is None else (0.02 * number, 0.0, 0.0, *one) for number, one in enumerate(quaternions)]
    pads = [Pad(f"pad{n}", rows=3, cols=3, pitch_m=(0.002, 0.002), pose=pose) for n, pose in enumerate(poses)]
    return Sensor("two", "Pa", tuple(pads)).layout


def slips(moved: np.ndarray, std_m: float = STD_M, load: np.ndarray | None = None) -> Slips:
    """moved: (scans, 2, 2), displacements of two pads, each in its own frame."""
    scans = len(moved)
    three, matrix = np.zeros((scans, 2, 3)), np.zeros((scans, 2, 3, 3))
    three[..., :2] = moved
    matrix[..., [0, 1, 2], [0, 1, 2]] = 2 * std_m**2
    one, yes = np.ones((scans, 2)), np.ones((scans, 2), dtype=bool)
    loads = one if load is None else np.repeat(load[:, np.newaxis], 2, axis=1)
    quality = np.full((scans, 2), AMBIGUOUS, dtype=np.uint8)
    border = np.zeros((scans, 2, 2), dtype=bool)
    t_s = DT_S * np.arange(scans)
    return Slips(t_s, yes, border, three, three, matrix, matrix, DT_S * one, 0 * one, loads, np.nan * one, quality)


def at_rest(scans: int, seed: int = 0, std_m: float = STD_M) -> np.ndarray:
    return np.diff(np.random.default_rng(seed).normal(0.0, std_m, (scans + 1, 2, 2)), axis=0)


def sliding(speed_m_s: float, scans: int) -> np.ndarray:
    """(scans, 2, 2): an object that slides aslant."""
    one = speed_m_s * DT_S * np.array([0.6, 0.8])
    return np.tile(np.stack([one, MIRRORED * one]), (scans, 1, 1))


def watch(alarms_per_hour: float = 1.0) -> PadAgreement:
    options = SlipMonitor(alarms_per_hour=alarms_per_hour)
    return PadAgreement(hand(LEFT, RIGHT), options.alarms_per_hour, options.creep_m_s, options.load_m)


def agreed(
    moved: np.ndarray, reported_m: float = STD_M, alarms_per_hour: float = 1.0, **parts: np.ndarray
) -> np.ndarray:
    return watch(alarms_per_hour).step(slips(moved, reported_m, **parts))


@pytest.mark.parametrize("speed_m_s", [0.01, 0.1])
def test_pads_that_measure_the_same_motion_agree_within_two_scans(speed_m_s: float) -> None:
    moved = at_rest(60)
    moved[40:50] += sliding(speed_m_s, 10)
    found = agreed(moved)
    assert not found[:40].any()
    assert found[41:50].all()
    assert not found[58:].any()


def test_a_scatter_that_was_learned_during_creep_does_not_silence_them() -> None:
    """Both pads' poses scatter four times as much as reported; the slip is as clear in their agreement."""
    moved = at_rest(300, std_m=4 * STD_M)
    moved[250:] += sliding(0.05, 50)
    found = agreed(moved)
    assert not found[:250].any()
    assert found[252:].all()


def test_pads_that_contradict_each_other_are_no_slip() -> None:
    moved = at_rest(200)
    moved[100:, 0] += 0.05 * DT_S * UP
    moved[100:, 1] -= 0.05 * DT_S * UP
    assert not agreed(moved).any()


def test_what_load_moves_in_both_pads_is_no_slip() -> None:
    load = np.exp(np.linspace(0.0, 2.0, 100))
    moved = at_rest(100) + 0.5e-3 * UP * np.diff(np.log(load), prepend=0.0)[:, np.newaxis, np.newaxis]
    assert agreed(moved).any()
    assert not agreed(moved, load=load).any()


def test_nor_is_it_in_the_scans_after_the_load_has_changed_at_once() -> None:
    load = np.where(np.arange(100) < 60, 1.0, 1.3)
    moved = at_rest(100) + 0.5e-3 * UP * np.diff(np.log(load), prepend=0.0)[:, np.newaxis, np.newaxis]
    assert not agreed(moved, load=load).any()


@pytest.mark.long
@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_false_alarms_come_no_more_often_than_accepted(factor: float) -> None:
    """White noise in the poses, `factor` times as large as reported: 200 s at an accepted alarm per 2.5 s."""
    scans, rate = 20_000, 1440.0
    found = agreed(at_rest(scans, seed=1, std_m=factor * STD_M), alarms_per_hour=rate)[:, 0]
    starts = int((found[1:] & ~found[:-1]).sum())
    assert starts <= poisson.ppf(0.999, scans * DT_S * rate / 3600.0)


def test_unknown_motion_ends_an_agreed_slip() -> None:
    moved = at_rest(60)
    moved[30:] += sliding(0.1, 30)
    moved[45, 1] = np.nan
    found = agreed(moved)
    assert found[32:45].all()
    assert not found[45].any()


def test_the_blocks_do_not_matter() -> None:
    moved = at_rest(80)
    moved[40:60] += sliding(0.02, 20)
    agreement = watch()
    parts = [agreement.step(slips(moved[start : start + 7])) for start in range(0, 80, 7)]
    np.testing.assert_array_equal(np.concatenate(parts), agreed(moved))


def test_only_pads_that_face_each_other_in_space_are_compared() -> None:
    ((pads, to_first),) = facing_pads(hand(LEFT, RIGHT))
    assert pads == (0, 1)
    np.testing.assert_allclose(to_first, np.diag(MIRRORED), atol=1e-12)
    assert not facing_pads(hand(LEFT, LEFT))
    assert not facing_pads(hand(LEFT, None))
    assert not facing_pads(hand(None, None))


@pytest.mark.long
def test_poses_that_walk_within_their_covariance_do_not_agree_on_a_slip() -> None:
    """Two pads on a plate: what of each step's noise stays in the pose adds up in a window."""
    scans, random = 6000, np.random.default_rng(5)
    moved = at_rest(scans, 4) + random.normal(0.0, 2.0 * STD_M, (scans, 2, 2))
    grown = np.eye(3) * STD_M**2 * (1.0 + 4.0 * np.arange(scans))[:, np.newaxis, np.newaxis]
    own = np.broadcast_to(6.0 * STD_M**2 * np.eye(3), (scans, 2, 3, 3)).copy()
    grown = np.repeat(grown[:, np.newaxis], 2, axis=1)
    false = watch(1000.0).step(replace(slips(moved), displacement_covariance=own, covariance=grown))
    assert false[:, 0].sum() <= poisson.isf(1e-3, 1000 * scans * DT_S / 3600)  # 171 without the walk
    with_slip = moved + np.concatenate([np.zeros((scans - 20, 2, 2)), sliding(0.05, 20)])
    found = watch().step(replace(slips(with_slip), displacement_covariance=own, covariance=grown))
    assert found[-10:].any()
