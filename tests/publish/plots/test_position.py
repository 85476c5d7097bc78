from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.colors import same_color

from rigged import track
from taxelflow.publish.plots.position import position_figure
from taxelflow.publish.plots.style import LOOK, save, styled

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.messages import Floats

T = np.arange(40) / 10
THERE = 0.02 * T - 0.04  # 20 mm/s
STILL = np.zeros(40)


@pytest.fixture(autouse=True)
def style() -> Iterator[None]:
    import matplotlib.pyplot as plt

    with styled():
        yield
    plt.close("all")


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


@pytest.mark.parametrize(("x", "y", "labels"), [(THERE, STILL, "xy"), (STILL, THERE, "yx")])
def test_the_direction_of_most_motion_stands_above(x: Floats, y: Floats, labels: str) -> None:
    figure = position_figure([track(x, y)])
    assert [axis.get_ylabel() for axis in figure.axes] == [f"{letter} in mm" for letter in labels]
    assert figure.axes[1].get_xlabel() == "time in s"
    assert figure.axes[0].get_title(loc="left") == "Object on palm"


def test_methods_and_truth_overlay_each_with_its_look() -> None:
    tracks = [track(THERE, STILL), track(THERE + 0.001, STILL, method="convolution")]
    figure = position_figure(tracks, (T, np.stack([THERE, STILL], axis=1)))
    assert sorted(legend(figure)) == ["L norm (Method I)", "optical flow (Method II)", "truth"]
    for method in ("lnorm", "convolution"):
        (line,) = (line for line in figure.axes[0].lines if line.get_label() == LOOK[method]["label"])
        assert same_color(line.get_color(), LOOK[method]["color"])
        assert line.get_marker() == LOOK[method]["marker"]


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


@pytest.mark.parametrize("scans", [1, 2, 40])
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
    spans: list[Any] = [float(np.ptp(axis.get_ylim())) for axis in figure.axes]
    assert spans[1] >= 0.1 * spans[0]


def test_more_strokes_than_leave_room_have_lines_without_numbers() -> None:
    strokes = [(0.4 * k, 0.4 * k + 0.35) for k in range(9)]
    figure = position_figure([track(THERE, STILL)], strokes=strokes)
    assert slopes(figure) == []
    assert sum(line.get_linestyle() != "None" for line in figure.axes[0].lines) == 9
