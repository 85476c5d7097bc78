from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taxelflow.errors import TipsOver
from taxelflow.messages import Floats
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.relief.balance import Sites, depths, pressure_at, settle
from taxelflow.simulation.relief.body import body_of
from taxelflow.simulation.relief.foundation import foundation_of
from taxelflow.simulation.relief.parameters import Object, Shape, Skin

LAYOUT = load_sensor("grid:10x10@3mm,kPa").layout
FLAT = foundation_of(LAYOUT, 0, Skin())


def sites_of(thing: Object, pose: Floats) -> Sites:
    cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    dx, dy = FLAT.x_m - pose[:, :1], FLAT.y_m - pose[:, 1:2]
    u_m, v_m = cos * dx + sin * dy, cos * dy - sin * dx
    return Sites(body_of(thing).height(u_m, v_m), u_m, v_m, FLAT.cell_m2)


@settings(max_examples=40, deadline=None)
@given(
    shape=st.sampled_from(get_args(Shape)),
    force_n=st.floats(0.5, 40.0),
    exponent=st.floats(0.8, 1.5),
    lever_m=st.tuples(st.floats(-5e-4, 5e-4), st.floats(-5e-4, 5e-4)),
    pose=st.tuples(st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3), st.floats(-3.0, 3.0)),
)
def test_the_pressure_carries_force_and_moment(
    shape: Shape, force_n: float, exponent: float, lever_m: tuple[float, float], pose: tuple[float, float, float]
) -> None:
    skin, sites = Skin(exponent=exponent), sites_of(Object(shape=shape), np.array([pose]))
    load = force_n * np.array([[1.0, *lever_m]])
    state = settle(skin, sites, load, np.array([[2e-3, 0.0, 0.0]]), True)
    pressure = pressure_at(skin, depths(sites, state))[0] * sites.cell_m2
    assert (pressure >= 0).all()
    assert pressure.sum() == pytest.approx(force_n, rel=1e-7)
    assert pressure @ sites.u_m[0] == pytest.approx(force_n * lever_m[0], abs=1e-9 * force_n)
    assert pressure @ sites.v_m[0] == pytest.approx(force_n * lever_m[1], abs=1e-9 * force_n)


def test_an_object_that_is_held_keeps_parallel_and_carries_the_force_only() -> None:
    sites = sites_of(Object(shape="key"), np.array([[4e-3, 0.0, 0.3], [0.0, 0.0, 0.0]]))
    state = settle(Skin(), sites, np.array([[5.0, 0.0, 0.0], [8.0, 0.0, 0.0]]), np.full((2, 3), [2e-3, 0, 0]), False)
    assert (state[:, 1:] == 0).all()
    assert pressure_at(Skin(), depths(sites, state)).sum(axis=1) * sites.cell_m2 == pytest.approx([5.0, 8.0])


def test_a_scan_is_settled_as_if_it_were_alone() -> None:
    sites = sites_of(Object(shape="bar"), np.array([[0.0, 0.0, 0.1], [3e-3, 1e-3, 0.4], [0.0, 2e-3, -0.7]]))
    load = np.array([[5.0, 0.0, 0.0], [1.0, 2e-4, 0.0], [9.0, 0.0, 1e-3]])
    start = np.full((3, 3), [2e-3, 0.0, 0.0])
    together = settle(Skin(exponent=1.2), sites, load, start, True)
    for k in range(3):
        alone = settle(Skin(exponent=1.2), sites.of(np.array([k])), load[k : k + 1], start[:1], True)
        assert together[k] == pytest.approx(alone[0], rel=1e-6, abs=1e-9)


def test_an_object_beside_the_skin_tips_over() -> None:
    sites = sites_of(Object(shape="nut"), np.array([[0.03, 0.0, 0.0]]))
    with pytest.raises(TipsOver, match="load point over the part of the skin"):
        settle(Skin(), sites, np.array([[5.0, 0.0, 0.0]]), np.array([[2e-3, 0.0, 0.0]]), True)


def test_all_laws_of_pressure_agree_at_the_reference_depth() -> None:
    depth = np.array([-1e-4, 0.0, 5e-4, 1e-3])
    for exponent in (0.8, 1.0, 1.5):
        law = pressure_at(Skin(exponent=exponent), depth)
        assert law[:3] == pytest.approx([0.0, 0.0, 5e4])
        assert law[3] == pytest.approx(5e4 * 2**exponent)
