from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from rigged import rigged
from taxelflow.acquire.base import Truth
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.evaluation import slip, slip_scoring
from taxelflow.evaluation.slip import APART, FRESH_SEED, HOLDS, METHODS, Slip, SlipReport
from taxelflow.evaluation.slip_scoring import NOISE, OBJECTS, Job, compared, found_by
from taxelflow.messages import Event
from taxelflow.publish.summary import to_json
from taxelflow.simulation.scenario import SCENARIOS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.simulation.scenario import Scenario

FAST = ("principal_axis", "convolution")


@pytest.fixture(scope="module")
def scenes() -> Iterator[dict[str, Scenario]]:
    """Scenarios of a few seconds."""
    with pytest.MonkeyPatch.context() as patch:
        motion = {"turn_s": 2.0, "stick_slip_s": 3.0}
        # as many cycles a second as in the whole scenarios
        short = {name: rigged(name, motion=motion, load={"cycles": 1}) for name in ("stick-slip", *HOLDS, *APART)}
        patch.setattr(slip_scoring, "SCENARIOS", short)
        for module in (slip, slip_scoring):
            patch.setattr(module, "OBJECTS", {"airbag": OBJECTS["airbag"]})
        yield short


@pytest.fixture(scope="module")
def quick(scenes: dict[str, Scenario]) -> SlipReport:
    """By two methods that take little; `score` is by all."""
    assert slip_scoring.SCENARIOS is scenes
    return Slip(1, methods=FAST, hours=0.01).run()


@pytest.fixture(scope="module")
def score(scenes: dict[str, Scenario]) -> SlipReport:
    assert slip_scoring.SCENARIOS is scenes
    return Slip(1, hours=0.01).run()


@pytest.mark.long
def test_there_is_a_row_for_each_object_scenario_and_method(quick: SlipReport) -> None:
    assert [(row.object, row.method, row.mode) for row in quick.slips] == [
        ("airbag", method, mode) for method in FAST for mode in ("stream", "batch")
    ]
    wanted = [(name, method) for name in (*HOLDS, *APART) for method in FAST]
    assert [(row.scenario, row.method) for row in quick.holds] == [*wanted, (NOISE, NOISE)]
    assert (quick.first_seed, quick.alarms_per_hour) == (FRESH_SEED, 1.0)


def test_by_default_all_methods_with_a_pose_are_scored() -> None:
    assert set(Slip().methods) == set(METHODS) > set(FAST)


@pytest.mark.long
def test_slips_of_an_airbag_are_found(score: SlipReport) -> None:
    for row in score.slips:
        assert row.slips >= 4
        assert row.missed == 0
        assert 0.7 < row.f1 < 1
        assert 0 <= row.onset_ms <= row.onset_p90_ms <= row.onset_max_ms < 200
        assert row.dated_ms < 40
        assert row.direction_deg < 10
        assert row.speed_percent < 20


@pytest.mark.long
def test_an_oracle_that_keeps_the_rate_does_somewhat_better(score: SlipReport) -> None:
    rows = {(row.method, row.mode): row for row in score.slips}
    live = rows["template", "stream"]
    assert live.f1_oracle is not None
    assert live.f1 - 0.01 < live.f1_oracle < 1  # it draws errors of its own
    assert rows["template", "batch"].f1_oracle is None
    assert rows["convolution", "stream"].f1_oracle is None  # its poses are means of two scans


def test_an_oracle_needs_a_covariance(scenes: dict[str, Scenario]) -> None:
    assert slip_scoring.SCENARIOS is scenes
    none, exact = Slip(1, methods=("sum", "lnorm"), hours=0).run().slips[::2]
    assert (none.method, none.f1_oracle) == ("sum", None)
    assert exact.method == "lnorm"  # says 0 where the object rests
    assert exact.f1_oracle is not None


@pytest.mark.long
def test_in_a_recording_slips_are_dated_to_the_scan(score: SlipReport) -> None:
    by_mode = {"stream": [], "batch": []}
    for row in score.slips:
        if row.method in ("template", "convolution"):
            by_mode[row.mode].append(row)
    for live, recorded in zip(by_mode["stream"], by_mode["batch"], strict=True):
        assert recorded.f1 > max(live.f1, 0.96)
        assert recorded.onset_ms == 0
        assert recorded.false == recorded.missed == 0


@pytest.mark.long
def test_what_holds_still_raises_no_alarm_and_the_rate_has_an_interval(score: SlipReport) -> None:
    for row in score.holds:
        if row.scenario in (*HOLDS, NOISE):
            assert (row.alarms, row.per_hour, row.low) == (0, 0.0, 0.0)
            assert row.high == pytest.approx(-np.log(0.025) / row.hours)
            assert 0.4 < row.scatter < 1.4


