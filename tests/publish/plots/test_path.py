from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection

from costly import mostly_long
from rigged import track
from synthetic import grid_sensor
from taxelflow.publish.plots.path import path_figure
from taxelflow.publish.plots.style import save

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from taxelflow.publish.results import Track

pytestmark = pytest.mark.usefixtures("style")
LAYOUT = grid_sensor(4, 7, pads=3, missing=((0, 0), (3, 6))).layout
X = np.linspace(-0.02, 0.02, 30)


def dots(axis: Axes) -> PathCollection:
    (found,) = (item for item in axis.collections if isinstance(item, PathCollection))
    return found


def test_each_pad_has_its_own_axes_with_its_taxels_in_mm() -> None:
    figure = path_figure([track(X, X / 4, pad="pad2"), track(X, 0 * X, pad="pad0")], LAYOUT)
    pads = figure.axes[:2]
    assert [axis.get_title(loc="left") for axis in pads] == ["pad2", "pad0"]
    for axis in pads:
        (taxels,) = (item for item in axis.collections if isinstance(item, PolyCollection))
        assert len(taxels.get_paths()) == 26
        left, right = axis.get_xlim()
        low, high = axis.get_ylim()
        assert left < -35 < 35 < right
        assert low < -20 < 20 < high
        assert axis.get_xlabel() == "x in mm"
    assert pads[0].get_ylabel() == "y in mm"
    assert figure.axes[-1].get_ylabel() == "time in s"


def test_the_missing_taxels_are_missing_where_they_are_row_0_on_top() -> None:
    (axis, *_) = path_figure([track(X, X, pad="pad0")], LAYOUT).axes
    (taxels,) = (item for item in axis.collections if isinstance(item, PolyCollection))
    centres = np.array([path.get_extents().get_points().mean(axis=0) for path in taxels.get_paths()])
    assert not np.any(np.all(np.isclose(centres, [-30, 15]), axis=1))
    assert np.any(np.all(np.isclose(centres, [30, 15]), axis=1))


def test_dots_are_the_positions_coloured_by_time_and_larger_while_slipping() -> None:
    slipping = np.arange(30) >= 20
    figure = path_figure([track(X, X / 2, pad="pad1", slipping=slipping, t_s=np.arange(30) / 10 + 500)], LAYOUT)
    seen = dots(figure.axes[0])
    np.testing.assert_allclose(np.asarray(seen.get_offsets()), 1e3 * np.stack([X, X / 2], axis=1))
    colours = seen.get_array()
    assert colours is not None
    np.testing.assert_allclose(np.asarray(colours), np.arange(30) / 10, atol=1e-9)
    sizes = seen.get_sizes()
    assert sizes[slipping].min() > 2 * sizes[~slipping].max()


def test_unknown_positions_are_left_out(tmp_path: Path) -> None:
    unknown = np.where(np.arange(30) < 10, np.nan, X)
    figure = path_figure([track(unknown, unknown, pad="pad1")], LAYOUT)
    assert np.ma.masked_invalid(np.ma.filled(dots(figure.axes[0]).get_offsets(), np.nan)).count() == 40
    save(figure, tmp_path / "a.png")


@pytest.mark.parametrize(("rows", "cols"), mostly_long([(1, 1), (1, 16), (16, 1), (40, 40)], (1, 1), (16, 1)))
def test_pads_of_any_shape_are_drawn(tmp_path: Path, rows: int, cols: int) -> None:
    layout = grid_sensor(rows, cols).layout
    figure = path_figure([track(X / 100, X / 100, pad="pad0")], layout)
    width, height = figure.get_size_inches()
    assert 1 < width < 20
    assert 1 < height < 20
    save(figure, tmp_path / "a.png")


