from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.estimation.centroid.convolution import Convolution
from taxelflow.estimation.centroid.principal_axis import PrincipalAxis
from taxelflow.evaluation.strokes import PAPER_METHODS, TABLE1, Row, scored_methods, strokes_by
from taxelflow.evaluation.table1 import PAPER, PaperRow, Table1, Table1Report
from taxelflow.messages import cut, joined
from taxelflow.pipeline.api import conditioned
from taxelflow.publish.summary import to_json
from taxelflow.runtime import registry
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Scans, Slips
    from taxelflow.sensors.layout import Layout
    from taxelflow.simulation.scenario import Scenario

STROKES = 8
by_method = pytest.mark.parametrize("method", PAPER_METHODS)
by_speed = pytest.mark.parametrize("speed", TABLE1.speeds_mm_s)


@pytest.fixture(scope="module")
def trials() -> list[Scenario]:
    return []


@pytest.fixture(scope="module")
def table(trials: list[Scenario]) -> Table1Report:
    def noted(scenario: Scenario) -> Recording:
        trials.append(scenario)
        return simulate(scenario)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("taxelflow.evaluation.table1.simulate", noted)
        return Table1(STROKES, 0, methods=PAPER_METHODS).run()


@pytest.fixture(scope="module")
def small() -> Table1Report:
    return Table1(4, 0, methods=PAPER_METHODS).run()


def row(table: Table1Report, speed: int, method: str, scans: str, *, fitted: bool) -> Row:
    found = [
        row
        for row in table.ours
        if (row.nominal_mm_s, row.method, row.scans, row.factor != 1.0) == (speed, method, scans, fitted)
    ]
    assert len(found) == 1
    return found[0]


@pytest.mark.long
def test_there_is_a_row_for_each_speed_method_set_of_scans_and_factor(table: Table1Report) -> None:
    for speed in TABLE1.speeds_mm_s:
        for method in PAPER_METHODS:
            for scans in ("all", "interior"):
                for fitted in (False, True):
                    row(table, speed, method, scans, fitted=fitted)
    assert len(table.ours) == 16
    assert (table.strokes, table.seed) == (STROKES, 0)


def test_backward_is_negative_and_forward_positive_in_every_row(table: Table1Report) -> None:
    for ours in table.ours:
        assert ours.backward_mm_s < -0.6 * ours.nominal_mm_s
        assert ours.forward_mm_s > 0.6 * ours.nominal_mm_s
    for paper in table.paper:
        assert paper.backward_mm_s < 0 < paper.forward_mm_s


@by_speed
def test_the_flow_is_within_5_percent_inside_after_its_factor(table: Table1Report, speed: int) -> None:
    inside = row(table, speed, "convolution", "interior", fitted=True)
    assert inside.rmse_percent < 5
    assert abs(inside.bias_percent) < 3
    assert abs(inside.factor - 1) < 0.1


@by_speed
@by_method
def test_the_edge_makes_both_methods_clearly_too_slow(table: Table1Report, method: str, speed: int) -> None:
    everything = row(table, speed, method, "all", fitted=False)
    inside = row(table, speed, method, "interior", fitted=False)
    assert -30 < everything.bias_percent < -12
    assert abs(inside.bias_percent) < 6


def test_inside_the_flow_beats_the_l_norm(table: Table1Report) -> None:
    for speed in TABLE1.speeds_mm_s:
        flow, lnorm = (row(table, speed, method, "interior", fitted=True) for method in ("convolution", "lnorm"))
        assert flow.rmse_mm_s < lnorm.rmse_mm_s


@by_method
@pytest.mark.parametrize("scans", ["all", "interior"])
def test_one_factor_serves_both_speeds_and_scales_the_velocities(table: Table1Report, method: str, scans: str) -> None:
    factors = {row(table, speed, method, scans, fitted=True).factor for speed in TABLE1.speeds_mm_s}
    assert len(factors) == 1
    (factor,) = factors
    for speed in TABLE1.speeds_mm_s:
        bare, scaled = (row(table, speed, method, scans, fitted=fitted) for fitted in (False, True))
        assert scaled.backward_mm_s == pytest.approx(factor * bare.backward_mm_s)
        assert scaled.forward_mm_s == pytest.approx(factor * bare.forward_mm_s)
        assert scaled.strokes == bare.strokes


@by_method
@pytest.mark.parametrize("scans", ["all", "interior"])
def test_the_factor_is_near_but_not_the_one_that_fits_the_table_itself(
    table: Table1Report, method: str, scans: str
) -> None:
    bare = row(table, 25, method, scans, fitted=False)
    mean = 25 * (1 + bare.bias_percent / 100)
    own = 25 * mean / (bare.rmse_mm_s**2 + 2 * 25 * mean - 25**2)  # least squares on the table's own strokes
    fitted = row(table, 25, method, scans, fitted=True).factor
    assert fitted == pytest.approx(own, rel=0.08)
    assert fitted != pytest.approx(own, rel=1e-6)


