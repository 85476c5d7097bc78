"""Contacts that are pressed in more or less."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from taxelflow.estimation.template.depth import as_heights, as_pressure, take_depth, touch, with_depth
from taxelflow.estimation.template.map import covering, fill
from taxelflow.estimation.template.normal_equations import Normal, assemble
from taxelflow.estimation.template.observations import Scanned
from taxelflow.messages import Floats
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.relief.parameters import Course, Object, Pressing, SensorFaults, Skin
from taxelflow.simulation.relief.simulate import simulate_relief

LEVEL = 60e3


@pytest.mark.parametrize("height", [-5e4, -1e4, 0.0, 7e3, 3e4, 2e5])
@pytest.mark.parametrize("slopes", [(4e4, 1e4), (-2e4, 6e4), (0.0, -3e4), (0.0, 0.0)])
def test_a_taxel_reads_the_mean_of_what_touches(height: float, slopes: tuple[float, float]) -> None:
    side = (np.arange(400) + 0.5) / 400 - 0.5
    over = height + slopes[0] * side + slopes[1] * side[:, np.newaxis]
    read = touch(height, *slopes, LEVEL)
    assert read.mean == pytest.approx(np.maximum(over, 0.0).mean(), abs=2e-3 * LEVEL)
    assert read.share == pytest.approx((over > 0).mean(), abs=0.01 if height else 0.51)


def test_a_depth_adds_one_pressure_where_the_object_touches_and_none_where_it_does_not() -> None:
    sunk = [touch(height + 1e3, 1e4, 5e3, LEVEL).mean - touch(height, 1e4, 5e3, LEVEL).mean for height in (4e4, -4e4)]
    assert sunk == pytest.approx([1e3, 0.0])


@pytest.mark.parametrize("height", [-1e4, 2e3, 1.5e4])
@pytest.mark.parametrize("slopes", [(2e4, 1e4), (-1e4, 3e4), (3e4, -2e4)])
def test_what_a_taxel_reads_comes_with_its_derivatives(height: float, slopes: tuple[float, float]) -> None:
    at = np.array([height, *slopes])
    rise = [(touch(*(at + one), LEVEL).mean - touch(*(at - one), LEVEL).mean) / 2.0 for one in np.eye(3)]
    assert touch(*at, LEVEL)[1:] == pytest.approx(rise, rel=1e-4, abs=1e-6)


def test_heights_read_like_the_pressure_that_they_come_from() -> None:
    scanned, states, _ = linearised()
    states[:, 4] = 0.0
    pattern = covering(scanned, states)
    fill(pattern, scanned.with_error(0.01), states)
    heights = as_heights(pattern)
    assert heights.coefficients.min() < -0.1 * LEVEL
    inside = (slice(8, -8), slice(8, -8))
    back = as_pressure(heights).coefficients[inside]
    assert back == pytest.approx(np.maximum(pattern.coefficients[inside], 0.0), abs=0.08 * LEVEL)


def test_states_give_their_depth_back() -> None:
    states, depth = np.arange(10.0).reshape(2, 5), np.array([0.1, -0.2])
    states[:, 4] = 0.0
    found, own = np.empty((2, 5)), np.empty(2)
    take_depth(with_depth(states, depth), found, own)
    assert (found == states).all()
    assert (own == depth).all()


def linearised() -> tuple[Scanned, Floats, Normal]:
    """A scan of two bumps, a state of it with a depth, and the equations there."""
    axis = np.arange(8) - 3.5
    places = np.stack([part.ravel() for part in np.meshgrid(axis, axis)])
    bumps = np.exp(-0.3 * ((places[0] - 1.0) ** 2 + places[1] ** 2)) + 0.7 * np.exp(-0.5 * (places[0] + 2.0) ** 2)
    readings = LEVEL * bumps[np.newaxis]
    count = places.shape[1]
    scanned = Scanned.of(
        np.zeros(1), places, readings, np.full((1, count), 400.0**2), np.full(count, np.inf), np.zeros(count)
    )
    return scanned, np.array([[0.1, -0.2, 0.05, 1.1, 0.04]]), Normal.empty(1, count, 0)


def test_the_slopes_of_the_equations_are_those_of_the_model() -> None:
    scanned, states, _ = linearised()
    at = states.copy()
    at[:, 4] = 0.0
    pattern = covering(scanned, at)
    fill(pattern, scanned.with_error(0.01), at)
    pattern = as_heights(pattern)
    readings, free = scanned.with_error(0.01), np.ones(5)
    own = Normal.empty(1, len(scanned.places[0]), pattern.coefficients.size)

    def model(state: Floats) -> Floats:
        assemble(pattern.surface, readings, state, free, LEVEL, own)
        expected: Floats = own.model[0].copy()
        return expected

    model(states)
    seen = own.w[0] > 0
    slope = own.pull[: own.start[1]] / own.w[0, seen, np.newaxis]
    for part in range(5):
        step = 1e-5 * np.eye(5)[part]
        rise = (model(states + step) - model(states - step)) / 2e-5
        assert slope[:, part] == pytest.approx(rise[seen], rel=1e-3, abs=20.0)


def way_error(sensor: Sensor) -> float:
    """RMS error of places, m, a constant point of the body taken off, of a coarse cloth that slides all over a pad."""
    pressing = Pressing(
        object=Object(shape="cloth", size_m=0.08, seed=2, tilts=False),
        skin=Skin(),
        course=Course(travel_m=0.010, turn_rad=0.06),
        faults=SensorFaults(noise_pa=400.0, bits=0),
        rate_hz=100.0,
    )
    recording = simulate_relief(pressing, sensor, "finger2_mid")
    pose = api.estimate(recording, "template").slips.pose[36:128, sensor.layout.pads.index("finger2_mid")]
    true = recording.known_truth.pose[36:128]
    cos, sin = np.cos(true[:, 2]), np.sin(true[:, 2])
    arm = np.concatenate([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)])
    apart = (pose - true)[:, :2].T.ravel()
    return float(np.std(apart - arm @ np.linalg.lstsq(arm, apart)[0]))


@pytest.mark.long
def test_a_relief_that_sinks_in_as_it_slides_goes_as_far_as_it_goes() -> None:
    """Its force is constant: a gain alone stretches the way. A sensor whose faults are not known has the gain alone."""
    sensor = load_sensor("barretthand-162")
    exact = way_error(msgspec.structs.replace(sensor, unseen_error=0.0))
    faulty = way_error(msgspec.structs.replace(sensor, unseen_error=0.05))
    assert exact < 5e-5
    assert exact < 0.5 * faulty
