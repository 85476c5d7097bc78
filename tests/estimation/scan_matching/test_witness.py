"""The centre of pressure as a witness of a sum of steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiled import compiled
from taxelflow.estimation.scan_matching.track import Scan, Taxels, Track
from taxelflow.estimation.scan_matching.witness import contradicts
from taxelflow.evaluation.robustness_rows import without_frame
from taxelflow.messages import OK, Floats
from taxelflow.numerics.records import records
from taxelflow.pipeline import api
from taxelflow.simulation.relief.cases import PLACES, case, sensor_at
from taxelflow.simulation.relief.course import follow
from taxelflow.simulation.relief.simulate import simulate_relief

AXIS = np.arange(9.0) - 4.0
PLACES_ON_PAD = np.stack([part.ravel() for part in np.meshgrid(AXIS, AXIS)])
found: Any = compiled(contradicts)


def scan(x: float, radius: float = 2.3) -> Scan:
    reading: Floats = 1000.0 * (np.hypot(PLACES_ON_PAD[0] - x, PLACES_ON_PAD[1]) < radius)
    return Scan(0, reading, np.ones_like(reading), np.full_like(reading, np.inf))


def taxels(tilt: float = 0.05) -> Taxels:
    return Taxels(0, 0, PLACES_ON_PAD, np.ones(81), np.ones(3), tilt)


def track(x: float = 0.0) -> Any:
    own = records(Track, 1)
    own["pose"][0, 0] = x
    own["covariance"][0] = 1e-4 * np.eye(3)
    return own[0]


def test_a_pose_that_stays_where_its_load_does_not_is_contradicted() -> None:
    own = track()
    assert not found(scan(0.0), taxels(), own)
    own["pose"][0] = 1.0
    assert not found(scan(1.0), taxels(), own)
    assert found(scan(-1.0), taxels(), own)
    own["covariance"][0, 0] = 4.0
    assert not found(scan(-1.0), taxels(), own)


def test_a_distance_in_the_object_turns_with_it() -> None:
    own = track(x=3.0)
    assert not found(scan(0.0), taxels(), own)
    own["pose"][:] = 0.0, 3.0, np.pi / 2
    assert not found(scan(0.0), taxels(), own)
    own["pose"][:] = 3.0, 0.0, np.pi / 2
    assert found(scan(0.0), taxels(), own)


def test_a_contact_that_has_formed_since_gives_the_distance_again() -> None:
    own = track()
    assert not found(scan(2.0, radius=0.5), taxels(), own)
    assert not found(scan(0.0), taxels(), own)
    own["pose"][0] = 2.0
    assert found(scan(0.0), taxels(), own)


def test_a_contact_that_grows_after_it_was_contradicted_gives_no_other_distance() -> None:
    own = track()
    assert not found(scan(0.0, radius=2.3), taxels(), own)
    own["pose"][0] = 2.0
    assert found(scan(0.0, radius=2.9), taxels(), own)
    assert found(scan(0.0, radius=3.2), taxels(), own)  # half as many taxels more than at first
    own["pose"][0] = 0.0
    assert not found(scan(0.0, radius=3.2), taxels(), own)


def test_a_sensor_without_an_unseen_error_contradicts_nothing() -> None:
    own = track()
    assert not found(scan(0.0), taxels(0.0), own)
    own["pose"][0] = 3.0
    assert not found(scan(0.0), taxels(0.0), own)


def test_registration_that_lost_a_turn_is_not_ok() -> None:
    """A nut on dense hexagons, whose turn comes out too small: 47 of 137 `ok` poses were wrong."""
    place, pressing = PLACES["hex"], case("nut", "hex", "all", "slide-turn", 302)
    recording = simulate_relief(pressing, sensor_at(place), place.pad)
    result = api.estimate(recording, "registration")
    slips, pad = result.slips, result.pads.index(place.pad)
    truth = follow(pressing.course, pressing.rate_hz, slips.t_s).pose
    ok = slips.quality[:, pad] == OK
    pose = np.nan_to_num(slips.pose[ok, pad])
    off_m = np.hypot(*without_frame(pose, truth[ok], np.ones((int(ok.sum()), 3)))[:, :2].T)
    assert ok.sum() > 20
    assert off_m.max() < 1e-3