def test_no_trial_is_used_twice(table: Table1Report, trials: list[Scenario]) -> None:
    assert len(trials) == 3 * STROKES // 2
    assert len({trial.seed for trial in trials}) == len(trials)
    slow = [trial for trial in trials if trial.motion.speed_m_s == 0.025]
    fast = [trial for trial in trials if trial.motion.speed_m_s == 0.05]
    assert (len(slow), len(fast)) == (STROKES, STROKES // 2)  # slow ones twice: to fit, and for the table
    assert all(row.strokes == STROKES for row in table.ours)


def test_trials_differ_in_object_and_line_as_documented(table: Table1Report, trials: list[Scenario]) -> None:
    assert table.ours
    radii = [trial.contact.radius_m for trial in trials]
    lines = [trial.motion.middle_m[1] for trial in trials]
    assert len(set(radii)) == len(set(lines)) == len(trials)
    assert 0.013 <= min(radii) < 0.0145
    assert 0.0155 < max(radii) <= 0.017
    assert max(abs(y - 0.005) for y in lines) <= 0.002
    assert {(trial.contact.shape, trial.sensing.rate_hz, trial.motion.strokes) for trial in trials} == {
        ("airbag", 7.0, 2)
    }


def test_errors_fit_together(table: Table1Report) -> None:
    for ours in table.ours:
        assert ours.rmse_percent == pytest.approx(100 * ours.rmse_mm_s / ours.nominal_mm_s)
        assert abs(ours.bias_percent) <= ours.rmse_percent + 1e-12
        assert 0 < ours.standard_error_percent < ours.rmse_percent
        mean = (ours.forward_mm_s - ours.backward_mm_s) / 2
        assert ours.bias_percent == pytest.approx(100 * (mean / ours.nominal_mm_s - 1))


@pytest.mark.long
def test_another_seed_gives_another_table(small: Table1Report) -> None:
    other = Table1(4, 1000, methods=PAPER_METHODS).run()
    assert all(one != two for one, two in zip(small.ours, other.ours, strict=True))


@pytest.mark.long
def test_the_standard_error_falls_with_more_strokes(small: Table1Report) -> None:
    more = Table1(16, 0, methods=PAPER_METHODS).run()
    one, two = (sum(row.standard_error_percent for row in report.ours) for report in (small, more))
    assert 1.3 < one / two < 3  # about the square root of 4


@pytest.mark.long
@pytest.mark.parametrize("strokes", [2, 3])
def test_it_reports_the_number_of_strokes(strokes: int) -> None:
    told = Table1(strokes, 0, methods=PAPER_METHODS).run()
    assert {row.strokes for row in told.ours if row.scans == "all"} == {told.strokes}


@pytest.mark.long
def test_the_same_seed_gives_the_same_table_and_progress_may_be_watched(small: Table1Report) -> None:
    passed: list[int] = []

    def watched(items: Iterable[int], what: str) -> Iterable[int]:
        assert what == "trials"
        for item in items:
            passed.append(item)
            yield item

    assert Table1(4, 0, PAPER_METHODS).run(watched) == small
    assert passed == list(range(6))


def test_json_makes_the_round_trip(table: Table1Report) -> None:
    text = to_json(table)
    assert msgspec.json.decode(text, type=Table1Report) == table
    whole = json.loads(text)
    assert set(whole) == {"strokes", "seed", "solver", "paper", "ours"}
    assert None not in whole["ours"][0].values()


@pytest.mark.long
def test_any_method_with_a_position_may_be_scored_beside_them() -> None:
    told = Table1(4, 0, methods=("convolution", "principal_axis")).run()
    assert {row.method for row in told.ours} == {"convolution", "principal_axis"}
    axis = next(row for row in told.ours if row.method == "principal_axis" and row.scans == "interior")
    assert axis.rmse_percent < 10


def test_the_papers_methods_come_first_and_ours_follow_when_they_are_registered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(registry.PARTS, "estimator", dict.fromkeys((*PAPER_METHODS, "template", "sum"), ""))
    assert scored_methods() == ("lnorm", "convolution", "template")
    monkeypatch.setitem(registry.PARTS, "estimator", dict.fromkeys((*PAPER_METHODS, "sum"), ""))
    assert scored_methods() == PAPER_METHODS


@dataclass(frozen=True)
class Held:
    """The principal axis, as an estimator that gives everything at the end; with variances of its own."""

    def start(self, layout: Layout, mode: Mode) -> Held:
        object.__setattr__(self, "session", PrincipalAxis().start(layout, mode))
        object.__setattr__(self, "blocks", [])
        return self

    def step(self, scans: Scans) -> Slips:
        self.blocks.append(self.session.step(scans))  # type: ignore[attr-defined]
        return cut(self.blocks[0], 0, 0)  # type: ignore[attr-defined]

    def finish(self) -> Slips:
        return joined(self.blocks)  # type: ignore[attr-defined]


@pytest.mark.long
def test_a_method_that_holds_its_slips_back_until_the_end_is_scored_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.PARTS["estimator"], "held", f"{__name__}:{Held.__name__}")
    told = Table1(4, 0, methods=("principal_axis", "held")).run()
    own, held = ([row for row in told.ours if row.method == name] for name in ("principal_axis", "held"))
    assert [replace(row, method="principal_axis") for row in held] == own


