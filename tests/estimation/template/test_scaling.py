"""Contacts that grow with their load while the object rests: on the whole pad, and where only a flank is read."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from rigged import rigged
from taxelflow.estimation.template.batch_session import _on_one_map
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.scaling import grown_starts, may_have_grown
from taxelflow.estimation.template.solution import Solved
from taxelflow.messages import OK
from taxelflow.pipeline import api
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Floats
    from taxelflow.pipeline.result import Result


def seen(mode: Mode = "batch", rate_hz: float = 20.0, after_s: float = 0.0, **changes: object) -> tuple[Floats, Floats]:
    """Places (scans, 2) of an object at a border, as they are seen and as they are, in mm, the mean taken off."""
    recording = simulate(rigged("hold-at-edge", sensing={"rate_hz": rate_hz}, **changes))
    slips, truth = api.estimate(recording, "template", mode=mode).slips, recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    known = np.isfinite(slips.pose[:, pad, 0]) & (slips.t_s > after_s)
    places = 1e3 * np.stack([slips.pose[known, pad, :2], truth.pose[known, :2]])
    found, true = places - places.mean(axis=1, keepdims=True)
    return found, true


@pytest.mark.long
def test_growth_at_a_border_is_no_motion() -> None:
    found, _ = seen(motion={"turn_s": 4.0}, load={"cycles": 2})
    assert np.ptp(found, axis=0).max() < 0.5  # taken for motion, it is 3.4 mm


@pytest.mark.long
def test_growth_of_which_half_is_in_view_is_no_motion() -> None:
    found, _ = seen(motion={"turn_s": 4.0, "middle_m": (0.032, 0.0)}, load={"cycles": 2}, seed=5)
    assert found.std(axis=0).max() < 0.5  # taken for motion, it is 3.0 mm


@pytest.mark.long
def test_growth_of_which_only_a_flank_is_in_view_is_no_motion() -> None:
    found, _ = seen(motion={"turn_s": 4.0, "middle_m": (0.034, 0.0)}, load={"cycles": 2}, seed=5)
    assert found.std(axis=0).max() < 0.5  # taken for motion, it is 2.9 mm


@pytest.mark.long
def test_an_object_that_slides_along_the_border_as_it_is_pressed_has_moved() -> None:
    slide = {"travel_m": 0.006, "speed_m_s": 0.002, "direction_rad": np.pi / 2, "rest_s": 1.0}
    found, true = seen(motion=slide, load={"cycles": 2})
    assert np.sqrt(np.mean((found - true)[:, 1] ** 2)) < 0.7  # the rigid model has no size; 3.4 mm is growth


@pytest.mark.long
def test_a_stream_learns_from_the_first_loads_how_a_contact_grows() -> None:
    found, _ = seen("stream", after_s=3.0, motion={"turn_s": 6.0}, load={"cycles": 3}, seed=7)
    assert found.std(axis=0).max() < 0.15  # taken for motion, it is 0.9 mm


@pytest.mark.long
def test_what_slides_in_a_stream_as_it_is_pressed_has_moved() -> None:
    slide = {"travel_m": 0.006, "speed_m_s": 0.001, "direction_rad": np.pi / 2, "rest_s": 1.0}
    found, true = seen("stream", 100.0, after_s=3.0, motion=slide, load={"cycles": 3})
    assert np.sqrt(np.mean((found - true)[:, 1] ** 2)) < 0.2


@pytest.mark.long
def test_a_load_that_changes_for_a_short_time_does_not_move_what_stays() -> None:
    recording = simulate(rigged("hold-pressed", motion={"turn_s": 4.0}, load={"cycles": 2}, sensing={"rate_hz": 25.0}))
    pose = 1e3 * api.estimate(recording, "template").slips.pose[:, 0, :2]
    assert np.nanstd(pose, axis=0).max() < 0.1  # with gains held at 1, it is 0.2 mm


@pytest.mark.long
def test_a_group_that_has_a_part_of_a_growing_contact_doubts_its_pose() -> None:
    recording = simulate(rigged("press", seed=2))
    recording = replace(recording, sensor=msgspec.structs.replace(recording.sensor, unseen_error=0.05))
    result = api.estimate(recording, "template")
    whole, _ = excursion(result, "palm")
    assert len(whole) > 200
    assert whole.max() < 1e-3
    away, deviations = excursion(result, "palm_left")
    wrong = np.count_nonzero((away > 3e-4) & (deviations > 3.0))
    assert wrong <= 0.1 * len(away)  # with the likeliest hypothesis alone, it is 0.8
    starts = [event for event in result.events if event.event == "slip_start"]
    assert not [event for event in starts if event.pad in ("palm_left", "palm_right") and event.quality == "ok"]


def excursion(result: Result, pad: str) -> tuple[Floats, Floats]:
    """Distances of `ok` poses from their median, m, and over their standard deviations."""
    slips, number = result.slips, result.sensor.layout.pads.index(pad)
    ok = (slips.quality[:, number] == OK) & slips.contact[:, number]
    if not ok.any():
        return np.zeros(0), np.zeros(0)
    away = slips.pose[ok, number, :2] - np.median(slips.pose[ok, number, :2], axis=0)
    deviation = np.sqrt(slips.covariance[ok, number][:, [0, 1], [0, 1]])
    return np.hypot(*away.T), (np.abs(away) / deviation).max(axis=1)


def scanned(load: Floats, x: float = 4.0, size: Floats | float = 1.0) -> Scanned:
    """Scans of a spot at x, of a size (scans,) in taxels, under a load (scans,)."""
    places = np.stack([one.ravel() for one in np.meshgrid(np.arange(8.0), np.arange(8.0))])
    square = (places[0] - x) ** 2 + (places[1] - 4) ** 2
    size = np.broadcast_to(size, load.shape)
    readings = load[:, np.newaxis] * np.exp(-0.5 * square / size[:, np.newaxis] ** 2)
    noise = np.full_like(readings, 1e-4)
    return Scanned.of(0.01 * np.arange(len(load)), places, readings, noise, np.full(64, np.inf), np.zeros(64))


def test_growth_is_possible_where_the_load_varies_and_the_place_goes_with_it_or_hardly_moves() -> None:
    load = 1.0 + 4.0 * np.sin(np.linspace(0.0, np.pi, 50)) ** 2
    states = np.zeros((50, 5))
    states[:, 3] = 1.0
    assert may_have_grown(scanned(load), states)
    assert not may_have_grown(scanned(np.ones(50)), states)
    states[:, 0] = 6.0 * load ** (1 / 3)
    assert may_have_grown(scanned(load), states)
    states[:, 0] = np.linspace(0.0, 8.0, 50)
    assert not may_have_grown(scanned(load), states)


def test_the_place_of_a_contact_that_grows_is_as_uncertain_as_its_size() -> None:
    load = 1.0 + 4.0 * np.sin(np.linspace(0.0, np.pi, 30)) ** 2
    scans = scanned(load, x=7.5, size=load ** (1 / 3))  # the border cuts it: a larger spot looks like a nearer one
    states = np.tile([7.5, 4.0, 0.0, 1.0, 0.0], (30, 1))
    grown = Solved(*grown_starts(scans, states, 0)[0], 0.01, 1.0, turns=False, grows=True)
    both = grown, replace(grown, grows=False)
    free, held = (_on_one_map(one, scans, 1.0, 0.05, whole_contact=True).covariance for one in both)
    assert np.median(free[:, 0, 0] / held[:, 0, 0]) > 1.1
