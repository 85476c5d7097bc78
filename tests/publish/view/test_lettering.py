from __future__ import annotations

import numpy as np
import pytest

from taxelflow.acquire.joints import constant_joints
from taxelflow.publish.view.camera import Camera, picture_axes, view_of
from taxelflow.publish.view.legend import Scales, drawn
from taxelflow.publish.view.lettering import text_image
from taxelflow.publish.view.palette import DARK, LIGHT, number, round_up
from taxelflow.sensors.catalogue import load_sensor


def test_words_have_one_colour_and_stand_on_nothing() -> None:
    short, long = text_image("palm", DARK.words), text_image("finger3_mid", DARK.words)
    assert (long[..., :3] == DARK.words).all()  # also where nothing is, or edges would be dark
    assert set(np.unique(long[[0, -1], :, 3])) == {0}
    assert long[..., 3].max() == 255
    assert long.shape[1] > 2 * short.shape[1]


def test_numbers_of_the_scale_do_not_touch() -> None:
    def ink(top: float, unit: str) -> np.ndarray:
        """Columns below the bar that have ink."""
        image = drawn(DARK, Scales(top, unit, 0.03, moves=True))
        columns: np.ndarray = image[52:, :520, 3].any(axis=0)
        return columns

    for top, unit, numbers in ((80.0, "kPa", 3), (80_000.0, "counts", 2)):
        gaps = np.diff(np.flatnonzero(ink(top, unit)))
        assert (gaps > 40).sum() == numbers - 1


def test_the_legend_is_drawn_in_the_colours_of_the_theme() -> None:
    scales = Scales(80.0, "kPa", 0.03, moves=True)
    for theme in (DARK, LIGHT):
        image = drawn(theme, scales)
        opaque = image[image[..., 3] == 255][:, :3]
        for colour in (theme.words, theme.line, theme.ring):
            assert (opaque == colour).all(axis=1).any()
    assert not np.array_equal(drawn(DARK, scales), drawn(DARK, scales._replace(moves=False)))


def test_a_point_that_is_drawn_nearer_appears_in_the_same_place() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(0, 0.1, (50, 3))
    camera = Camera(np.array([0.6, -0.8, 0.9]), np.zeros(3))
    view = view_of(camera, points, 0.5)
    for point in points:
        near, share = view.nearer(point)
        before, after = point - view.eye, near - view.eye
        assert after == pytest.approx(share * before)
        assert -after @ view.axes.out == pytest.approx(view.front_m)


def test_scales_are_round_and_used_to_two_thirds_at_least() -> None:
    for value in np.geomspace(1e-3, 1e6, 200):
        top = round_up(float(value))
        assert value <= top * (1 + 1e-9)
        assert value > top * (2 / 3 - 1e-9)
        assert round_up(top) == top
    assert [round_up(value) for value in (0.0, float("nan"), float("inf"))] == [1.0, 1.0, 1.0]
    assert [number(value) for value in (0.5, 7.5, 150.0, 80_000.0)] == ["0.5", "7.5", "150", "80 000"]


def test_names_are_written_after_the_first_picture_and_face_the_camera_that_moved_last() -> None:
    pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    from taxelflow.publish.view.scene import Scene
    from taxelflow.publish.view.server import PageServer

    sensor = load_sensor("barretthand-162")
    with PageServer(port=0) as server:
        scene = Scene(server.viser, sensor, constant_joints({"f1": 0.4}, sensor))
        scene.configure(theme=DARK)
        words = scene._names._words[0]
        assert words._handle is None
        scene.name()
        first = words._handle.wxyz.copy()
        camera = Camera(np.array([-1.0, 1.5, 0.4]), np.zeros(3))
        scene.turn(camera)
        assert words._handle.wxyz == pytest.approx(picture_axes(camera.position).wxyz)
        assert not np.allclose(words._handle.wxyz, first)
        scene.configure(theme=LIGHT)
        assert tuple(words._handle.image[0, 0, :3]) == LIGHT.words
