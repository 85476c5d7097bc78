from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.colors import same_color
from mpl_toolkits.mplot3d.axes3d import Axes3D

from taxelflow.estimation.centroid.paper_reference import convolution_matrix
from taxelflow.publish.plots.style import save
from taxelflow.publish.plots.views import views_figure

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.messages import Floats

pytestmark = pytest.mark.usefixtures("style")
PRESSURE = np.array([[np.nan, 1.0, 2.0, np.nan], [0.5, 3.0, 7.0, 1.0], [0.0, -0.2, 1.0, np.nan]])


def views(pressure: Floats = PRESSURE, slip_mm: tuple[float, float] = (3.0, 4.0)) -> Figure:
    convolution = convolution_matrix(np.nan_to_num(pressure), np.nan_to_num(pressure))
    return views_figure("palm at 1.00 s", pressure, "kPa", convolution, slip_mm)


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


def test_the_headings_name_what_is_drawn() -> None:
    figure = views()
    assert figure.get_suptitle() == "palm at 1.00 s"
    for heading in ("pressure in kPa, maximum in magenta", "convolution C[T]", "slip, 5.00 mm a scan"):
        assert heading in words(figure)


def test_there_is_a_bar_for_each_taxel_and_the_largest_is_magenta(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    draw = Axes3D.bar3d

    def noted(axis: Axes3D, *place: Any, **more: Any) -> object:
        drawn.append((*place, more["color"]))
        return draw(axis, *place, **more)

    monkeypatch.setattr(Axes3D, "bar3d", noted)
    figure = views()
    ((left, front, _, width, depth, height, colours),) = drawn
    places = np.stack([front + depth / 2, left + width / 2], axis=1)
    np.testing.assert_allclose(places, np.argwhere(np.isfinite(PRESSURE)))
    np.testing.assert_array_equal(height, np.clip(PRESSURE[np.isfinite(PRESSURE)], 0, None))
    assert [same_color(colour, "#cc2fa0") for colour in colours] == (height == 7.0).tolist()
    axis = figure.axes[0]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("column", "row")
    assert axis.get_ylim()[0] > axis.get_ylim()[1]  # row 0 is the far one


def test_the_centroid_of_the_convolution_is_the_sum_of_the_centroids() -> None:
    figure = views()
    clean = np.nan_to_num(PRESSURE)
    i = 2 * float(np.arange(1, 5) @ clean.sum(axis=0) / clean.sum()) - 1
    j = 2 * float(np.arange(1, 4) @ clean.sum(axis=1) / clean.sum()) - 1
    assert figure.axes[1].get_xlabel() == f"i   (centroid {i:.2f})"
    assert figure.axes[1].get_ylabel() == f"j   (centroid {j:.2f})"
    (cross,) = figure.axes[1].lines
    np.testing.assert_allclose(np.asarray(cross.get_xydata(), dtype=np.float64), np.array([[i, j]]))


@pytest.mark.parametrize("slip_mm", [(3.0, 4.0), (-0.01, 0.002), (0.0, -80.0), (0.0, 0.0)])
def test_the_vector_points_where_the_object_went_and_stays_within_the_rings(slip_mm: tuple[float, float]) -> None:
    axis = views(slip_mm=slip_mm).axes[2]
    arrows = [text for text in axis.texts if text.get_text() == ""]
    rings = [float(text.get_text().removesuffix(" mm")) for text in axis.texts if text.get_text()]
    size = float(np.hypot(*slip_mm))
    assert len(arrows) == (size > 0)
    assert [arrow.xy for arrow in arrows] == [slip_mm] * len(arrows)  # type: ignore[attr-defined]
    assert len(rings) == 3
    assert size <= rings[-1] * 1.001
    np.testing.assert_allclose(np.diff([0, *rings]), rings[0], rtol=0.02)


def test_a_slip_beyond_all_rings_is_still_drawn() -> None:
    axis = views(slip_mm=(5e3, 0.0)).axes[2]
    assert axis.get_xlim()[1] > 5e3


def test_a_scan_without_pressure_is_drawn_without_a_warning(tmp_path: Path) -> None:
    figure = views(np.zeros((3, 4)), (0.0, 0.0))
    assert "nan" not in figure.axes[1].get_xlabel()
    save(figure, tmp_path / "a.png")


@pytest.mark.parametrize("shape", [(1, 1), pytest.param((1, 8), marks=pytest.mark.long), (14, 6)])
def test_pads_of_any_shape_are_drawn(tmp_path: Path, shape: tuple[int, int]) -> None:
    figure = views(np.random.default_rng(0).uniform(0, 5, shape))
    save(figure, tmp_path / "a.svg")
    assert "column" in (tmp_path / "a.svg").read_text()
