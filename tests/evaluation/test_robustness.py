from __future__ import annotations

import csv
import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from rigged import refused
from synthetic import unknown_slips
from taxelflow.cli import main
from taxelflow.errors import NameUnknown, ParameterInvalid, TipsOver
from taxelflow.evaluation import robustness
from taxelflow.evaluation.robustness import PAIRS, SHAPES, Robustness
from taxelflow.evaluation.robustness_rows import ALL_ROWS, CaseRow, row_of, summaries, with_ratios
from taxelflow.messages import AMBIGUOUS, LOST, NO_POSE, OK, Slips, no_scans
from taxelflow.numerics.geometry import transform
from taxelflow.simulation.relief.cases import EFFECTS, PLACES, case
from taxelflow.simulation.relief.course import follow
from taxelflow.simulation.relief.simulate import simulate_relief

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor
    from taxelflow.simulation.relief.parameters import Pressing

NAMES = ("all", "nut", "grid", 0, "template")
PRESSING = case("nut", "grid")
SIGMA_M, SIGMA_RAD = 1e-4, 2e-3


def slips_of(error: Floats, body: tuple[float, float, float] = (0.0, 0.0, 0.0), lag_s: float = 0.0) -> Slips:
    """Poses of a body point with these errors (scans, 3), in contact while there is load, all of them ok."""
    scans = PRESSING.course.scans
    blank = no_scans(1, 1, scans)
    slips: Slips = unknown_slips(replace(blank, t_s=np.arange(scans) / PRESSING.rate_hz))
    path = follow(PRESSING.course, PRESSING.rate_hz, slips.t_s - lag_s)
    on = path.load > 0
    slips.contact[:, 0] = on
    slips.pose[on, 0, :2] = (transform(path.pose, np.array(body[:2])) + error[:, :2])[on]
    slips.pose[on, 0, 2] = (path.pose[:, 2] + body[2] + error[:, 2])[on]
    slips.covariance[on, 0] = np.diag([SIGMA_M**2, SIGMA_M**2, SIGMA_RAD**2])
    slips.lag_s[:] = lag_s
    slips.quality[on, 0] = OK
    return slips


def drawn(scale: float = 1.0) -> Floats:
    noise = np.random.default_rng(0).standard_normal((PRESSING.course.scans, 3))
    error: Floats = scale * noise * np.array([SIGMA_M, SIGMA_M, SIGMA_RAD])
    return error


def test_any_point_of_the_body_at_any_angle_has_no_error() -> None:
    row = row_of(NAMES, PRESSING, slips_of(0 * drawn(), (3e-3, -2e-3, 0.5), lag_s=0.05), 0, "batch")
    assert row.error_mm == pytest.approx(0, abs=1e-9)
    assert row.error_deg == pytest.approx(0, abs=1e-9)
    assert (row.ok, row.wrong, row.known_share) == (row.scans, 0, 1.0)


def test_errors_are_as_large_as_they_were_drawn_and_the_covariance_holds() -> None:
    row = row_of(NAMES, PRESSING, slips_of(drawn()), 0, "batch")
    assert row.error_mm == pytest.approx(1e3 * SIGMA_M * np.sqrt(2), rel=0.1)
    assert row.error_deg == pytest.approx(np.degrees(SIGMA_RAD), rel=0.15)
    assert row.nees_position == pytest.approx(1, abs=0.2)
    assert row.nees_turn == pytest.approx(1, abs=0.25)
    larger = row_of(NAMES, PRESSING, slips_of(drawn(3.0)), 0, "batch")
    assert larger.nees_position == pytest.approx(9 * (row.nees_position or 0))


def test_what_is_wrong_is_off_by_3_sigma_and_by_three_tenths_of_a_millimetre() -> None:
    error = 0 * drawn()
    error[40:50, 0] = 4e-4
    assert row_of(NAMES, PRESSING, slips_of(error), 0, "batch").wrong == 10
    slips = slips_of(error)
    slips.covariance[:, 0] *= 9
    assert row_of(NAMES, PRESSING, slips, 0, "batch").wrong == 0
    slips = slips_of(error * 0.6)
    assert row_of(NAMES, PRESSING, slips, 0, "batch").wrong == 0
    slips = slips_of(error)
    slips.quality[45:50, 0] = NO_POSE
    row = row_of(NAMES, PRESSING, slips, 0, "batch")
    assert (row.wrong, row.ok) == (5, row.scans - 5)
    assert row.wrong_share == pytest.approx(5 / row.ok)


