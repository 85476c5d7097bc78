from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from rigged import svg_words
from taxelflow.acquire.base import Truth
from taxelflow.cli import main
from taxelflow.evaluation import field, paper
from taxelflow.evaluation.field import SCENES, Field, FieldReport, FieldRow, cuts_of, true_twist
from taxelflow.evaluation.limits import Limits
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.grasp import Grasp


def made_up_field() -> FieldReport:
    """Errors of two scenarios by number of vectors."""
    rows = [
        FieldRow(name, "convolution", n, f"cut {n}", 1.0, 2.0, 20.0 / n, -1.0, 9) for name in SCENES for n in (2, 4)
    ]
    return FieldReport(1, rows)


@pytest.mark.long
def test_every_figure_of_the_paper_is_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Field, "run", lambda _self, _watched: made_up_field())
    monkeypatch.setattr(paper, "Limits", lambda seeds: Limits(seeds=seeds, methods=("convolution", "lnorm")))
    monkeypatch.setattr(paper, "FIELD_METHODS", ("convolution", "lnorm"))  # the template takes 15 s
    quick, estimate = {"template": "convolution"}, api.estimate
    monkeypatch.setattr(
        api,
        "estimate",
        lambda recording, method="convolution", **more: estimate(recording, quick.get(method, method), **more),
    )
    monkeypatch.setattr(
        "taxelflow.simulation.grasp.Grasp", lambda strokes: Grasp(strokes=strokes - 1, rest_s=0.1)
    )  # one is drawn
    assert main(["figures", "--out", str(tmp_path / "figures"), "--strokes", "2", "--seeds", "1"]) == 0
    named = capsys.readouterr().out.split()
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == sorted(
        name.split("/")[-1] for name in named
    )
    stems = {path.stem for path in (tmp_path / "figures").iterdir()}
    for wanted in ("fig2", "fig4", "fig5", "fig6", "fig7", "fig9", "table1", "rotation", "error"):
        assert any(stem.startswith(wanted) for stem in stems)
    for name in ("fig4-bulb", "fig7-rotation"):  # a row per method, three moments each, the truth beneath
        words = svg_words(tmp_path / "figures" / f"{name}.svg")
        assert {"optical flow (Method II)", "L norm (Method I)"} <= set(words)
        assert sum(word.startswith("true: ") for word in words) == 6


def test_each_figure_is_written_under_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those are drawn that need no estimate; what is on the others is tested above."""
    drawn = []
    for name in ("_bulb", "_rotation", "_spread_field", "_position", "_table1", "_curve", "_limits"):
        monkeypatch.setattr(paper, name, lambda *_given, name=name: drawn.append(name) or Figure())
    assert main(["figures", "--out", str(tmp_path), "--strokes", "2", "--seeds", "1"]) == 0
    printed = {Path(line).name for line in capsys.readouterr().out.split()}
    assert printed == {path.name for path in tmp_path.iterdir()}
    assert {"fig2-taxels.svg", "fig5-views.svg", "fig6-frames.svg", "table1.svg"} < printed
    assert set(drawn) >= {"_bulb", "_rotation", "_position", "_table1", "_curve", "_limits"}


@pytest.mark.long
def test_the_field_score_finds_the_turn_with_two_vectors_and_better_with_four(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field, "SCENES", ("turn-over-hand",))
    monkeypatch.setattr(field, "cuts_of", lambda hand: cuts_of(hand)[:2])
    rows = {(row.scenario, row.cut): row for row in Field(1).run().rows}
    two, four = (rows["turn-over-hand", cut] for cut in ("tips of fingers 1, 2", "fingers 1, 2"))
    assert (two.vectors, four.vectors) == (2, 4)
    assert four.turn_percent < two.turn_percent < 12


def test_each_cut_has_the_vectors_that_it_declares() -> None:
    cuts = cuts_of(load_sensor("barretthand-162"))
    assert [int(cut.sensor.layout.independent.sum()) >= 2 for cut in cuts] == [True] * len(cuts)
    assert len({cut.name for cut in cuts}) == len(cuts)


def test_the_true_twist_is_that_of_the_point_at_the_origin() -> None:
    t_s = np.linspace(0, 1, 1001)
    centre, omega = np.array([0.05, -0.02]), 0.7  # the object turns about this centre
    theta = omega * t_s
    start = np.array([0.01, 0.03]) - centre
    x = centre[0] + np.cos(theta) * start[0] - np.sin(theta) * start[1]
    y = centre[1] + np.sin(theta) * start[0] + np.cos(theta) * start[1]
    truth = Truth("hand", t_s, np.stack([x, y, theta], axis=1))
    twist = true_twist(truth, np.array([0.5]), np.array([0.501]))[0]
    assert twist == pytest.approx([omega * centre[1], -omega * centre[0], omega], rel=1e-3)
