from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import same_color

from costly import mostly_long
from rigged import track
from taxelflow.messages import Event
from taxelflow.publish.plots.position import position_figure
from taxelflow.publish.plots.style import LOOK, save

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.messages import Floats

pytestmark = pytest.mark.usefixtures("style")
T = np.arange(40) / 10
THERE = 0.02 * T - 0.04  # 20 mm/s
STILL = np.zeros(40)


def legend(figure: Figure) -> list[str]:
    shown = figure.axes[0].get_legend()
    assert shown is not None
    return [text.get_text() for text in shown.get_texts()]


def slopes(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts]


def points(figure: Figure, axis: int, label: str) -> Floats:
    (line,) = (line for line in figure.axes[axis].lines if line.get_label() == label)
    return np.asarray(line.get_xydata(), dtype=np.float64)


def test_positions_stand_in_mm_against_the_time_from_the_first_scan() -> None:
    figure = position_figure([track(THERE, STILL + 0.003, t_s=T + 1e6)])
    seen = points(figure, 0, LOOK["lnorm"]["label"])
    np.testing.assert_allclose(seen[:, 0], T, atol=1e-6)
    np.testing.assert_allclose(seen[:, 1], 1e3 * THERE)
    np.testing.assert_allclose(points(figure, 1, LOOK["lnorm"]["label"])[:, 1], 3.0)


def test_positions_stand_where_they_were_true() -> None:
    figure = position_figure([track(THERE, STILL, lag_s=0.05)])
    np.testing.assert_allclose(points(figure, 0, LOOK["lnorm"]["label"])[:, 0], T - 0.05, atol=1e-9)


def test_positions_that_are_not_ok_are_faint_and_the_title_explains_it() -> None:
    figure = position_figure([track(THERE, STILL, ok=T < 1)])
    sure, doubted = (points(figure, 0, label) for label in (LOOK["lnorm"]["label"], "_doubted"))
    np.testing.assert_allclose(sure[:, 0], T[T < 1], atol=1e-9)
    np.testing.assert_allclose(doubted[:, 0], T[T >= 1], atol=1e-9)
    assert figure.axes[0].get_title(loc="right").endswith("faint: quality not ok")
    assert legend(figure) == [LOOK["lnorm"]["label"]]
    assert "faint" not in position_figure([track(THERE, STILL)]).axes[0].get_title(loc="right")


@pytest.mark.parametrize(("x", "y", "labels"), [(THERE, STILL, "xy"), (STILL, THERE, "yx")])
def test_the_direction_of_most_motion_stands_above(x: Floats, y: Floats, labels: str) -> None:
    figure = position_figure([track(x, y)])
    assert [axis.get_ylabel() for axis in figure.axes[:2]] == [f"{letter} in mm" for letter in labels]
    assert figure.axes[-1].get_xlabel() == "time in s"
    assert figure.axes[0].get_title(loc="left") == "Object on palm"


def test_methods_and_truth_overlay_each_with_its_look() -> None:
    tracks = [track(THERE, STILL), track(THERE + 0.001, STILL, method="convolution")]
    figure = position_figure(tracks, (T, np.stack([THERE, STILL], axis=1)))
    assert sorted(legend(figure)) == ["L norm (Method I)", "optical flow (Method II)", "truth"]
    for method in ("lnorm", "convolution"):
        (line,) = (line for line in figure.axes[0].lines if line.get_label() == LOOK[method]["label"])
        assert same_color(line.get_color(), LOOK[method]["color"])
        assert line.get_marker() == LOOK[method]["marker"]


def test_results_that_would_look_alike_differ_in_colour_and_by_a_number() -> None:
    methods = ("template", "registration", "lnorm", "lnorm")
    figure = position_figure([track(THERE, STILL, method=method) for method in methods])
    assert legend(figure) == ["template", "registration", "L norm (Method I)", "L norm (Method I), 2"]
    assert [name.get_text() for name in figure.axes[3].get_yticklabels()] == [*methods[:3], "lnorm, 2"]
    lines = [line for line in figure.axes[0].lines if line.get_label() in legend(figure)]
    assert len({str(line.get_color()) for line in lines}) == len({line.get_marker() for line in lines}) == 4
    assert same_color(lines[2].get_color(), LOOK["lnorm"]["color"])


