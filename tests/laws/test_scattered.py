"""What every estimator owes to taxels that lie in no grid."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from synthetic import dome, grid_sensor, scans_of, slips_by
from tabled import arched, hexagonal, square, table_sensor
from taxelflow.messages import Floats
from taxelflow.pipeline.api import estimate
from taxelflow.runtime import registry
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.parameters import Contact, Motion, Sensing
from taxelflow.simulation.scenario import Scenario
from taxelflow.simulation.simulate import simulate

METHODS = ("lnorm", "convolution", "principal_axis")
every_method = pytest.mark.parametrize("method", registry.names("estimator"))
paper_or_moments = pytest.mark.parametrize("method", (*METHODS, "sum"))
NOISE = 10.0


def sliding(
    sensor: Sensor, direction: float, scans: int = 40, step_m: float = 2.5e-4, radius_m: float = 0.004
) -> Floats:
    """A dome that slides through the middle, (scans, taxels)."""
    along = step_m * (np.arange(scans) - scans / 2)
    return np.stack([dome(sensor, a * np.cos(direction), a * np.sin(direction), radius_m=radius_m) for a in along])


def slips(method: str, sensor: Sensor, pressure: Floats, **more: Any) -> Any:
    return slips_by(method, sensor, scans_of(sensor, pressure, noise=NOISE, **more))


@paper_or_moments
def test_a_grid_gives_the_same_as_the_table_of_its_taxels(method: str) -> None:
    grid, table = grid_sensor(6, 9), table_sensor(square(6, 9))
    pressure = sliding(grid, 0.3, step_m=1e-3, radius_m=0.012)
    one, other = slips(method, grid, pressure), slips(method, table, pressure)
    for field in fields(one):
        np.testing.assert_allclose(
            getattr(one, field.name), getattr(other, field.name), rtol=1e-6, atol=1e-12, err_msg=field.name
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("direction", [0.0, 0.5, np.pi / 2, 2.3])
def test_a_hexagonal_pad_observes_motion_in_every_direction(method: str, direction: float) -> None:
    sensor = table_sensor(hexagonal(5, 0.003))
    seen = slips(method, sensor, sliding(sensor, direction))
    known = np.isfinite(seen.pose[:, 0, 0])
    moved = seen.pose[known, 0, :2]
    way = moved[-1] - moved[0]
    true = 2.5e-4 * (known.sum() - 1) * np.array([np.cos(direction), np.sin(direction)])
    tolerance = 0.003 if method == "lnorm" else 0.0005  # the L norm moves from taxel to taxel
    np.testing.assert_allclose(way, true, atol=tolerance)


@pytest.mark.parametrize("method", ["convolution", "principal_axis"])
def test_a_turned_pad_turns_the_answer(method: str) -> None:
    turn = 0.7
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    straight, turned = hexagonal(4, 0.004), hexagonal(4, 0.004) @ rotation.T
    pressure = sliding(table_sensor(straight), 0.2)
    one, other = (slips(method, table_sensor(places), pressure) for places in (straight, turned))
    np.testing.assert_allclose(one.pose[..., :2] @ rotation.T, other.pose[..., :2], atol=1e-12)


@paper_or_moments
def test_the_order_of_a_table_does_not_matter(method: str) -> None:
    places = hexagonal(4, 0.004)
    shuffled = np.random.default_rng(4).permutation(len(places))
    pressure = sliding(table_sensor(places), 0.2)
    one = slips(method, table_sensor(places), pressure)
    other = slips(method, table_sensor(places[shuffled]), pressure[:, shuffled])
    np.testing.assert_allclose(one.pose, other.pose, atol=1e-12)
    np.testing.assert_array_equal(one.border, other.border)


@pytest.mark.parametrize("method", METHODS)
def test_on_a_curved_pad_motion_is_that_over_the_skin(method: str) -> None:
    flat, table = arched(9, 13, radius_m=0.02)
    pressure = sliding(table_sensor(flat), 0.4, radius_m=0.006)
    one, other = slips(method, table_sensor(flat), pressure), slips(method, table_sensor(table), pressure)
    np.testing.assert_allclose(one.pose, other.pose, atol=1e-7)


@every_method
def test_a_stroke_over_a_built_in_table_runs_through_the_pipeline(method: str) -> None:
    stroke = Scenario(
        sensor="barretthand-bh280-96",
        pad="finger2",
        contact=Contact("elongated", radius_m=0.004),
        motion=Motion(speed_m_s=0.01, direction_rad=0.0, travel_m=0.03, strokes=1),
        sensing=replace(Sensing(), noise_pa=100.0),
    )
    recording = simulate(stroke)
    result = estimate(recording, method)
    pad = result.pads.index("finger2")
    touched = result.slips.contact[:, pad]
    assert touched.sum() > 10
    moved = np.nansum(result.slips.displacement[:, pad, 0])
    if method == "sum":
        assert np.isnan(result.slips.pose).all()
    else:
        assert 0.01 < moved < 0.04
