"""The slip stage as a whole: poses and patterns of one recording, in a stream and in a batch."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from restless import held, slide, smooth
from taxelflow.estimation.completion import start_slips
from taxelflow.messages import cut, joined
from taxelflow.pipeline import api
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools, Event, Floats, Slips
    from taxelflow.pipeline.result import Result

both = pytest.mark.parametrize("mode", ["batch", "stream"])
batch_first = pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))


def moving(result: Result, x_m: Floats, rate_hz: float = 10.0) -> Bools:
    """(scans,), whether the object moves in truth."""
    moves = np.diff(x_m, prepend=x_m[0]) != 0
    before = round(2 * rate_hz)
    flags = np.zeros(before + len(x_m) + round(rate_hz), dtype=np.bool_)
    flags[before : before + len(x_m)] = moves
    return flags[len(flags) - len(result.slips) :] if len(flags) != len(result.slips) else flags


@batch_first
def test_an_object_that_only_tilts_does_not_slip(mode: Mode) -> None:
    result = api.estimate(held(np.zeros(300)), mode=mode)
    settled = result.slips.t_s > 4.0  # a second until the skin is known
    assert result.slipping[settled].mean() < 0.02
    assert result.slips.contact[settled].mean() > 0.8


@batch_first
def test_what_only_the_pose_takes_for_a_slip_is_suspected(mode: Mode) -> None:
    result = api.estimate(held(np.zeros(300), tilted=0.25), mode=mode)
    kinds = [event.event for event in result.events if event.t_s > 4.0]
    assert "slip_suspected" in kinds
    assert "slip_start" not in kinds
    (first, *_) = (event for event in result.events if event.event == "slip_suspected")
    assert first.speed_m_s > 0
    assert first.quality
    all_kinds = [event.event for event in result.events]
    assert result.summary.events["slip_suspected"] == all_kinds.count("slip_suspected")


@both
def test_a_slide_on_a_restless_skin_is_found(mode: Mode) -> None:
    x_m = slide()
    result = api.estimate(held(x_m), mode=mode)
    true = moving(result, x_m)
    called = result.slipping[:, 0]
    assert (called & true).sum() > 0.7 * true.sum()
    assert (called & ~true)[result.slips.t_s > 4.0].sum() <= 5
    assert np.nanmax(result.evidence[true]) > 1
    start, stop = (event for event in result.events if event.event in ("slip_start", "slip_stop") and event.t_s > 4.0)
    assert (start.event, stop.event) == ("slip_start", "slip_stop")
    assert start.onset_s == pytest.approx(10.0, abs=0.4)
    assert stop.direction_rad == pytest.approx(0.0, abs=0.3)


@batch_first
def test_where_nothing_stirs_the_pose_decides(mode: Mode) -> None:
    recording = held(slide(100.0), tilted=0.0, rate_hz=100.0)
    result = api.estimate(recording, mode=mode)
    monitor = SlipMonitor()
    watch = (monitor.begin if mode == "stream" else monitor.look_back)(recording.layout.pads)
    (slipping, events, _), (rest, last, _) = watch.step(result.slips), watch.finish()
    np.testing.assert_array_equal(result.slipping, np.concatenate([slipping, rest]))
    assert [_dated(event) for event in result.events] == [_dated(event) for event in (*events, *last)]


@pytest.mark.parametrize("speed_m_s", [0.004, 0.012])
def test_a_slow_slide_of_a_smooth_object_at_a_border_is_no_tilt(speed_m_s: float) -> None:
    way = np.arange(0.0, 0.016, speed_m_s / 25.0) - 0.008
    result = api.estimate(smooth(np.concatenate([np.full(100, way[0]), way, np.full(75, way[-1])])))
    (start,) = (event for event in result.events if event.event == "slip_start")
    assert start.onset_s == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize("method", ["convolution", "registration"])
def test_what_a_tilt_explains_over_seconds_is_suspected(method: str) -> None:
    result = api.estimate(smooth(np.zeros(250), tilted=0.4), method)
    assert {event.event for event in result.events} == {"contact", "slip_suspected", "release"}


def _dated(event: Event) -> tuple[float, str, str, float]:
    """What the slip detector decides of an event."""
    return event.t_s, event.pad, event.event, event.onset_s if event.event.startswith("slip") else event.t_s


@both
def test_the_blocks_do_not_matter(mode: Mode) -> None:
    recording = held(slide())
    scans = api.conditioned(recording)
    slips = _slips(recording, mode)
    found = []
    for size in (1, 7, len(scans)):
        stage = SlipMonitor().watch(recording.layout, stream=mode == "stream")
        parts = []
        for start in range(0, len(scans), size):
            block = cut(scans, start, min(start + size, len(scans)))
            stage.see(block)
            parts.append(stage.step(cut(slips, start, start + len(block))))
        parts.append(stage.finish())
        assert sum(map(len, parts)) == len(scans)
        found.append(
            (
                np.concatenate([part.slipping for part in parts]),
                np.concatenate([part.evidence for part in parts]),
                np.concatenate([part.statistic for part in parts]),
                [event for part in parts for event in part.events],
            )
        )
    for slipping, evidence, statistic, events in found[1:]:
        np.testing.assert_array_equal(statistic, found[0][2])
        np.testing.assert_array_equal(slipping, found[0][0])
        np.testing.assert_array_equal(evidence, found[0][1])
        assert repr(events) == repr(found[0][3])


def _slips(recording: Recording, mode: Mode) -> Slips:
    session = start_slips(api.estimator("convolution"), recording.layout, mode)
    scans = api.conditioned(recording)
    return joined([session.step(scans), session.finish()])


@both
def test_starts_and_stops_alternate_and_agree_with_the_flags(mode: Mode) -> None:
    result = api.estimate(held(slide(), tilted=0.25, seed=3), mode=mode)
    own = [event for event in result.events if event.event in ("slip_start", "slip_stop")]
    assert [event.event for event in own] == ["slip_start", "slip_stop"] * (len(own) // 2)
    told = np.zeros(len(result.slips), dtype=np.int64)
    for event in own:
        told[int(np.searchsorted(result.slips.t_s, event.t_s))] += 1 if event.event == "slip_start" else -1
    np.testing.assert_array_equal(np.cumsum(told) > 0, result.slipping[:, 0])


def test_a_result_has_evidence_of_every_scan_in_contact_but_the_first() -> None:
    result = api.estimate(held(np.zeros(100)))
    contact = np.flatnonzero(result.slips.contact[:, 0])
    assert np.isfinite(result.evidence[contact[5:], 0]).all()
    assert np.isnan(result.evidence[: contact[0] - 3, 0]).all()


@pytest.mark.long
@both
def test_parts_of_a_palm_do_not_slip_as_an_object_tilts(mode: Mode) -> None:
    """Their poses are ambiguous and move by half a taxel; load and tilt explain the pattern."""
    recording = simulate(replace(SCENARIOS["tilt"], seed=1))
    kinds = [event.event for event in api.estimate(recording, api.estimator("registration"), mode=mode).events]
    assert kinds.count("slip_start") <= 1
    assert kinds.count("slip_suspected") >= 1
