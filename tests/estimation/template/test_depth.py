"""Contacts that are pressed in more or less."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from taxelflow.estimation.template.depth import pressed, spread_of, take_depth, with_depth
from taxelflow.estimation.template.hypotheses import covering
from taxelflow.estimation.template.map import fill
from taxelflow.estimation.template.normal_equations import Normal, assemble
from taxelflow.estimation.template.observations import Scanned
from taxelflow.messages import Floats
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.sensor import Sensor
from taxelflow.simulation.relief.parameters import Course, Object, Pressing, SensorFaults, Skin
from taxelflow.simulation.relief.simulate import simulate_relief

LEVEL = 60e3


def test_a_depth_adds_one_pressure_where_the_object_touches_and_none_where_it_does_not() -> None:
    assert pressed(0.5 * LEVEL, LEVEL)[0] == pytest.approx(LEVEL, rel=1e-3)
    assert pressed(0.0, LEVEL) == pressed(-1e3, LEVEL) == (0.0, 0.0)
    assert pressed(0.5 * LEVEL, 0.0) == (0.0, 0.0)


@pytest.mark.parametrize("q", [1e2, 3e3, 2e4])
def test_its_slope_is_that_of_what_it_adds(q: float) -> None:
    rise = (pressed(q + 1.0, LEVEL)[0] - pressed(q - 1.0, LEVEL)[0]) / 2.0
    assert pressed(q, LEVEL)[1] == pytest.approx(rise, rel=1e-5)


@pytest.mark.parametrize("spread", [0.0, 0.05])
def test_the_spread_of_the_depths_is_what_their_noise_does_not_explain(spread: float) -> None:
    random = np.random.default_rng(1)
    std = random.uniform(0.01, 0.02, 2000)
    depth = spread * random.normal(size=2000) + std * random.normal(size=2000)
    assert spread_of(depth, std**2) == pytest.approx(max(spread, 0.002), abs=0.004)


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
    readings, free = scanned.with_error(0.01), np.ones(5)
    own = Normal.empty(1, len(scanned.places[0]), pattern.coefficients.size)

    def model(state: Floats) -> Floats:
        assemble(pattern.surface, readings, state, free, LEVEL, own)
        expected: Floats = own.model[0].copy()
        return expected

    model(states)
    slope, seen = own.slope[0].copy(), own.w[0] > 0
    for part in range(5):
        step = 1e-5 * np.eye(5)[part]
        rise = (model(states + step) - model(states - step)) / 2e-5
        assert slope[seen, part] == pytest.approx(rise[seen], rel=1e-3, abs=20.0)


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