def test_poses_that_are_not_ok_do_not_make_the_others_wrong() -> None:
    error = 0 * drawn()
    error[60:] = 5e-3
    slips = slips_of(error)
    slips.quality[60:, 0] = AMBIGUOUS
    row = row_of(NAMES, PRESSING, slips, 0, "batch")
    assert row.wrong == 0
    assert row.error_mm is not None
    assert row.error_mm > 1


def test_a_method_without_enough_poses_is_still_judged_by_those_that_are_ok() -> None:
    error = 0 * drawn()
    error[25:30] = 1e-3
    slips = slips_of(error)
    slips.pose[65:] = np.nan
    row = row_of(NAMES, PRESSING, slips, 0, "batch")
    assert row.error_mm is None
    assert row.wrong == 5


def test_a_stream_is_scored_after_its_first_second() -> None:
    error = 0 * drawn()
    error[: PRESSING.course.idle_scans + 45] = 1e-3
    slips = slips_of(error)
    late = row_of(NAMES, PRESSING, slips, 0, "stream")
    whole = row_of(NAMES, PRESSING, slips, 0, "batch")
    assert whole.scans - late.scans == 50
    assert late.error_mm == pytest.approx(0, abs=1e-9)
    assert whole.error_mm is not None
    assert whole.error_mm > 0.3


def test_a_method_without_poses_is_judged_by_its_displacements() -> None:
    slips = slips_of(drawn())
    slips.displacement[1:, 0] = np.diff(slips.pose[:, 0], axis=0)
    slips.pose[:] = np.nan
    slips.covariance[:] = np.nan
    row = row_of(NAMES, PRESSING, slips, 0, "batch")
    assert row.error_mm == pytest.approx(1e3 * SIGMA_M * np.sqrt(2), rel=0.25)
    assert (row.nees_position, row.wrong, row.wrong_share) == (None, None, None)


def test_a_method_that_is_silent_or_lost_most_of_the_time_has_no_error() -> None:
    for change in ({"pose": np.nan}, {"quality": LOST}):
        slips = slips_of(drawn())
        for name, value in change.items():
            getattr(slips, name)[40:, 0] = value
        row = row_of(NAMES, PRESSING, slips, 0, "batch")
        assert row.error_mm is None
        assert row.known_share < 0.5
    slips.contact[:] = False
    assert row_of(NAMES, PRESSING, slips, 0, "batch").scans == 0


def rows(**errors: tuple[float | None, ...]) -> list[CaseRow]:
    """Rows of several cases, by method."""
    row = CaseRow("all", "nut", "grid", 0, "", 100, 1.0, None, None, 2.0, None, 50, 5)
    return [
        msgspec.structs.replace(row, seed=seed, method=method, error_mm=error)
        for method, own in errors.items()
        for seed, error in enumerate(own)
    ]


def test_ratios_are_to_the_best_simple_method_of_the_same_recording() -> None:
    found = with_ratios(rows(lnorm=(1.0, 2.0), convolution=(3.0, None), template=(0.5, 8.0)))
    assert [row.ratio for row in found] == [1.0, 1.0, 3.0, None, 0.5, 4.0]
    assert all(row.ratio is None for row in with_ratios(rows(template=(0.5, 8.0))))


def test_there_is_no_ratio_to_a_method_that_found_no_motion_of_an_object_that_is_held() -> None:
    found = with_ratios(rows(lnorm=(2e-14, 1.0), template=(0.3, 0.3)))
    assert [row.ratio for row in found if row.method == "template"] == [None, 0.3]
    (one,) = summaries(found)
    assert (one.worse, one.largest_ratio) == (1, None)


