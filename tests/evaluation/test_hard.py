from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.evaluation import hard
from taxelflow.evaluation.hard import Hard, HardReport, _far
from taxelflow.evaluation.hard_cases import CASES, INNER_TAXELS, dropped, with_dead
from taxelflow.evaluation.strokes import trial, ungrouped
from taxelflow.pipeline.api import conditioned
from taxelflow.publish.summary import to_json
from taxelflow.simulation.simulate import simulate

NAMES = [name for case in CASES for name, _ in case.rows]


QUICK = (
    "as in Table I",
    "2 unknown dead taxels",
    "smaller than a taxel",
    "saturated, censored",
    "saturated, dropped",
    "stream, 2nd to 4th",
)


@pytest.fixture(scope="module")
def flow() -> HardReport:
    return Hard(2, 7, ("convolution",)).run()


@pytest.fixture(scope="module")
def quick() -> HardReport:
    """Of the cases that say most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hard, "CASES", [case for case in CASES if {name for name, _ in case.rows} & set(QUICK)])
        return Hard(2, 7, ("convolution",)).run()


@pytest.mark.long
def test_every_case_has_a_row_at_each_speed(flow: HardReport) -> None:
    silent = (50, "convolution", "saturated, dropped")  # it follows from whole scan to whole scan
    assert flow.silent == [silent]
    there = [(speed, name) for speed in (25, 50) for name in NAMES if (speed, "convolution", name) != silent]
    assert [(row.nominal_mm_s, row.case) for row in flow.rows] == there
    assert silent not in {(one.nominal_mm_s, one.method, one.case) for one in flow.far}
    counts = {row.case: row.strokes for row in flow.rows if row.nominal_mm_s == 25}
    counts.pop("saturated, dropped")
    assert counts.pop("stream, 1st stroke") == 2
    assert counts.pop("stream, 2nd to 4th") == 6
    assert set(counts.values()) == {4}


def test_every_row_has_its_errors_and_its_bound(quick: HardReport) -> None:
    for row in quick.rows:
        assert 0 < row.bound_percent < row.rmse_percent
        assert row.standard_error_percent is not None
        assert 0 <= row.standard_error_percent < row.rmse_percent
        assert max(abs(row.bias_percent), row.median_percent) <= 1.5 * row.rmse_percent
    bound = {row.case: row.bound_percent for row in quick.rows if row.nominal_mm_s == 25}
    assert bound["2 unknown dead taxels"] > bound["as in Table I"] > bound["saturated, censored"]
    assert bound["smaller than a taxel"] > 1.5 * bound["as in Table I"]


def test_strokes_that_are_far_off_are_named_by_the_seed_that_makes_them_again(quick: HardReport) -> None:
    assert {one.seed for one in quick.far} == {7, 8}
    one = quick.far[0]
    assert (one.nominal_mm_s, one.method, one.case, one.stroke) == (25, "convolution", "as in Table I", 1)
    recording = ungrouped(simulate(trial(one.seed, 25)))
    (again, _) = hard._errors("convolution", recording, conditioned(recording), "batch", 25)
    assert one.error_percent == pytest.approx(again)
    assert abs(again) > 1


def test_later_strokes_keep_their_number(quick: HardReport) -> None:
    numbers = {one.stroke for one in quick.far if one.case == "stream, 2nd to 4th"}
    assert numbers == {2, 3, 4}


@pytest.mark.long
def test_the_template_is_far_below_the_flow_where_taxels_are_dead_or_streamed(monkeypatch: pytest.MonkeyPatch) -> None:
    most = {
        "as in Table I": 0.6,
        "2 unknown dead taxels": 1.0,
        "stream, 2nd to 4th": 2.5,
        "saturated, censored": 0.6,
        "saturated, dropped": 1.5,
    }
    monkeypatch.setattr(hard, "CASES", [case for case in CASES if {name for name, _ in case.rows} & set(most)])
    found = {(row.nominal_mm_s, row.case): row for row in Hard(1, 7, ("template",)).run().rows}
    for speed in (25, 50):
        for case, percent in most.items():
            assert found[speed, case].rmse_percent < percent, case


def test_dropped_readings_are_those_that_saturate_and_no_others() -> None:
    scenario = trial(0, 25)
    scans = conditioned(ungrouped(simulate(replace(scenario, contact=replace(scenario.contact, peak_pa=200e3)))))
    saturated = scans.pressure >= scans.ceiling
    assert saturated.any()
    found = dropped(scans)
    assert (found.pressure[saturated] == 0).all()
    np.testing.assert_array_equal(found.pressure[~saturated], scans.pressure[~saturated])
    np.testing.assert_array_equal(found.complete, scans.complete & ~saturated.any(axis=1)[:, np.newaxis])


def test_dead_taxels_are_two_of_those_under_the_object() -> None:
    drawn = {with_dead(trial(seed, 25)).sensing.dead for seed in range(20)}
    assert len(drawn) > 10
    assert all(len(set(dead)) == 2 and set(dead) <= set(INNER_TAXELS) for dead in drawn)


def test_json_makes_the_round_trip(quick: HardReport) -> None:
    assert msgspec.json.decode(to_json(quick), type=HardReport) == quick


@pytest.mark.long
def test_what_cannot_be_scored_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hard, "CASES", CASES[:1])
    with pytest.raises(NameUnknown, match="unknown method 'magic'"):
        Hard(1, methods=("magic",)).run()
    with pytest.raises(ParameterInvalid, match=r"methods must give a position.*'sum'"):
        Hard(1, methods=("sum",)).run()


def test_it_shows_every_case_and_names_strokes_that_are_far_off(
    quick: HardReport, capsys: pytest.CaptureFixture[str]
) -> None:
    quick.show()
    shown = capsys.readouterr().out
    for word in ("flow, 2 recordings a case, seed 7", "2 unknown dead taxels", "saturated, dropped", "bound", "median"):
        assert word in shown
    assert "flow, 25 mm/s, as in Table I: " in shown
    assert "flow, 50 mm/s, saturated, dropped: no stroke has a velocity" in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_its_tables_hold_the_rows_and_the_strokes_far_off(quick: HardReport) -> None:
    rows, far = quick.tables()
    assert rows.columns[:5] == ("nominal_mm_s", "method", "case", "strokes", "rmse_percent")
    assert [row[4] for row in rows.rows] == [row.rmse_percent for row in quick.rows]
    assert len(far.rows) == len(quick.far)


def test_how_far_off_a_stroke_is_listed_is_asked_for() -> None:
    error = np.array([0.4, -3.0, np.nan])
    assert _far(error, slice(None), 1.0) == [(2, -3.0), (3, None)]
    assert _far(error, slice(None), 5.0) == [(3, None)]
