from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from rigged import rigged
from synthetic import unknown_slips
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.evaluation.bound import Bound, bound_of
from taxelflow.evaluation.limits import Limits, LimitsReport
from taxelflow.evaluation.pose_errors import Errors, errors_of
from taxelflow.messages import AMBIGUOUS, LOST, OK, Estimates, Scans, Slips, no_scans
from taxelflow.numerics.geometry import transform
from taxelflow.publish.summary import to_json
from taxelflow.runtime import registry
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.simulation.scenario import Scenario


def perfect(scenario: Scenario, body: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[Floats, Slips, int, Bound]:
    """Slips whose pose is that of a point of the body, without error, their covariance that of the known bound."""
    recording = simulate(scenario)
    truth = recording.known_truth
    bound = bound_of(scenario, truth.t_s)
    pad = recording.layout.pads.index(scenario.pad)
    shape = (len(truth.t_s), len(recording.layout.pads))
    scans = Scans(
        truth.t_s,
        np.zeros((shape[0], recording.layout.entries)),
        np.ones(recording.layout.entries),
        np.full(recording.layout.entries, np.inf),
        np.zeros(shape, dtype=np.bool_),
        np.ones(shape, dtype=np.bool_),
    )
    slips = unknown_slips(scans)
    known = bound.scored
    slips.contact[known, pad] = True
    slips.pose[known, pad, :2] = transform(truth.pose, np.array(body[:2]))[known]
    slips.pose[known, pad, 2] = truth.pose[known, 2] + body[2]
    slips.covariance[known, pad] = np.eye(3) * np.nan_to_num(bound.known[known], nan=1.0)[:, :, np.newaxis] ** 2
    slips.lag_s[:, pad] = 0.0
    slips.quality[known, pad] = OK
    return truth.t_s, slips, pad, bound


def scored(scenario: Scenario, slips: Slips, made: tuple[Floats, Slips, int, Bound]) -> Errors:
    return errors_of(scenario, made[0], slips, made[2], made[3])


def test_which_point_of_a_turning_body_is_followed_at_which_angle_makes_no_error() -> None:
    scenario = rigged("slide-and-turn")
    made = perfect(scenario, (0.004, -0.003, 3.0))
    found = scored(scenario, made[1], made)
    np.testing.assert_allclose(found.error, 0, atol=1e-12)
    np.testing.assert_allclose(found.since[1:], 0, atol=1e-12)
    assert np.isnan(found.since[0]).all()


def test_a_wandering_point_is_an_error() -> None:
    scenario = rigged("slide-and-turn")
    made = perfect(scenario)
    drift = np.linspace(-1e-4, 1e-4, len(made[0]))
    made[1].pose[:, made[2], 0] += drift
    error = scored(scenario, made[1], made).error
    assert np.std(error[:, 0]) == pytest.approx(np.std(drift), rel=0.2)
    turned = made[3].pose[:, 2] - made[3].pose[0, 2]  # the first scan's error is a body point's, and turns along
    since = scored(scenario, made[1], made).since[1:, 0]
    np.testing.assert_allclose(since, (drift - np.cos(turned) * drift[0])[1:], atol=1e-12)


def test_motion_since_the_first_scan_is_that_of_the_centre_as_the_first_scan_had_it() -> None:
    scenario = rigged("slide-and-turn")
    made = perfect(scenario, (0.01, 0.0, 0.0))
    slips, pad = made[1], made[2]
    slips.pose[0, pad, 2] += 0.1  # an angle wrong in the first scan only is wrong in all motions since
    since = scored(scenario, slips, made).since[1:]
    np.testing.assert_allclose(since[:, 2], -0.1, atol=1e-12)
    turned = np.abs(np.hypot(since[:, 0], since[:, 1]))
    np.testing.assert_allclose(turned, 2 * 0.01 * np.sin(0.05), atol=1e-9)


def test_a_turn_that_is_never_reported_leaves_positions_scored() -> None:
    scenario = rigged("slide-and-turn")
    made = perfect(scenario, (0.002, 0.001, 0.0))
    made[1].pose[..., 2] = np.nan
    error = scored(scenario, made[1], made).error
    np.testing.assert_allclose(error[:, :2], 0, atol=1e-12)
    assert np.isnan(error[:, 2]).all()
    since = scored(scenario, made[1], made).since
    np.testing.assert_allclose(since[1:, :2], 0, atol=1e-12)
    assert np.isnan(since[:, 2]).all()


def test_a_turn_that_is_reported_late_counts_from_then() -> None:
    scenario = rigged("slide-and-turn")
    made = perfect(scenario, (0.002, 0.001, 2.0))
    made[1].pose[:20, made[2], 2] = np.nan
    since = scored(scenario, made[1], made).since
    assert np.isnan(since[:21, 2]).all()
    np.testing.assert_allclose(since[21:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(since[1:, :2], 0, atol=1e-12)


def test_a_pose_is_held_to_the_truth_of_its_own_time() -> None:
    scenario = rigged("turn", motion={"travel_m": 0.01, "turn_rad_s": 0.0, "speed_m_s": 0.005})
    late = perfect(scenario)
    late[1].lag_s[:, late[2]] = 0.05
    assert np.nanmax(np.abs(scored(scenario, late[1], late).error[:, :2])) > 1e-4


def test_each_contact_and_each_new_start_has_an_origin_of_its_own() -> None:
    scenario = rigged("stroke")
    made = perfect(scenario)
    slips, pad = made[1], made[2]
    known = np.flatnonzero(made[3].scored)
    slips.pose[known[-1] - 5 :, pad, 0] += 0.01  # within the second stroke
    assert np.nanmax(np.abs(scored(scenario, slips, made).error[:, 0])) > 1e-3
    slips.quality[known[-1] - 5, pad] = LOST
    error = scored(scenario, slips, made).error
    np.testing.assert_allclose(error[np.isfinite(error)], 0, atol=1e-12)
    assert np.isnan(error[known[-1] - 5, 0])


def test_only_scans_of_quality_ok_are_ok() -> None:
    scenario = rigged("turn")
    made = perfect(scenario)
    slips = replace(made[1], quality=np.full_like(made[1].quality, AMBIGUOUS))
    assert not scored(scenario, slips, made).ok.any()
    assert np.isfinite(scored(scenario, slips, made).error).all()


@dataclass(frozen=True)
class Oracle:
    """Knows the truth of one scenario, and errs as the bound says, or so many times as much as it admits."""

    bold: float = 1.0

    def start(self, layout: Any, mode: str) -> Oracle:
        return self

    def step(self, scans: Scans) -> Estimates:
        t_s, slips, pad, bound = perfect(rigged("slide-and-turn"))
        assert len(scans) == len(t_s)
        random = np.random.default_rng(len(t_s))
        slips.pose[:, pad] += self.bold * bound.known * random.standard_normal(bound.known.shape)
        return Estimates(**{field.name: getattr(slips, field.name) for field in fields(Estimates)})

    def finish(self) -> Estimates:
        return Estimates.unknown(no_scans(1, 6))


def oracle(monkeypatch: pytest.MonkeyPatch, kind: type[Oracle]) -> LimitsReport:
    monkeypatch.setitem(registry.PARTS["estimator"], "oracle", f"{__name__}:{kind.__name__}")
    return Limits("slide-and-turn", 1, methods=("oracle",)).run()


@dataclass(frozen=True)
class Bold(Oracle):
    """Errs three times as much as it says."""

    bold: float = 3.0


def test_an_estimator_at_the_bound_has_ratio_1_and_nees_1(monkeypatch: pytest.MonkeyPatch) -> None:
    found = oracle(monkeypatch, Oracle)
    for row in found.rows:
        assert row.over_known == pytest.approx(1, abs=0.15)
        assert row.over_unknown is not None
        assert 0.8 < row.over_unknown < (row.over_known or 0)
        assert row.standard_error is None  # one contact does not scatter
    for line in found.since:
        assert line.known is not None
        assert line.unknown is not None
        assert line.rms == pytest.approx(line.known, rel=0.5)  # all share the error of one first scan
        assert line.known == pytest.approx(line.unknown, rel=0.1)
    assert [line.axis for line in found.since] == ["x", "y", "theta"]
    assert [one.method for one in found.seconds] == ["oracle"]
    assert found.seconds[0].median > 0
    for line in found.consistency:
        assert line.found.nees == pytest.approx(1, abs=0.25)
        assert line.found.low is not None
        assert line.found.high is not None
        assert line.found.low - 0.1 < 1 < line.found.high + 0.1
    assert {(line.scans, line.over) for line in found.consistency} == {
        (s, n) for s in ("all", "ok") for n in (1, 20, 100)
    }


@pytest.mark.long
def test_one_that_errs_three_times_as_much_has_3_and_9(monkeypatch: pytest.MonkeyPatch) -> None:
    found = oracle(monkeypatch, Bold)
    assert [row.over_known for row in found.rows] == [pytest.approx(3, rel=0.15)] * 6
    assert [line.found.nees for line in found.consistency] == [pytest.approx(9, rel=0.25)] * 6


@pytest.fixture(scope="module")
def stroke() -> LimitsReport:
    """All registered methods, here those that compile fast."""
    fast = {name: registry.PARTS["estimator"][name] for name in ("lnorm", "convolution", "sum", "principal_axis")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(registry.PARTS, "estimator", fast)
        return Limits("stroke", 2, seed=5).run()


@pytest.mark.long
def test_every_method_with_a_position_is_scored(stroke: LimitsReport) -> None:
    assert {"lnorm", "convolution", "principal_axis"} <= {row.method for row in stroke.rows}
    assert "sum" in stroke.without
    assert (stroke.scenario, stroke.mode, stroke.seeds, stroke.seed) == ("stroke", "batch", 2, 5)
    assert 80 < stroke.scored < stroke.contact < 120


def test_the_papers_methods_are_far_from_the_bound_on_a_stroke(stroke: LimitsReport) -> None:
    for row in stroke.rows:
        if row.axis == "x" and row.method in ("lnorm", "convolution"):
            assert row.over_known is not None
            assert row.over_known > 10
    assert {row.axis for row in stroke.rows if row.method in ("lnorm", "convolution")} == {"x", "y"}


def test_errors_by_place_grow_towards_the_edge_and_never_pass_below_the_bound_by_much(stroke: LimitsReport) -> None:
    own = {place.at_mm: place for place in stroke.places if place.method == "convolution"}
    assert {place.axis for place in own.values()} == {"x"}
    assert own[0.0].error_mm < 1 < own[35.0].error_mm
    assert all(place.known_mm < place.error_mm for place in own.values())
    assert all(place.unknown_mm and place.unknown_mm > 0.9 * place.known_mm for place in own.values())
    assert sum(place.count for place in own.values()) == next(
        row.count for row in stroke.rows if (row.method, row.scans, row.axis) == ("convolution", "all", "x")
    )


@pytest.mark.long
def test_streaming_is_scored_too() -> None:
    found = Limits("turn", 1, mode="stream", methods=("principal_axis",)).run()
    assert {row.axis for row in found.rows} == {"x", "y", "theta"}
    assert found.mode == "stream"
    error = found.tables()[0]
    units = {row[error.columns.index("axis")]: row[error.columns.index("unit")] for row in error.rows}
    assert units == {"x": "mm", "y": "mm", "theta": "deg"}


def test_json_makes_the_round_trip(stroke: LimitsReport) -> None:
    assert msgspec.json.decode(to_json(stroke), type=LimitsReport) == stroke
    assert set(json.loads(to_json(stroke))["rows"][0]) == {
        "method", "scans", "axis", "count", "rms", "standard_error", "bound", "over_known", "over_unknown",
    }  # fmt: skip


def test_what_is_unknown_is_refused_with_the_list() -> None:
    said = r"unknown scenario 'strok'; did you mean 'stroke'\? known are stroke, fast-stroke"
    with pytest.raises(NameUnknown, match=said):
        Limits("strok", 1).run()
    with pytest.raises(NameUnknown, match="unknown method 'magic'"):
        Limits("stroke", 1, methods=("magic",)).run()
    with pytest.raises(ParameterInvalid, match=r"methods must give a position.*'sum'"):
        Limits("stroke", 1, methods=("lnorm", "sum")).run()


def test_it_shows_errors_over_the_bound_motion_and_consistency_in_80_columns(
    stroke: LimitsReport, capsys: pytest.CaptureFixture[str]
) -> None:
    stroke.show()
    shown = capsys.readouterr().out
    for word in ("stroke, batch, 2 seeds from 5", "x known", "x unknown", "NEES", "95 % band", "independent"):
        assert word in shown
    for word in ("motion since the first scan", "±%", "last", "recording, s: lnorm", "no position, so not scored: sum"):
        assert word in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_without_a_joint_bound_it_shows_a_dash_and_leaves_the_cell_empty(capsys: pytest.CaptureFixture[str]) -> None:
    press = Limits("press", 1, 4, ("convolution",)).run()
    assert (press.scenario, press.seed, press.mode) == ("press", 4, "batch")
    assert {row.over_unknown for row in press.rows} == {None}
    press.show()
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("convolution  all")]
    assert rows[0][-1] == "-"
    error = press.tables()[0]
    assert dict(zip(error.columns, error.rows[0], strict=True))["error_over_bound_unknown"] is None


def test_its_tables_name_the_run_and_the_unit_of_each_row(stroke: LimitsReport) -> None:
    tables = {table.name: table for table in stroke.tables()}
    assert set(tables) == {"error", "motion", "nees", "place", "time"}
    for table in tables.values():
        assert table.columns[:3] == ("scenario", "mode", "seeds")
        assert {row[:3] for row in table.rows} == {("stroke", "batch", 2)}
        assert {len(row) for row in table.rows} == {len(table.columns)}
    for table in (tables["error"], tables["motion"]):
        at = table.columns.index("axis")
        assert table.columns[at + 1] == "unit"
        assert {row[at : at + 2] for row in table.rows} == {("x", "mm"), ("y", "mm")}


@pytest.mark.long
def test_contacts_of_the_elastic_solver_may_be_scored(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tamaas")
    Limits("turn", 1, methods=("convolution",), solver="elastic").run().show()
    assert "elastic solver" in capsys.readouterr().out


def test_a_scenario_over_the_whole_hand_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="choose a scenario on a single pad"):
        Limits("bulb-pull", 1).run()
    with pytest.raises(ParameterInvalid, match=r"seeds must be at least 1 \(got 0\)"):
        Limits(seeds=0)