def test_a_summary_counts_cases_that_are_worse_and_better() -> None:
    found = summaries(with_ratios(rows(lnorm=(1.0,) * 5, template=(0.2, 1.05, 1.2, None, 0.3))))
    assert len(found) == 1
    (one,) = found
    assert (one.method, one.cases, one.worse, one.better_share) == ("template", 5, 2, 0.4)
    assert (one.median_ratio, one.largest_ratio) == (1.05, None)
    assert (one.ok_share, one.wrong_share, one.nees_position) == (0.5, 0.1, 2.0)
    both = [*rows(lnorm=(1.0,), template=(0.2,))]
    both += [msgspec.structs.replace(row, effect="none") for row in both]
    assert [one.effect for one in summaries(with_ratios(both))] == ["all", "none", ALL_ROWS]


def test_the_usual_cases_are_each_shape_on_one_layout() -> None:
    assert tuple(shape for shape, _ in PAIRS) == SHAPES
    assert {layout for _, layout in PAIRS} == set(PLACES)
    assert len(Robustness().cases()) == 12
    assert Robustness(layouts=("xela",)).cases() == [("all", shape, "xela") for shape in SHAPES]
    assert len(Robustness(shapes=("nut", "key"), effects=("none", "all")).cases()) == 2 * 2 * len(PLACES)
    assert len(Robustness(full=True).cases()) == len(EFFECTS) * 12 * len(PLACES)


@pytest.mark.parametrize(
    ("options", "named"),
    [({"effects": ("rain",)}, "cross-talk"), ({"shapes": ("egg",)}, "dome"), ({"layouts": ("foot",)}, "hex")],
)
def test_an_unknown_name_lists_the_known_ones(options: dict[str, Any], named: str) -> None:
    with pytest.raises(NameUnknown, match=named):
        Robustness(**options)
    with pytest.raises(ParameterInvalid, match="seeds"):
        Robustness(seeds=0)


def brief(*words: Any, **more: Any) -> Pressing:
    """A case of fewer scans."""
    whole = case(*words, **more)
    return replace(whole, course=replace(whole.course, moving_scans=60))


@pytest.mark.long
def test_the_command_prints_and_writes_every_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robustness, "case", brief)
    words = ["--shapes", "bar", "dome", "--layouts", "xela", "--methods", "lnorm", "convolution", "sum"]
    path = tmp_path / "rows.csv"
    assert main(["score", "robustness", *words, "--csv", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "summary" in shown
    with path.open(newline="") as file:
        written = list(csv.DictReader(file))
    assert [row["method"] for row in written] == ["lnorm", "convolution", "sum"] * 2
    assert all(0 < float(row["error_mm"]) < 10 for row in written if row["method"] != "sum")
    with (tmp_path / "rows-summary.csv").open(newline="") as file:
        (one,) = csv.DictReader(file)
    assert (one["method"], one["cases"], one["worse"]) == ("sum", "2", "2")  # it has no position
    words = ["--shapes", "bar", "--layouts", "xela", "--methods", "lnorm", "convolution"]
    assert main(["score", "robustness", *words, "--mode", "stream", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["mode"] == "stream"
    assert report["rows"][0]["scans"] < int(written[0]["scans"])


def test_a_case_whose_object_tips_over_is_left_out_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(pressing: Pressing, sensor: Sensor, pad: str) -> Recording:
        if pressing.object.shape == "bar":
            raise TipsOver
        return simulate_relief(pressing, sensor, pad)

    monkeypatch.setattr(robustness, "case", brief)
    monkeypatch.setattr(robustness, "simulate_relief", pressed)
    words = ["--shapes", "bar", "dome", "--layouts", "xela", "--methods", "lnorm", "sum", "--seed", "3"]
    assert main(["score", "robustness", *words, "--csv", str(tmp_path / "rows.csv")]) == 0
    assert "left out, because the object tips over: all, bar on xela, seed 3" in capsys.readouterr().out
    with (tmp_path / "rows.csv").open(newline="") as file:
        assert {row["shape"] for row in csv.DictReader(file)} == {"dome"}


def test_the_command_refuses_an_unknown_effect(capsys: pytest.CaptureFixture[str]) -> None:
    assert "cross-talk" in refused(capsys, "score", "robustness", "--effects", "rain")
