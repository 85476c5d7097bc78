"""Poses of objects whose load shifts: what the covariance holds while they rest, and when they slide."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from costly import mostly_long
from elastic_skin import PITCH_M, RATE_HZ, SENSOR, on_skin
from synthetic import assert_same, recorded
from taxelflow.estimation import rest_hypothesis
from taxelflow.estimation.rest_hypothesis import RestHypothesis, Shifts
from taxelflow.estimation.rest_weight import share_of_motion
from taxelflow.messages import AMBIGUOUS, OK, cut
from taxelflow.numerics.bins import Bin
from taxelflow.numerics.rest_or_slide import compare
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Floats, Slips

both = pytest.mark.parametrize("mode", ["batch", "stream"])
mostly_streams = pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "stream"))
T_S = np.arange(round(5.0 * RATE_HZ)) / RATE_HZ
FIRST = round(RATE_HZ)
"""Scan of the first contact."""
AT_REST = np.zeros(len(T_S))
ROCKED = 0.08 * np.sin(2 * np.pi * 0.7 * T_S)
SLID = 2.4 * np.clip(T_S - 3.0, 0.0, 0.8) / 0.8 - 1.2
"""By 2.4 pitches."""


def errors(slips: Slips, slid: Floats) -> tuple[Floats, Floats]:
    """(n, 2), errors of `ok` poses beside the first ones, m, and their standard deviations.

    slid: (scans,), pitches along x in contact.
    """
    true = np.zeros((len(slips), 2))
    true[FIRST : FIRST + len(slid), 0] = PITCH_M * slid
    error = slips.pose[:, 0, :2] - true
    ok = (slips.quality[:, 0] == OK) & np.isfinite(error[:, 0])
    error -= error[ok][:5].mean(axis=0)
    return error[ok], np.sqrt(np.diagonal(slips.covariance[ok, 0, :2, :2], axis1=1, axis2=2))


@pytest.mark.parametrize(
    ("method", "mode"),
    [
        *product(["convolution", "registration"], ["batch", "stream"]),
        *mostly_long([("template", "batch"), ("template", "stream")], ("template", "stream")),
    ],
)
def test_an_object_that_is_rocked_at_rest_has_no_ok_pose_elsewhere(method: str, mode: Mode) -> None:
    slips = api.estimate(on_skin(AT_REST, ROCKED), method, mode=mode).slips
    error, deviation = errors(slips, AT_REST)
    assert len(error) > 30
    assert np.mean(np.abs(error) > 3.0 * deviation + 3e-4) < 0.02


def test_it_would_have_without_the_hypothesis_of_rest() -> None:
    exact = replace(on_skin(AT_REST, ROCKED), sensor=msgspec.structs.replace(SENSOR, unseen_error=0.0))
    error, deviation = errors(api.estimate(exact, "registration", mode="stream").slips, AT_REST)
    assert np.mean(np.abs(error) > 3.0 * deviation + 3e-4) > 0.1


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
def test_an_object_that_slides_and_stays_is_ok_there(mode: Mode) -> None:
    slips = api.estimate(on_skin(SLID, AT_REST), "template", mode=mode).slips
    error, deviation = errors(slips, SLID)
    assert (slips.quality[FIRST + 230 : FIRST + 245, 0] == OK).all()
    assert np.mean(np.abs(error) > 3.0 * deviation + 3e-4) < 0.02


def test_a_batch_knows_that_a_slide_was_one_from_its_beginning() -> None:
    slides, begins = on_skin(SLID, AT_REST), slice(FIRST + 150, FIRST + 170)
    batch, stream = (api.estimate(slides, "convolution", mode=mode).slips for mode in ("batch", "stream"))
    assert (batch.covariance[begins, 0, 0, 0] < stream.covariance[begins, 0, 0, 0]).any()
    assert batch.covariance[begins, 0, 0, 0].max() < (0.3 * PITCH_M) ** 2


@mostly_streams
def test_results_do_not_depend_on_blocks(mode: Mode) -> None:
    whole = on_skin(SLID, ROCKED)
    values = np.concatenate([scans.values for scans in whole.blocks()])
    parts = recorded(values, SENSOR, np.arange(len(values)) / RATE_HZ, block=7)
    assert_same(*(api.estimate(each, "registration", mode=mode).slips for each in (parts, whole)))


HAND = msgspec.structs.replace(
    SENSOR, pads=tuple(msgspec.structs.replace(SENSOR.pads[0], name=name) for name in ("one", "two", "three"))
)


def held(block: int) -> Recording:
    """Three pads with the same object, rocked, in blocks of this many scans."""
    values = np.concatenate([scans.values for scans in on_skin(SLID, ROCKED).blocks()])[: FIRST + 100]
    return recorded(np.tile(values, 3), HAND, np.arange(len(values)) / RATE_HZ, block=block)


def test_the_pads_of_a_hand_are_compared_in_scans_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[int] = []
    step = RestHypothesis.step

    def counting(self: RestHypothesis, slips: Slips) -> None:
        for scan in range(len(slips)):
            before = len(calls)
            step(self, cut(slips, scan, scan + 1))
            compared.append(len(calls) - before)

    calls: list[object] = []
    monkeypatch.setattr(RestHypothesis, "step", counting)
    monkeypatch.setattr(
        rest_hypothesis, "compare", lambda *args, **kwargs: calls.append(args) or compare(*args, **kwargs)
    )
    api.estimate(held(50), "registration", mode="stream")
    assert len(calls) > 10
    assert max(compared) == 1


@mostly_streams
def test_results_of_a_hand_do_not_depend_on_blocks(mode: Mode) -> None:
    assert_same(*(api.estimate(held(block), "registration", mode=mode).slips for block in (7, 50)))


@both
def test_the_covariance_of_a_rocked_object_holds_its_distance_from_its_reference(mode: Mode) -> None:
    slips = api.estimate(on_skin(AT_REST, ROCKED), "registration", mode=mode).slips
    doubted = slips.quality[:, 0] == AMBIGUOUS
    away = np.abs(slips.pose[:, 0, 0] - slips.pose[slips.quality[:, 0] == OK][0, 0, 0])
    assert doubted.any()
    assert np.sqrt(slips.covariance[doubted, 0, 0, 0]).max() > 0.5 * away[doubted].max()


@both
@pytest.mark.parametrize("method", ["convolution", "registration"])
def test_an_object_that_is_rocked_at_rest_moves_less_than_its_load(
    method: str, mode: Mode, monkeypatch: pytest.MonkeyPatch
) -> None:
    rocked, still = on_skin(AT_REST, 0.5 * ROCKED), slice(FIRST + 30, FIRST + 245)
    weighed = api.estimate(rocked, method, mode=mode).slips.pose[still, 0, 0]
    monkeypatch.setattr(RestHypothesis, "weighed", lambda _self, slips, *_args: slips)
    alone = api.estimate(rocked, method, mode=mode).slips.pose[still, 0, 0]
    assert np.nanstd(weighed) < (0.8 if mode == "batch" else 0.95) * np.nanstd(alone)


@given(x=st.floats(-1.0, 1.0), std=st.floats(0.01, 1.0), rests=st.floats(0.0, 9.0))
def test_an_object_has_gone_the_less_of_a_distance_the_likelier_noise_explains_it(
    x: float, std: float, rests: float
) -> None:
    cov = np.diag([std**2, 1.0])
    share = share_of_motion(x, 0.0, cov, rests, 1.0)
    assert 0.0 <= share <= 1.0
    assert share_of_motion(1.5 * x, 0.0, cov, rests, 1.0) >= share
    assert share_of_motion(x, 0.0, 4.0 * cov, rests, 1.0) <= share
    assert share_of_motion(x, 0.0, 1e9 * cov, rests, std**2) == pytest.approx(share)  # open: no reason for rest
    assert share_of_motion(x, 0.0, np.full((2, 2), np.nan), rests, std**2) == pytest.approx(share)
    assert share_of_motion(x, 0.0, cov, rests + 1.0, 1.0) <= share
    if abs(x) > 9.0 * std:
        assert share > 0.999


@both
def test_what_a_load_did_to_poses_at_rest_is_in_their_covariance_when_the_object_slides(mode: Mode) -> None:
    rocked, even = (api.estimate(on_skin(SLID, load), "convolution", mode=mode).slips for load in (ROCKED, AT_REST))
    still, slides = slice(FIRST + 50, FIRST + 140), slice(FIRST + 185, FIRST + 195)
    shift = np.var(rocked.pose[still, 0, 0])
    more = rocked.covariance[slides, 0, 0, 0] - even.covariance[slides, 0, 0, 0]
    assert shift > (0.1 * PITCH_M) ** 2
    assert np.median(more) > 0.3 * shift


PULLED = 0.12 * np.clip(T_S - 1.2, 0.0, 1.0)
"""From 1.2 to 2.2 s, and on: before the slide."""


@pytest.mark.long
def test_what_a_pull_has_shifted_stays_in_the_covariance_of_a_slide() -> None:
    slips = api.estimate(on_skin(SLID, PULLED), "template", mode="batch").slips
    pulls, slides = slice(FIRST + 90, FIRST + 145), slice(FIRST + 150, FIRST + 245)
    touched = slips.pose[FIRST + 20, 0, :2]
    shift_m = float(np.hypot(*(slips.pose[FIRST + 140, 0, :2] - touched)))
    assert shift_m > 0.3 * PITCH_M
    for scans in (pulls, slides):
        largest = np.linalg.eigvalsh(slips.covariance[scans, 0, :2, :2])[:, 1]
        assert (largest > (0.8 * shift_m) ** 2).mean() > 0.9
        assert (slips.quality[scans, 0] != OK).mean() > 0.9
    even = api.estimate(on_skin(SLID, AT_REST), "template", mode="batch").slips
    assert (even.quality[slides, 0] == OK).mean() > 0.9


def test_excursions_that_come_back_are_what_the_load_does_and_slides_are_not() -> None:
    shifts = Shifts()
    for x in (0.0, 1.0, 3.0, 2.0):
        shifts.see(np.array([x, 0.0]))
    np.testing.assert_array_equal(shifts.covariance, 0.0)  # it may slide
    shifts.see(np.array([1.5, 0.0]))
    np.testing.assert_allclose(shifts.covariance, [[(1 + 9 + 4 + 1.5**2) / 5, 0.0], [0.0, 0.0]])
    before = shifts.covariance
    shifts.see(np.array([0.0, 9.0]))
    shifts.forget()
    shifts.see(np.array([0.0, 10.0]))
    np.testing.assert_array_equal(shifts.covariance, before)


@pytest.mark.parametrize("rounding_s", [-4e-16, 4e-16])
def test_how_long_an_object_stays_does_not_depend_on_the_rounding_of_times(
    rounding_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RestHypothesis, "_has_moved", lambda *_: True)
    rest, ones = RestHypothesis(SENSOR.layout, stream=True), np.ones(SENSOR.layout.taxels)
    true = np.ones(1, dtype=np.bool_)
    origins = []
    for until_s, x_m in ((0.0, 0.0), (0.1, 2 * PITCH_M), (0.5 + rounding_s, 2 * PITCH_M), (0.6, 2 * PITCH_M)):
        seen = Bin(until_s - 0.1, until_s, ones, ones > 1.0, true, true, None, ones)
        rest._compare(0, seen, np.array([x_m, 0.0, 0.0]))
        origins.append(float(rest._origin_m[0, 0]))
    assert origins == [0.0, 0.0, 0.0, 2 * PITCH_M]
