from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rigged import refused, svg_words
from taxelflow.cli import main
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.design import Design, Skin, lattice
from taxelflow.evaluation.design_plot import _draw, draw_design


@pytest.mark.parametrize("layout", ["square", "hexagonal", "triangular"])
def test_taxels_of_all_layouts_have_the_same_area(layout: Skin) -> None:
    centres, places = lattice(layout, 0.1, 2.0)
    inside = np.hypot(*centres.T) < 1.5
    assert 0.01 * inside.sum() == pytest.approx(np.pi * 1.5**2, rel=0.02)
    np.testing.assert_allclose(places.mean(axis=1), 0, atol=0.02 * 0.1)


@pytest.mark.long
def test_smaller_taxels_are_more_accurate_and_fits_attain_the_bound() -> None:
    rows = Design(pitch_mm=(4.0, 10.0), layouts=("square",), trials=6).run().rows
    fine, coarse = rows
    assert fine.bound_mm < 0.5 * coarse.bound_mm
    for row in rows:
        assert row.error_mm < 2 * row.bound_mm
        assert row.error_deg is not None
        assert row.lost_percent == 0


def test_a_round_object_has_no_turn() -> None:
    (row,) = Design(pitch_mm=(5.0,), layouts=("hexagonal",), shapes=("round",), trials=2).run().rows
    assert row.bound_deg is None
    assert row.error_mm < 3 * row.bound_mm


def test_the_command_writes_table_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--trials", "1", "--pitch-mm", "8", "16", "--layouts", "square"]
    assert main(["design", "--json", "--csv", str(tmp_path / "d.csv"), "--plot", str(tmp_path / "d.svg"), *words]) == 0
    assert len(json.loads(capsys.readouterr().out)["rows"]) == 2
    assert (tmp_path / "d.csv").read_text().startswith("shape,size_mm,pitch_mm,ratio")
    drawn = (tmp_path / "d.svg").read_text()
    assert ">2.5<" in drawn
    assert ">5<" in drawn
    assert "10^" not in drawn  # ticks are plain numbers
    assert "Error of the turn" in drawn


def test_the_picture_of_a_round_object_has_no_turn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows = Design(pitch_mm=(5.0, 8.0), layouts=("hexagonal",), shapes=("round",), trials=1).run().rows
    drawn = draw_design(rows, tmp_path / "d.svg").read_text()
    assert "Error of the translation" in drawn
    assert "Error of the turn" not in drawn


def test_only_points_of_several_layouts_lie_beside_their_ratio() -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    swept = Design(pitch_mm=(8.0,), layouts=("square", "hexagonal"), shapes=("round",), trials=1).run().rows
    for layouts, beside in ((("square",), 0.0), (("hexagonal",), 0.0), (("square", "hexagonal"), 0.0075)):
        figure, axis = plt.subplots()
        rows = [row for row in swept if row.layout in layouts]
        _draw(axis, rows, "bound_mm", "error_mm")
        points = [line.get_xdata()[0] for line in axis.lines if line.get_label() in layouts]
        expected = [row.ratio * (1.0 + sign * beside) for row, sign in zip(rows, (-1, 1), strict=False)]
        assert points == pytest.approx(expected)
        plt.close(figure)


def test_the_picture_names_what_it_leaves_out(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    several = Design(pitch_mm=(8.0,), layouts=("square",), shapes=("round", "bar"), trials=1).run().rows
    words = " ".join(svg_words(draw_design(several, tmp_path / "d.svg")))
    assert "The first of 2 combinations of object, noise and rate. Object: round" in words
    assert "square taxels" in words


def test_bad_options_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ParameterInvalid, match="pitch_mm"):
        Design(pitch_mm=(100.0,))
    assert main(["design", "--plot", "d.txt"]) == 2
    assert "end in .svg" in capsys.readouterr().err
    assert main(["design", "--plot", "none/d.svg"]) == 2  # before the work, which would be lost
    assert "--plot must lie in a directory that exists (got 'none/d.svg')" in capsys.readouterr().err


def test_the_sensitive_area_of_a_taxel_is_within_it() -> None:
    with pytest.raises(ParameterInvalid, match="fill must be above 0 and at most 1"):
        Design(fill=1.1)
    wide, narrow = (np.ptp(lattice("square", 1.0, 2.0, fill)[1][0], axis=0) for fill in (1.0, 0.5))
    assert narrow == pytest.approx(wide / 2)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--layouts",), "--layouts must name at least one (got 'nothing')"),
        (("--size-mm",), "--size-mm must name at least one (got 'nothing')"),
        (("--trials", "10000000000"), "--trials must be between 1 and 100000 (got 10000000000)"),
        (("--rate-hz", "50", "1"), "window_s must hold two scans or more at 1 Hz (got 0.25)"),
    ],
)
def test_a_sweep_of_nothing_or_without_end_is_refused(
    words: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refused(capsys, "design", *words)


@pytest.mark.parametrize("scans", [2, 5, 12])
def test_the_error_of_the_velocity_is_that_of_a_line_through_the_window(scans: int) -> None:
    rate = 10.0
    (row,) = Design(pitch_mm=(10.0,), layouts=("square",), rate_hz=(rate,), window_s=scans / rate, trials=1).run().rows
    t_s = np.arange(scans) / rate
    assert row.speed_mm_s == pytest.approx(row.bound_mm / np.sqrt(np.sum((t_s - t_s.mean()) ** 2)))