def test_a_method_from_elsewhere_goes_by_its_name() -> None:
    assert legend(position_figure([track(THERE, STILL, method="mine")])) == ["mine"]


def test_truth_is_drawn_only_where_some_method_saw_contact() -> None:
    contact = (T >= 1.0) & (T < 2.0)
    figure = position_figure([track(THERE, STILL, contact=contact)], (T, np.stack([THERE, STILL], axis=1)))
    truth = points(figure, 0, "truth")
    np.testing.assert_array_equal(np.isfinite(truth[:, 1]), contact)
    np.testing.assert_allclose(truth[contact, 1], 1e3 * THERE[contact])


@pytest.mark.parametrize(("speed", "text"), [(0.025, "+25.0 mm/s"), (-0.0502, "-50.2 mm/s")])
def test_a_regression_line_gives_the_speed_of_each_stroke(speed: float, text: str) -> None:
    figure = position_figure([track(speed * T, STILL)], strokes=[(0.95, 2.05)])
    assert slopes(figure) == [text]
    (line,) = (line for line in figure.axes[0].lines if line.get_linestyle() != "None")
    ends = np.array([[1.0, 1e3 * speed], [2.0, 2e3 * speed]])
    np.testing.assert_allclose(np.asarray(line.get_xydata(), dtype=np.float64), ends)


def test_each_method_has_its_line_in_each_stroke() -> None:
    tracks = [track(np.abs(THERE), STILL), track(1.1 * np.abs(THERE), STILL, method="convolution")]
    figure = position_figure(tracks, strokes=[(0.0, 1.9), (2.1, 3.9)])
    assert slopes(figure) == ["-20.0 mm/s", "+20.0 mm/s", "-22.0 mm/s", "+22.0 mm/s"]


def test_a_lag_does_not_bend_the_line() -> None:
    bent = np.abs(0.02 * (T - 0.05 - 2))
    figure = position_figure([track(bent, STILL, lag_s=0.05)], strokes=[(0.0, 2.0), (2.0, 3.9)])
    assert slopes(figure) == ["-20.0 mm/s", "+20.0 mm/s"]


def test_there_is_no_line_without_strokes_or_through_fewer_than_three_positions() -> None:
    assert slopes(position_figure([track(THERE, STILL)])) == []
    assert slopes(position_figure([track(THERE, STILL)], strokes=[(1.0, 1.15)])) == []
    unknown = np.where((T > 1) & (T < 2), np.nan, THERE)
    assert slopes(position_figure([track(unknown, unknown)], strokes=[(1.05, 1.95)])) == []


def test_unknown_positions_leave_gaps() -> None:
    unknown = np.where((T > 1) & (T < 2), np.nan, THERE)
    seen = points(position_figure([track(unknown, unknown)]), 0, LOOK["lnorm"]["label"])
    np.testing.assert_array_equal(np.isnan(seen[:, 1]), np.isnan(unknown))


@pytest.mark.parametrize("scans", mostly_long([1, 2, 40], 1))
def test_a_track_without_any_position_is_drawn_empty(tmp_path: Path, scans: int) -> None:
    nothing = np.full(scans, np.nan)
    figure = position_figure([track(nothing, nothing)], strokes=[(0.0, 1.0)])
    save(figure, tmp_path / "a.svg")
    assert (tmp_path / "a.svg").stat().st_size > 1000


def test_one_track_without_positions_does_not_hide_the_other() -> None:
    nothing = np.full(40, np.nan)
    figure = position_figure([track(nothing, nothing, method="convolution"), track(STILL, THERE)])
    assert figure.axes[0].get_ylabel() == "y in mm"


