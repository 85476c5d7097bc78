from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synthetic import assert_same, grid_sensor, pieces, scans_of, unknown_slips
from taxelflow.cli import main
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.smoothing import session as smoothers
from taxelflow.estimation.smoothing.parameters import NOTE, Smoothing
from taxelflow.messages import LOST, OK, Scans, Slips, cut, joined
from taxelflow.pipeline.api import estimate

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

PAD = grid_sensor(3, 3)
STD = np.array([1e-4, 2e-4, 0.01])


class Told:
    """An estimator session that gives out what it was told, scan by scan."""

    def __init__(self, slips: Slips) -> None:
        self._slips, self._given = slips, 0

    def step(self, scans: Scans) -> Slips:
        start, self._given = self._given, self._given + len(scans)
        return cut(self._slips, start, self._given)

    def finish(self) -> Slips:
        return cut(self._slips, self._given, self._given)


def told(t_s: Floats, pose: Floats, *, contact: Any = True) -> tuple[Slips, Scans]:
    """Slips (scans, one pad) of these noisy poses, and scans to step with."""
    scans = scans_of(PAD, np.ones((len(t_s), 9)), t_s=t_s, contact=np.broadcast_to(contact, (len(t_s),)))
    slips = unknown_slips(scans)
    slips.pose[:, 0] = np.where(scans.contact, pose, np.nan)
    slips.covariance[:, 0] = np.where(scans.contact[..., np.newaxis], np.diag(STD**2), np.nan)
    slips.displacement[1:, 0] = np.diff(slips.pose[:, 0], axis=0)
    slips.displacement_covariance[1:, 0] = slips.covariance[1:, 0] + slips.covariance[:-1, 0]
    slips.span_s[1:, 0] = np.diff(t_s)
    slips.lag_s[:], slips.quality[:] = 0.0, OK
    return slips, scans


def smoothed(slips: Slips, *blocks: Scans, mode: Any = "batch", acceleration: float = 1e-3) -> Slips:
    session = Smoothing(acceleration).around(Told(slips), PAD.layout, mode)
    done: Slips = joined([*(session.step(block) for block in blocks), session.finish()])
    return done


def track(seed: int, scans: int = 200, acceleration: float = 1e-3) -> tuple[Floats, Floats, Floats]:
    """Irregular times, true poses (scans, 3) of a velocity that wanders, noisy poses."""
    random = np.random.default_rng(seed)
    dt = random.uniform(0.005, 0.015, scans - 1)
    gyration = 2 * (0.01**2 * 2 / 3 + 0.01**2 / 12)
    scale = acceleration * np.array([1.0, 1.0, gyration**-0.5])
    v, x = 0.01 * random.standard_normal(3), np.zeros(3)
    truth = [x]
    for step in dt:
        a, b = random.standard_normal((2, 3)) * scale
        x = x + v * step + step**1.5 * (a / 2 + b / np.sqrt(12))
        v = v + a * np.sqrt(step)
        truth.append(x)
    poses = np.array(truth)
    return np.concatenate([[0.0], np.cumsum(dt)]), poses, poses + random.standard_normal(poses.shape) * STD


def nees(error: Floats, covariance: Floats) -> float:
    return float(np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariance), error).mean() / 3)


@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_errors_of_poses_and_displacements_fit_their_covariance(mode: str) -> None:
    found, moves = [], []
    for seed in range(12):
        t_s, truth, noisy = track(seed)
        out = smoothed(*told(t_s, noisy), mode=mode)
        found.append(nees(out.pose[20:, 0] - truth[20:], out.covariance[20:, 0]))
        off = out.displacement[20:, 0] - np.diff(truth, axis=0)[19:]
        moves.append(nees(off, out.displacement_covariance[20:, 0]))
    assert 0.75 < np.mean(found) < 1.25
    assert 0.75 < np.mean(moves) < 1.25


def test_a_straight_line_is_known_as_well_as_its_regression() -> None:
    t_s = np.arange(100) / 100
    random = np.random.default_rng(0)
    ratio, velocity = [], []
    for _ in range(60):
        slips, scans = told(t_s, np.outer(t_s, [0.02, 0.0, 0.1]) + random.standard_normal((100, 3)) * STD)
        out = smoothed(slips, scans, acceleration=1e-6)
        ratio.append((out.pose[50, 0] - t_s[50] * np.array([0.02, 0.0, 0.1])) / STD)
        velocity.append(out.velocity[50, 0] - [0.02, 0.0, 0.1])
    assert np.sqrt(np.mean(np.square(ratio))) == pytest.approx(0.1, rel=0.25)  # 1 / sqrt(100) in the middle of a line
    expected = STD * np.sqrt(12 / 100) / 0.99
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(velocity), axis=0)), expected, rtol=0.35)


def test_the_smoother_knows_more_than_the_filter_and_the_filter_more_than_a_pose() -> None:
    t_s, truth, noisy = track(3, 400)
    slips, scans = told(t_s, noisy)
    late, now = smoothed(slips, scans, mode="batch"), smoothed(slips, scans, mode="stream")
    errors = [
        np.sqrt(np.mean((pose - truth)[50:-50] ** 2, axis=0)) for pose in (late.pose[:, 0], now.pose[:, 0], noisy)
    ]
    assert (errors[0] < 0.8 * errors[1]).all()
    assert (errors[1] < 0.8 * errors[2]).all()
    np.testing.assert_allclose(late.pose[-1], now.pose[-1], rtol=1e-6)  # the last scan has no future