def test_ours_are_weighted_by_their_variance_and_the_papers_are_not() -> None:
    recording = simulate(SCENARIOS["stroke"])
    truth, pad = recording.known_truth, recording.layout.pads.index("palm")
    scans = conditioned(recording)
    slips = PrincipalAxis().start(recording.layout, "batch").step(scans)
    x_m, variance = slips.pose[:, pad, 0], slips.covariance[:, pad, 0, 0]
    used = np.isfinite(x_m) & (np.gradient(truth.pose[:, 0], truth.t_s) < -1e-3)
    weighted = np.polyfit(truth.t_s[used], 1e3 * x_m[used], 1, w=1 / np.sqrt(variance[used]))[0]
    assert strokes_by("principal_axis", recording, scans)[0].all == pytest.approx(weighted)
    flow = Convolution().start(recording.layout, "batch").step(scans).pose[:, pad, 0]
    used &= np.isfinite(flow)
    plain = np.polyfit(truth.t_s[used], 1e3 * flow[used], 1)[0]
    assert strokes_by("convolution", recording, scans)[0].all == pytest.approx(plain)


def test_a_method_without_a_position_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match=r"methods must give a position.*'sum'"):
        Table1(2, 0, methods=("sum",)).run()


def test_an_unknown_method_is_refused_with_the_list() -> None:
    with pytest.raises(NameUnknown, match="'magic'; known are lnorm, convolution"):
        Table1(2, 0, methods=("magic",)).run()


# What the paper printed


@pytest.mark.parametrize("printed", PAPER, ids=lambda row: f"{row.method}-{row.nominal_mm_s}")
def test_the_papers_rows_are_consistent(printed: PaperRow) -> None:
    errors = np.array([printed.backward_mm_s + printed.nominal_mm_s, printed.forward_mm_s - printed.nominal_mm_s])
    rmse = float(np.sqrt(np.mean(errors**2)))
    assert printed.rmse_mm_s == pytest.approx(rmse, abs=0.006)
    assert printed.rmse_percent == pytest.approx(
        100 * rmse / printed.nominal_mm_s, abs=0.06
    )  # 11.85 is printed as 11.9


def test_the_papers_rows_are_all_there(table: Table1Report) -> None:
    assert table.paper == PAPER
    assert {(row.nominal_mm_s, row.method) for row in PAPER} == {
        (s, m) for s in TABLE1.speeds_mm_s for m in PAPER_METHODS
    }


# What is shown and written


def test_it_shows_the_papers_table_and_ours(table: Table1Report, capsys: pytest.CaptureFixture[str]) -> None:
    table.show()
    shown = capsys.readouterr().out
    for word in ("Table I as published", "-24.24", "20.88", "11.9", "46.46", "ours: 8 strokes a speed, seed 0"):
        assert word in shown
    for word in ("L norm", "flow", "all", "interior", "none", "backward", "forward", "RMSE", "bias"):
        assert word in shown
    assert "nan" not in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_its_tables_are_ours_and_the_papers(table: Table1Report) -> None:
    ours, paper = table.tables()
    assert ours.columns == Row.__struct_fields__
    assert (len(ours.rows), len(paper.rows)) == (16, 4)
    assert ours.rows[0][:3] == (25, "lnorm", "all")


@pytest.mark.long
def test_contacts_of_the_elastic_solver_may_be_scored(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tamaas")
    Table1(2, methods=("convolution",), solver="elastic").run().show()
    assert "elastic solver" in capsys.readouterr().out


@pytest.mark.parametrize("strokes", [1, 0, -4])
def test_it_needs_a_backward_and_a_forward_stroke(strokes: int) -> None:
    with pytest.raises(ParameterInvalid, match=rf"strokes must be at least 2 \(got {strokes}\)"):
        Table1(strokes)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="-1"):
        Table1(4, -1)
