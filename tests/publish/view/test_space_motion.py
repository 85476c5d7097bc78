from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taxelflow.messages import SpatialMotions, cut
from taxelflow.publish.view.panel import _table
from taxelflow.publish.view.space_motion import SpaceMotion, marks_of, path_of, velocity_at
from taxelflow.sensors.catalogue import load_sensor
from viewed import slips_of

MIDDLE = np.array([0.02, -0.01, 0.1])
TWIST = np.array([0.01, 0.02, -0.005, 0.3, -0.2, 0.5])


def turned(scans: int, rate_rad_s: float = 1.0) -> SpatialMotions:
    """An object that turns about z through the origin, 0.1 s a scan, and the twist TWIST that is told beside it."""
    angle = 0.1 * rate_rad_s * np.arange(scans)
    nothing = np.zeros(scans)
    pose = np.stack([nothing, nothing, nothing, nothing, nothing, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    twist = np.tile(TWIST, (scans, 1))
    covariance, six = np.tile(1e-10 * np.eye(6), (scans, 1, 1)), np.full(scans, 6)
    blind, one = np.zeros((scans, 6, 6)), np.zeros((scans, 1), dtype=np.bool_)
    return SpatialMotions(
        0.1 * np.arange(scans),
        twist,
        covariance,
        pose,
        covariance,
        six,
        six,
        blind,
        blind.copy(),
        twist,
        one,
        one[:, 0],
        np.ones(scans, dtype=np.int64),
    )


def last(motions: SpatialMotions) -> SpatialMotions:
    return cut(motions, len(motions) - 1, len(motions))


def test_the_path_is_that_of_the_point_that_is_now_in_the_middle() -> None:
    motions = turned(11)
    path, told = path_of(motions, MIDDLE, 11)
    angle = np.arctan2(MIDDLE[1], MIDDLE[0]) + np.linspace(-1.0, 0.0, 11)
    radius = np.hypot(*MIDDLE[:2])
    assert np.allclose(path, np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(11, 0.1)]))
    assert told.all()
    motions.pose[:6] = np.nan  # before contact
    path, _ = path_of(motions, MIDDLE, 11)
    assert np.allclose(path[0], [radius * np.cos(angle[6]), radius * np.sin(angle[6]), 0.1])
    assert not len(path_of(turned(2), MIDDLE, 11)[0])


def test_a_path_is_left_out_where_a_motion_of_the_point_is_not_observable() -> None:
    motions = turned(5)
    motions.pose_blind[:, 0] = [0.0, 0.0, 0.0, 0.0, 0.0, 20.0]  # a turn about z through the origin
    assert path_of(motions, np.array([0.0, 0.0, 0.1]), 5)[1].all()
    assert not path_of(motions, np.array([0.03, 0.0, 0.1]), 5)[1].any()


def test_marks_lie_along_unobservable_directions() -> None:
    blind = np.zeros((6, 6))
    blind[0, 1] = 1.0
    (shift,) = marks_of(blind, MIDDLE, 1.0)
    assert np.allclose(shift.mean(axis=0), MIDDLE)
    assert np.allclose(np.cross(shift[1] - shift[0], (0.0, 1.0, 0.0)), 0.0)
    axis = np.array([0.0, 0.0, 1.0])
    blind[0] = [*np.cross((0.02, 0.03, 0.0), axis), *axis]  # about z through x = 20 mm, y = 30 mm
    marks = marks_of(blind, MIDDLE, 1.0)
    assert np.allclose(marks[..., :2].mean(axis=(0, 1)), (0.02, 0.03))
    assert np.allclose(np.hypot(*(marks[1:, 0, :2] - (0.02, 0.03)).T), 0.05)
    assert marks_of(np.zeros((6, 6)), MIDDLE, 1.0).shape == (0, 2, 3)


def test_twist_axis_path_and_blind_directions_are_drawn_at_the_middle_of_the_contacts() -> None:
    viser = pytest.importorskip("viser", reason="viser is not installed (extra `view`)")
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        drawn = SpaceMotion(server, 0.2)
        motions = turned(11)
        motions.blind[-1, 0, 0] = 1.0
        drawn.show(last(motions), motions, MIDDLE, 2.0)
        speed = velocity_at(TWIST, MIDDLE)
        assert np.allclose(drawn._arrow.points, [[MIDDLE, MIDDLE + 2.0 * speed]], atol=1e-7)
        axis = np.asarray(drawn._axis.points[0], dtype=np.float64)
        for end in axis:  # on the axis the object moves along it only
            assert np.allclose(np.cross(velocity_at(TWIST, end), TWIST[3:]), 0.0, atol=1e-7)
        for handle in (drawn._arrow, drawn._turn, drawn._axis, drawn._path, drawn._blind, drawn._spread):
            assert handle.visible
        assert np.allclose(drawn._path.points[-1, 1], MIDDLE, atol=1e-7)
        assert drawn._spread.batched_scales.max() > 1e-5
        drawn.show(None, None, MIDDLE, 2.0)
        for handle in (drawn._arrow, drawn._turn, drawn._axis, drawn._path, drawn._blind, drawn._spread):
            assert not handle.visible
    finally:
        server.stop()


def test_the_panel_names_unobservable_directions() -> None:
    layout = load_sensor("schunk-sdh2").layout
    motions = turned(1)
    motions.blind[0, 0, 2] = 1.0
    results = slips_of(layout, motions.t_s, 0, 0.0, np.zeros(1))._replace(spatial=motions)
    table = _table(layout.pads, results, 1.0, "kPa")
    assert "not observable: translation along (0.00, 0.00, 1.00)" in table
    assert table.startswith("| pad | state | mm/s | sum of taxels, kPa | quality |")
    seen = replace(motions, blind=np.zeros((1, 6, 6)))
    assert "observable" not in _table(layout.pads, results._replace(spatial=seen), 1.0, "kPa")