def test_a_path_that_leaves_the_pad_is_drawn_to_half_a_pad_beyond_it() -> None:
    near, far = (path_figure([track(x, 0 * X, pad="pad0")], LAYOUT).axes[0] for x in (3 * X, 30 * X))
    assert near.get_xlim()[0] < -60 < 60 < near.get_xlim()[1]
    assert far.get_xlim() == pytest.approx((-71.0, 71.0))
    assert near.get_ylim() == far.get_ylim() == pytest.approx((-20.5, 20.5))


def test_unknown_positions_leave_the_pad_alone() -> None:
    for known in (X < 0, X > 1):
        axis = path_figure([track(np.where(known, 0.0, np.nan), 0 * X, pad="pad0")], LAYOUT).axes[0]
        assert axis.get_xlim() == pytest.approx((-35.5, 35.5))


# Many contacts


def touches(count: int) -> Track:
    """Contacts of 10 scans, 10 scans apart; number k slides k mm in x, and slips in its second half."""
    t = np.arange(20 * count)
    contact, number = t % 20 < 10, t // 20
    x = np.where(contact, 1e-3 * number * (t % 20) / 9, np.nan)
    slipping = contact & (t % 20 >= 5)
    return track(x, 0.0 * x, pad="pad0", contact=contact, slipping=slipping)


def test_poses_that_are_not_ok_are_faint() -> None:
    figure = path_figure([track(X, X / 2, pad="pad1", ok=np.arange(30) < 20)], LAYOUT)
    alpha = np.asarray(dots(figure.axes[0]).get_alpha())
    assert (alpha[:20] == 1.0).all()
    assert (alpha[20:] < 0.5).all()
    assert "faint: quality not ok" in figure.get_supxlabel()
    assert "faint" not in path_figure([track(X, X / 2, pad="pad1")], LAYOUT).get_supxlabel()


@pytest.mark.long
def test_many_contacts_have_a_panel_each_with_start_and_path_while_slipping() -> None:
    axes = path_figure([touches(50)], LAYOUT).axes
    titles = [axis.get_title(loc="left") for axis in axes if axis.get_title(loc="left")]
    assert len(titles) == 50
    assert titles[36] == "pad0\n72.0 s  20 mm"  # of 36 mm in 9 steps, 5 are slips
    (line,) = (item for item in axes[36].collections if isinstance(item, LineCollection))
    ends = np.concatenate(line.get_segments())
    assert (ends[:, 0].min(), ends[:, 0].max()) == pytest.approx((0.0, 36.0))
    colours = line.get_colors()
    assert len({tuple(colour) for colour in colours[:4]}) == len({tuple(colour) for colour in colours[4:]}) == 1
    assert tuple(colours[0]) != tuple(colours[-1])


@pytest.mark.long
def test_of_more_contacts_than_panels_those_that_slip_farthest_are_drawn() -> None:
    figure = path_figure([touches(62)], LAYOUT)
    titles = [axis.get_title(loc="left") for axis in figure.axes if axis.get_title(loc="left")]
    assert len(titles) == 60
    assert titles[0].endswith("4.0 s  1 mm")  # number 2 of 62
    assert figure.get_supxlabel().startswith("The 60 of 62 contacts that slip farthest")


def test_contacts_without_positions_have_no_panel(tmp_path: Path) -> None:
    some = touches(10)
    some.numbers["x_m"][:100] = np.nan
    axis, scale = path_figure([some], LAYOUT).axes  # five contacts are left: one panel
    assert scale.get_ylabel() == "time in s"
    assert axis.get_title(loc="left") == "pad0"
    some.numbers["x_m"][:] = np.nan
    save(path_figure([some], LAYOUT), tmp_path / "a.png")


def test_panels_show_ways_that_leave_the_pad_on_one_scale_for_all() -> None:
    some = touches(8)
    some.numbers["x_m"] += 0.032  # the pad ends at 35 mm
    axes = [axis for axis in path_figure([some], LAYOUT).axes if axis.get_title(loc="left")]
    assert axes[-1].get_xlim()[1] > 39.0
    assert len({round(float(np.ptp(axis.get_xlim())), 6) for axis in axes}) == 1