def test_a_small_drift_does_not_look_like_a_large_one() -> None:
    figure = position_figure([track(THERE, 1e-6 * np.sin(T))])
    spans: list[Any] = [float(np.ptp(axis.get_ylim())) for axis in figure.axes[:2]]
    assert spans[1] >= 0.1 * spans[0]


def test_more_strokes_than_leave_room_have_lines_without_numbers() -> None:
    strokes = [(0.4 * k, 0.4 * k + 0.35) for k in range(9)]
    figure = position_figure([track(THERE, STILL)], strokes=strokes)
    assert slopes(figure) == []
    assert sum(line.get_linestyle() != "None" for line in figure.axes[0].lines) == 9


# Uncertainty, load, slip and events


def bars(figure: Figure) -> list[tuple[float, float]]:
    """From and to of the solid bars of slip in the lanes, from the top."""
    found = [item for item in figure.axes[3].collections if isinstance(item, PolyCollection)]
    shapes = [path.get_extents() for item in found[1::2] for path in item.get_paths()]
    return [(float(shape.x0), float(shape.x1)) for shape in shapes]


def test_a_band_shows_one_standard_deviation_and_does_not_stretch_the_axis() -> None:
    sure = track(THERE, STILL)
    for std, name in ((0.003, "std_x_m"), (5.0, "std_y_m")):
        sure.numbers[name] = np.full(40, std)
    figure = position_figure([sure])
    (band,) = figure.axes[0].collections
    vertices = band.get_paths()[0].vertices
    for t_s in (1.0, 3.0):
        at = vertices[np.isclose(vertices[:, 0], t_s)][:, 1]
        np.testing.assert_allclose([at.min(), at.max()], 1e3 * (0.02 * t_s - 0.04) + np.array([-3, 3]), atol=1e-9)
    assert np.ptp(figure.axes[1].get_ylim()) < 100


def test_slips_are_shaded_and_have_a_bar_in_the_lane_of_their_method() -> None:
    slips = [(T >= 1.0) & (T <= 2.0), (T >= 3.0) & (T <= 3.5)]
    tracks = [track(THERE, STILL, method=name, slipping=s) for name, s in zip(("lnorm", "mine"), slips, strict=True)]
    figure = position_figure(tracks)
    shaded = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in figure.axes[0].patches]  # type: ignore[attr-defined]
    np.testing.assert_allclose(shaded, [(0.9, 2.0), (2.9, 3.5)])  # a slip moves the object since the scan before
    np.testing.assert_allclose(bars(figure), shaded)
    assert [label.get_text() for label in figure.axes[3].get_yticklabels()] == ["lnorm", "mine"]


def test_load_is_a_share_of_its_largest() -> None:
    loaded = track(THERE, STILL)
    loaded.numbers["load_pa"] = np.linspace(0.0, 8e4, 40)
    (line,) = position_figure([loaded]).axes[2].lines
    np.testing.assert_allclose(np.asarray(line.get_ydata(), dtype=np.float64), np.linspace(0, 100, 40))


@pytest.mark.long
def test_events_stand_at_their_onset_in_the_lane_of_their_method() -> None:
    events = [Event(12.0, "palm", "slip_start", onset_s=11.5), Event(13.0, "palm", "slip_suspected")]
    figure = position_figure([track(THERE, STILL, t_s=T + 10)] * 2, events=[[], events])
    marks = [(line.get_marker(), *np.ravel(line.get_xydata())) for line in figure.axes[3].lines]
    assert marks == [(">", 1.5, 1), ("D", 3.0, 1)]


def test_of_many_events_only_suspected_slips_are_marked_beside_the_bars() -> None:
    events = [Event(0.1 * k, "palm", "slip_start") for k in range(40)] + [Event(2.0, "palm", "slip_suspected")]
    figure = position_figure([track(THERE, STILL)], events=[events])
    assert [line.get_marker() for line in figure.axes[3].lines] == ["D"]
    note = figure.axes[0].get_title(loc="right")
    assert "◆ suspected" in note
    assert "▶" not in note
