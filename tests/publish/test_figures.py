"""Pictures from arrays alone: which are drawn, under which names; strokes of a truth."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rigged import rigged, svg_words, track
from taxelflow.messages import LearnedPattern
from taxelflow.publish.figures import PadTracks, Pictures, ResultPictures, Views, draw_results, remove_older, strokes_of
from taxelflow.publish.plots.hand import Moment
from taxelflow.publish.plots.pattern import Contact
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.motion import move
from taxelflow.simulation.scenario import Motion
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from pathlib import Path

LAYOUT = load_sensor("barretthand-162").layout
T_S = np.arange(20) / 10
POSE = np.stack([0.02 * T_S - 0.02, 0.0 * T_S, 0.0 * T_S], axis=1)


def contact() -> Contact:
    x, y = np.linspace(-0.03, 0.03, 40), np.linspace(-0.02, 0.02, 30)
    u, v = np.meshgrid(x, y)
    pressure = 50e3 * np.exp(-(u**2 / 2e-4 + v**2 / 5e-5))
    pattern = LearnedPattern("palm", 0.0, 2.0, 20, x, y, pressure, 0.01 * pressure, True, np.zeros(0, np.int64))
    return Contact(pattern, "Pa", T_S, POSE, np.full((20, 3), 1e-3), T_S < 1.0, 4)


def result(method: str, *, contacts: bool = False, moments: bool = False) -> ResultPictures:
    vectors = np.full((len(LAYOUT.pads), 2), 0.01)
    twist, centre = np.array([0.01, 0.0, 0.0]), np.full(2, np.nan)
    moment = Moment("0.50 s", LAYOUT.T_hand[:, :2], vectors, twist, centre)
    tracks = [track(POSE[:, 0], POSE[:, 1], method=method, pad="palm")]
    return ResultPictures(method, LAYOUT, tracks, [contact()] if contacts else [], [moment] if moments else [])


@pytest.mark.long
def test_patterns_of_all_contacts_are_drawn_together(tmp_path: Path) -> None:
    one = contact().pattern
    several = [replace(one, t_first_s=float(k), t_last_s=k + 0.5) for k in range(11)]
    made = draw_results(Pictures([], [replace(result("template"), patterns=several)], None), tmp_path, "svg")
    assert [path.stem for path in made] == ["patterns-template", "path-template"]
    words = svg_words(made[0])
    assert words.count("palm") == 11
    assert {"0.0 s, 20 scans", "10.0 s, 20 scans", f"peak {one.pressure.max() / 1e3:.3g} kPa"} <= set(words)
    assert any(word.startswith("All 11 learned patterns") for word in words)


def test_pictures_of_earlier_methods_are_removed_from_a_result(tmp_path: Path) -> None:
    older, table = ("views.svg", "path-lnorm.svg", "position-a b.svg", "pattern-a_b-2.png"), tmp_path / "slips.csv"
    newer, others = ("position-a b.png",), ("path-mine.svg", "positions.svg", "path-lnorm.csv", "views.gif")
    for name in (*older, *newer, *others):
        (tmp_path / name).write_text("")
        os.utime(tmp_path / name, (10.0, 10.0) if name in newer else (1.0, 1.0))
    table.write_text("")
    os.utime(table, (5.0, 5.0))
    made = tmp_path / "path-template.svg"
    made.write_text("")
    remove_older(tmp_path, [made], ["a b", "a/b"], ["lnorm", "template"])
    assert {path.name for path in tmp_path.iterdir()} == {*newer, *others, made.name, table.name}


def views() -> Views:
    image = np.arange(28.0).reshape(4, 7)
    return Views("palm at 0.50 s", image, "kPa", np.ones((7, 13)), (1.0, 0.0))


@pytest.mark.long
def test_pictures_are_drawn_of_arrays_alone_in_a_fixed_order(tmp_path: Path) -> None:
    results = [result("lnorm"), result("template", contacts=True, moments=True)]
    pads = [PadTracks("palm", [one for each in results for one in each.tracks], (T_S, POSE))]
    made = draw_results(Pictures(pads, results, views()), tmp_path / "deep" / "out", "svg")
    names = ["position-palm", "pattern-palm", "path-lnorm", "path-template", "field-template", "views"]
    assert made == [tmp_path / "deep" / "out" / f"{name}.svg" for name in names]
    assert sorted(made) == sorted((tmp_path / "deep" / "out").iterdir())
    words = svg_words(made[0])
    assert {"Object on palm", "truth"} <= set(words)
    assert sum(word.endswith(" mm/s") for word in words) == 2  # one stroke, by two methods


def test_a_result_keeps_its_number_on_a_pad_that_the_other_did_not_see(tmp_path: Path) -> None:
    results = [replace(result("lnorm"), tracks=[]), result("lnorm")]
    made = draw_results(Pictures([PadTracks("palm", results[1].tracks, None)], results, None), tmp_path, "svg")
    assert {"lnorm, 2", "L norm (Method I), 2"} <= set(svg_words(made[0]))


@pytest.mark.long
def test_without_truth_patterns_and_views_only_positions_and_paths_are_drawn(tmp_path: Path) -> None:
    alone = result("lnorm")
    made = draw_results(Pictures([PadTracks("palm", alone.tracks, None)], [alone], None), tmp_path, "svg")
    assert [path.stem for path in made] == ["position-palm", "path-lnorm"]
    assert "truth" not in svg_words(made[0])


@pytest.mark.long
def test_two_results_of_one_method_have_files_of_their_own(tmp_path: Path) -> None:
    made = draw_results(Pictures([], [result("lnorm"), result("lnorm")], None), tmp_path, "svg")
    assert [path.stem for path in made] == ["path-lnorm", "path-lnorm-2"]


# Strokes


@given(
    strokes=st.integers(1, 5),
    speed=st.floats(0.005, 0.1),
    direction=st.floats(0, 6),
    rate_hz=st.floats(5, 100),
    rest_s=st.floats(0.5, 2),
    start_s=st.sampled_from([0.0, 500.0]),
)
def test_the_strokes_of_a_back_and_forth_way_are_found(
    strokes: int, speed: float, direction: float, rate_hz: float, rest_s: float, start_s: float
) -> None:
    motion = Motion(speed_m_s=speed, direction_rad=direction, travel_m=0.1, strokes=strokes, rest_s=rest_s)
    assume(motion.stroke_s * rate_hz > 6)
    t_s = np.arange(0, motion.duration_s, 1 / rate_hz)
    found = strokes_of(t_s + start_s, move(motion, t_s).pose)
    assert len(found) == strokes
    for number, (first, last) in enumerate(found):
        begin = start_s + rest_s + number * motion.stroke_s
        assert -1e-6 <= first - begin <= 1 / rate_hz + 1e-6
        assert -1e-6 <= begin + motion.stroke_s - last <= 1 / rate_hz + 1e-6


def test_rest_and_turning_in_place_are_no_strokes() -> None:
    for scenario in (rigged("turn"), rigged(motion={"travel_m": 0.0})):
        truth = simulate(scenario).truth
        assert truth is not None
        assert strokes_of(truth.t_s, truth.pose) == []


def test_turning_does_not_break_a_stroke() -> None:
    truth = simulate(rigged("slide-and-turn")).truth
    assert truth is not None
    assert len(strokes_of(truth.t_s, truth.pose)) == 2


@pytest.mark.parametrize("scans", [0, 1, 2])
def test_a_truth_too_short_has_no_strokes(scans: int) -> None:
    assert strokes_of(np.arange(scans) / 10, np.arange(3.0 * scans).reshape(scans, 3)) == []


def test_repeated_times_in_the_truth_do_no_harm() -> None:
    truth = simulate(rigged()).truth
    assert truth is not None
    t_s, pose = (np.insert(array, 40, array[40], axis=0) for array in (truth.t_s, truth.pose))
    assert strokes_of(t_s, pose) == strokes_of(truth.t_s, truth.pose)
