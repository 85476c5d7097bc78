from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.hand import JointsInvalid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

pytest.importorskip("matplotlib")
pytest.importorskip("mujoco")

from taxelflow.publish.plots.space import SpaceField, in_space, space_figure

pytestmark = pytest.mark.usefixtures("style")


def words(axis: Axes) -> set[str]:
    return {text.get_text() for text in axis.texts}


def test_a_hand_that_is_open_has_a_map_with_its_distortion() -> None:
    hand = in_space(load_sensor("barretthand-162"), "spread=60deg")
    figure = space_figure(hand, None, "open")
    assert [axis.name for axis in figure.axes] == ["3d", "rectilinear"]
    assert all(set(hand.names) <= words(axis) for axis in figure.axes)
    assert "1.00 to 1.00 times" in figure.get_supxlabel()
    assert [axis.get_ylabel() for axis in figure.axes] == ["y in mm", "y on the map in mm"]


def test_a_sensor_without_a_hand_is_told_to_leave_the_angles_out() -> None:
    with pytest.raises(JointsInvalid, match="no pad of hexagon-61 has a link or a pose; leave --joints out"):
        in_space(load_sensor("hexagon-61"), "spread=60deg")


def test_angles_beyond_a_range_are_noted_and_no_table_is_offered(caplog: pytest.LogCaptureFixture) -> None:
    in_space(load_sensor("barretthand-162"), "f1=69 f2=1")
    says = "joint f1 is at 69 rad, its range is 0 to 2.443 rad: check that its angles are in rad"
    assert [record.message for record in caplog.records] == [says]
    with pytest.raises(
        JointsInvalid,
        match=r"'angles.csv' is not JOINT=ANGLE; .* \(rad without a unit\) or a named pose \(spread, hook\)$",
    ):
        in_space(load_sensor("barretthand-162"), "angles.csv")


def test_a_hand_around_its_object_is_shown_from_two_sides() -> None:
    hand = in_space(load_sensor("schunk-sdh2"), "parallel")
    figure = space_figure(hand, None, "parallel")
    assert [axis.name for axis in figure.axes] == ["3d", "3d"]
    assert all(set(hand.names) <= words(axis) for axis in figure.axes)
    assert "too far for a map" in figure.get_supxlabel()


def test_faces_have_their_taxel_in_the_middle_and_its_normal() -> None:
    hand = in_space(load_sensor("barretthand-162"), "spread")
    for place, normal, face in zip(hand.places, hand.normals, hand.faces, strict=True):
        np.testing.assert_allclose(face.mean(axis=0), place, atol=1e-12)
        np.testing.assert_allclose((face - place) @ normal, 0.0, atol=1e-12)


@pytest.mark.parametrize("unknown", [False, True])
def test_a_field_is_drawn_on_both_panels(unknown: bool) -> None:
    hand = in_space(load_sensor("barretthand-162"), "spread=60deg")
    vectors = np.full((1, 3), np.nan) if unknown else np.array([[0.0, 0.025, 0.0]])
    figure = space_figure(hand, SpaceField(hand.places[:1], vectors, "25 mm/s."), "open")
    assert "25 mm/s." in figure.get_supxlabel()
    assert len(figure.axes[1].lines) == (0 if unknown else 1)  # the map's centre