@pytest.mark.long
def test_a_methods_score_does_not_depend_on_the_others(score: SlipReport, quick: SlipReport) -> None:
    assert quick.slips == [row for row in score.slips if row.method in FAST]
    assert quick.holds == [row for row in score.holds if row.method in (*FAST, NOISE)]


@pytest.mark.long
def test_the_same_seeds_give_the_same_score_and_others_another(quick: SlipReport) -> None:
    one = ("convolution",)
    again, other = (Slip(1, seed, one, hours=0).run() for seed in (0, 1))
    assert again.slips == [row for row in quick.slips if row.method in one]
    assert again.holds == other.holds == []
    assert all(first != second for first, second in zip(again.slips, other.slips, strict=True))


def test_noise_alarms_as_often_as_asked() -> None:
    (row,) = Slip(0, methods=(), hours=0.5, alarms_per_hour=200.0).run().holds
    assert row.low < 260
    assert row.high > 140
    assert row.hours == pytest.approx(0.5, rel=1e-3)


def test_json_holds_the_whole_report(quick: SlipReport) -> None:
    whole = json.loads(to_json(quick))
    assert set(whole) == {"alarms_per_hour", "seeds", "first_seed", "slips", "holds"}
    assert whole["slips"][0]["object"] == "airbag"


@pytest.mark.long
def test_processes_give_what_one_gives() -> None:
    jobs = [Job(NOISE, seed, (NOISE,), 20.0) for seed in (3, 4)]
    one, two = (list(found_by(jobs, 0.05, processes)) for processes in (1, 2))
    assert one == two
    assert one[0] != one[1]


def test_calls_are_held_against_the_truth() -> None:
    t_s = np.arange(100) / 100
    true = np.zeros(100, bool)
    true[20:40] = true[60:80] = True
    pose = np.zeros((100, 3))
    pose[:, 0] = np.cumsum(true) * 1e-4
    said = np.zeros(100, bool)
    said[22:30] = said[33:42] = said[90:95] = True
    events = [
        Event(0.22, "pad", "slip_start", 0.20, 0.0, 0.01),
        Event(0.30, "pad", "slip_stop", 0.29, 0.0, 0.01),
        Event(0.33, "pad", "slip_start", 0.31, 0.0, 0.01),
        Event(0.42, "pad", "slip_stop", 0.40, 0.1, 0.011),
        Event(0.90, "pad", "slip_start", 0.89, 0.0, 0.01),
    ]
    seen = compared(said, events, Truth("pad", t_s, pose, true), 0.15, 0)
    assert (seen.true, seen.called, seen.both) == (40, 22, 15)
    assert (seen.alarms, seen.false, seen.split, seen.missed) == (3, 1, 1, 1)
    assert seen.latency_ms == pytest.approx([20.0])
    assert seen.dated_ms == pytest.approx([5.0])
    assert seen.direction_deg == pytest.approx([np.degrees(0.1)])
    assert seen.speed_percent == pytest.approx([10.0], abs=0.1)


def test_the_scenarios_that_hold_still_do_and_touch_the_grid() -> None:
    for name in HOLDS:
        assert SCENARIOS[name].motion.travel_m == 0
        assert SCENARIOS[name].sensor == "grid-16x16"


def test_it_shows_slips_and_alarms_beside_the_rate(quick: SlipReport, capsys: pytest.CaptureFixture[str]) -> None:
    quick.show()
    shown = capsys.readouterr().out
    for word in ("called live", "dated afterwards", "seeds from 1000", "1 false alarms an hour asked for"):
        assert word in shown
    for word in ("airbag", "hold-pressed", "hold-at-edge", "white noise"):
        assert word in shown


def test_its_tables_are_slips_and_still_objects(quick: SlipReport) -> None:
    slips, holds = quick.tables()
    assert (slips.columns[0], holds.columns[0]) == ("object", "scenario")
    assert (len(slips.rows), len(holds.rows)) == (len(quick.slips), len(quick.holds))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hours": -1.0}, "hours must be 0 or more (got -1.0)"),
        ({"processes": 0}, "processes must be at least 1 (got 0)"),
        ({"alarms_per_hour": 0.0}, "alarms_per_hour must be a finite number above 0 (got 0.0)"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterInvalid, match=re.escape(message)):
        Slip(**options)


def test_an_unknown_method_is_refused_before_the_work_begins() -> None:
    with pytest.raises(NameUnknown, match="unknown method 'guess'; known are lnorm"):
        Slip(methods=("guess",)).run()