@settings(max_examples=15)
@given(
    seed=st.integers(0, 1000), cuts=st.lists(st.integers(0, 120), max_size=8), mode=st.sampled_from(["batch", "stream"])
)
def test_blocks_of_any_size_give_the_same_bits(seed: int, cuts: list[int], mode: str) -> None:
    t_s, _, noisy = track(seed, 120)
    random = np.random.default_rng(seed)
    noisy[random.random(120) < 0.1, 2] = np.nan
    slips, scans = told(t_s, noisy, contact=random.random(120) < 0.97)
    slips.pose[random.random(120) < 0.05] = np.nan
    slips.quality[random.random(120) < 0.03] = LOST
    kept = smoothers._WINDOW
    smoothers._WINDOW = 20
    try:
        assert_same(smoothed(slips, *pieces(scans, cuts), mode=mode), smoothed(slips, scans, mode=mode))
    finally:
        smoothers._WINDOW = kept


def test_a_long_contact_is_given_out_in_windows_that_join(monkeypatch: pytest.MonkeyPatch) -> None:
    t_s, _, noisy = track(5, 300)
    slips, scans = told(t_s, noisy)
    whole = smoothed(slips, scans, acceleration=0.1)
    monkeypatch.setattr(smoothers, "_WINDOW", 100)
    session = Smoothing(0.1).around(Told(slips), PAD.layout, "batch")
    first = session.step(cut(scans, 0, 250))
    assert len(first) == 100
    parts = joined([first, session.step(cut(scans, 250, 300)), session.finish()])
    np.testing.assert_allclose(parts.pose, whole.pose, atol=1e-7)
    np.testing.assert_allclose(parts.displacement[1:], whole.displacement[1:], atol=5e-5)


def test_what_the_method_does_not_know_stays_unknown_and_tracks_do_not_meet() -> None:
    t_s, _, noisy = track(6, 60)
    noisy[:, 2] = np.nan
    contact = np.ones(60, dtype=bool)
    contact[30] = False
    noisy[31:, 0] += 1.0  # another contact, far away
    slips, scans = told(t_s, noisy, contact=contact)
    slips.covariance[:, 0, 2] = slips.covariance[:, 0, :, 2] = np.nan
    slips.quality[45] = LOST
    slips.pose[10] = np.nan
    out = smoothed(slips, scans)
    np.testing.assert_array_equal(np.isnan(out.pose), np.isnan(slips.pose))
    assert np.isnan(out.covariance[:, 0, 2]).all()
    assert (np.abs(out.pose[:, 0, 0] - noisy[:, 0])[contact & np.isfinite(slips.pose[:, 0, 0])] < 1e-3).all()
    np.testing.assert_array_equal(out.pose[45], slips.pose[45])  # lost: left as it is
    np.testing.assert_array_equal(out.contact, slips.contact)


def test_without_acceleration_nothing_is_touched() -> None:
    slips, _ = told(*track(1)[::2])
    session = Told(slips)
    assert Smoothing().around(session, PAD.layout, "batch") is session


@pytest.mark.parametrize("acceleration", [-1.0, float("nan"), float("inf")])
def test_an_acceleration_that_cannot_be_is_refused(acceleration: float) -> None:
    with pytest.raises(ParameterInvalid, match="acceleration_m_s2"):
        Smoothing(acceleration)


def test_a_smoothed_result_is_marked(stroke: Recording) -> None:
    bare = estimate(stroke, "convolution")
    result = estimate(stroke, "convolution", smooth=Smoothing(0.1))
    assert NOTE in result.summary.notes
    assert NOTE not in bare.summary.notes
    assert result.summary.parameters["smooth"] == {"acceleration_m_s2": 0.1}
    assert len(result.slips) == len(bare.slips)


def test_smoothing_leaves_less_noise(stroke: Recording) -> None:
    exact = replace(stroke, sensor=msgspec.structs.replace(stroke.sensor, unseen_error=0.0))
    bare, smoothed = (estimate(exact, "convolution", smooth=Smoothing(most)).slips for most in (0.0, 0.1))
    assert np.nanmean(smoothed.covariance[..., 0, 0]) < np.nanmean(bare.covariance[..., 0, 0])


def test_a_method_that_learns_is_smoothed_and_keeps_what_it_learned(stroke: Recording) -> None:
    bare, result = (estimate(stroke, "template", smooth=smooth) for smooth in (None, Smoothing(0.1)))
    assert len(result.patterns) == len(bare.patterns) == 1
    np.testing.assert_array_equal(result.patterns[0].pressure, bare.patterns[0].pressure)
    assert not np.array_equal(result.slips.pose, bare.slips.pose, equal_nan=True)


def test_the_command_line_smooths(tmp_path: Path) -> None:
    recording = tmp_path / "stroke.npz"
    assert main(["simulate", "stroke", "--out", str(recording)]) == 0
    arguments = ["estimate", str(recording), "--method", "convolution", "--smooth.acceleration-m-s2", "0.1"]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    assert "information that is not in the scans" in (tmp_path / "out" / "summary.json").read_text()
