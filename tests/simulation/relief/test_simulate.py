from __future__ import annotations

from dataclasses import replace
from functools import cache
from time import process_time
from typing import Any, get_args

import msgspec
import numpy as np
import pytest

from costly import mostly_long
from taxelflow.errors import NameUnknown
from taxelflow.messages import Floats
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.relief import simulate
from taxelflow.simulation.relief.cases import EFFECTS, PLACES, Moved, case, sensor_at
from taxelflow.simulation.relief.course import follow
from taxelflow.simulation.relief.parameters import Course, Object, Pressing, SensorFaults, Shape, Skin
from taxelflow.simulation.relief.simulate import simulate_relief

GRID = load_sensor("grid:12x12@2mm,kPa")
QUIET = SensorFaults(noise_pa=0.0, bits=0)
HELD = Course(travel_m=0.0, turn_rad=0.0, idle_scans=0, pressing_scans=0, rest_scans=0, moving_scans=2)


BRIEF = {"rest_scans": 2, "moving_scans": 6}
PLACE = PLACES["palm"]


@cache
def read_with(effect: str) -> Floats:
    """(scans, taxels) of a bar on the palm with an effect, in a course of fewer scans."""
    pressing = case("bar", "palm", effect)
    course = replace(pressing.course, **BRIEF)
    values: Floats = simulate_relief(replace(pressing, course=course), sensor_at(PLACE), PLACE.pad).load().values
    return values


def scan(shape: Shape, x_m: float, y_m: float, theta: float, **changes: Any) -> Floats:
    """One noiseless scan (12, 12) in kPa of an object at a pose, row 0 on top."""
    course = replace(HELD, middle_m=(x_m, y_m), angle_rad=theta)
    thing = Object(shape=shape, size_m=0.012)
    pressing = Pressing(object=thing, course=course, faults=QUIET, force_n=4.0, **changes)
    values: Floats = simulate_relief(pressing, GRID, "grid").load().values[0].reshape(12, 12)
    return values


@pytest.mark.parametrize("shape", mostly_long(["nut", "key", "tripod"], "key"))
def test_a_shift_by_a_pitch_shifts_the_scan_by_a_taxel(shape: Shape) -> None:
    here, there = scan(shape, -1e-3, 1e-3, 0.3), scan(shape, 1e-3, 1e-3, 0.3)
    assert there[:, 1:] == pytest.approx(here[:, :-1], abs=1e-3 * here.max())
    assert scan(shape, -1e-3, 3e-3, 0.3)[:-1] == pytest.approx(here[1:], abs=1e-3 * here.max())


@pytest.mark.parametrize("shape", mostly_long(["bolt", "letters"], "bolt"))
def test_a_quarter_turn_of_the_object_turns_the_scan(shape: Shape) -> None:
    here = scan(shape, 2e-3, 1e-3, 0.2)
    assert scan(shape, -1e-3, 2e-3, 0.2 + np.pi / 2) == pytest.approx(np.rot90(here), abs=2e-3 * here.max())


def test_the_pressure_s_centre_is_the_load_point_of_an_object_free_to_tilt() -> None:
    here = scan("key", 1e-3, -2e-3, 0.7)
    x_m, y_m = GRID.layout.x_m.reshape(12, 12), GRID.layout.y_m.reshape(12, 12)
    assert [(here * x_m).sum() / here.sum(), (here * y_m).sum() / here.sum()] == pytest.approx([1e-3, -2e-3], abs=2e-4)


def test_the_sensor_carries_the_force() -> None:
    full = scan("dome", 0.3e-3, 0.0, 0.0, skin=Skin(active_share=1.0))
    assert 1e3 * full.sum() * 4e-6 == pytest.approx(4.0, rel=1e-3)


def test_the_nominal_force_is_the_one_that_presses_the_peak_on_a_taxel() -> None:
    peak_pa = 90e3
    bare = Pressing(object=Object(shape="dome", size_m=0.008), course=HELD, faults=QUIET, peak_pa=peak_pa)
    values = simulate_relief(bare, load_sensor("grid:5x5@2mm,kPa"), "grid").load().values
    assert values.max() == pytest.approx(1e-3 * peak_pa, rel=1e-4)


@pytest.mark.parametrize(
    ("unit", "declared", "bits", "full_scale"),
    [("kPa", None, 12, 140.0), ("count", 1000.0, 8, 1000.0), ("count", None, 8, 255.0), ("count", None, 0, 4095.0)],
)
def test_readings_end_at_the_full_scale_and_counts_of_a_converter_are_whole(
    unit: str, declared: float | None, bits: int, full_scale: float
) -> None:
    sensor = msgspec.structs.replace(load_sensor(f"grid:6x6@2mm,{unit}"), full_scale=declared)
    faults = replace(QUIET, bits=bits, full_scale_pa=140e3)
    hard = Pressing(object=Object(shape="dome", size_m=0.008), course=HELD, faults=faults, force_n=12.0)
    values = simulate_relief(hard, sensor, "grid").load().values
    assert values.max() == pytest.approx(full_scale)
    assert (values == np.round(values)).all() == (unit == "count" and bits > 0)


def test_points_left_out_at_first_are_computed_where_an_object_sinks_in_deep(monkeypatch: pytest.MonkeyPatch) -> None:
    soft = Skin(stiffness_pa_m=3e6)
    here = scan("dome", 1e-3, -1e-3, 0.0, skin=soft)
    monkeypatch.setattr(simulate, "_SEARCH", replace(simulate._SEARCH, gap=1e9))
    np.testing.assert_allclose(here, scan("dome", 1e-3, -1e-3, 0.0, skin=soft), atol=1e-6)


def test_an_object_that_turns_on_the_spot_slips() -> None:
    course = replace(HELD, turn_rad=0.3, rest_scans=3, moving_scans=4)
    truth = simulate_relief(Pressing(course=course, faults=QUIET, force_n=4.0), GRID, "grid").known_truth
    assert truth.slipping is not None
    turned = truth.pose[:, 2] - truth.pose[0, 2]
    assert turned[-1] == pytest.approx(0.3)
    assert truth.slipping.tolist() == ((turned > 0) & (turned < 0.299)).tolist()


def test_friction_shifts_the_pressure_ahead_of_a_sliding_object_and_not_of_one_at_rest() -> None:
    course = Course(
        travel_m=2e-3, direction_rad=np.pi / 2, idle_scans=0, pressing_scans=0, rest_scans=3, moving_scans=6
    )
    thing = Object(shape="nut", size_m=0.012, lever_m=4e-4)
    recording = simulate_relief(Pressing(object=thing, course=course, faults=QUIET, force_n=4.0), GRID, "grid")
    values, truth = recording.load().values, recording.known_truth
    assert truth.slipping is not None
    ahead = values @ GRID.layout.y_m / values.sum(axis=1) - truth.pose[:, 1]
    assert ahead[truth.slipping] == pytest.approx(4e-4, abs=1.5e-4)
    assert ahead[~truth.slipping] == pytest.approx(0.0, abs=1.5e-4)


def test_a_course_is_idle_then_pressed_then_rests_then_moves() -> None:
    course = Course(travel_m=4e-3, direction_rad=0.0, turn_rad=0.4, idle_scans=5, pressing_scans=4, rest_scans=3)
    path = follow(course, 50.0, np.arange(course.scans) / 50.0)
    assert path.load[:10] == pytest.approx([0, 0, 0, 0, 0, 0, 0.25, 0.5, 0.75, 1.0])
    assert (path.pose[:13] == path.pose[0]).all()
    assert path.pose[-1] - path.pose[0] == pytest.approx([4e-3, 0.0, 0.4])
    assert np.ptp(np.diff(path.pose[13:119], axis=0), axis=0) == pytest.approx(0.0, abs=1e-12)
    assert path.slides.sum() == path.turns.sum() == 107


def test_the_load_changes_as_asked_for_and_wanders_only_while_the_object_moves() -> None:
    course = Course(idle_scans=0, pressing_scans=0, load="cycles", multiples=(0.5, 2.0), wander_m=1e-3)
    path = follow(course, 50.0, np.arange(course.scans) / 50.0)
    assert [path.load.min(), path.load.max()] == pytest.approx([0.5, 2.0], abs=0.01)
    assert (path.lever_m[:12] == 0).all()
    assert 5e-4 < np.abs(path.lever_m).max() <= 1e-3
    ramp = follow(replace(course, load="ramp"), 50.0, np.arange(course.scans) / 50.0).load
    assert [ramp[0], ramp[-1]] == pytest.approx([0.5, 2.0], abs=0.02)


@pytest.mark.long
def test_a_recording_that_starts_loaded_has_no_idle_scan() -> None:
    place = PLACES["grid"]
    values = simulate_relief(case("nut", "grid", "loaded"), sensor_at(place), place.pad).load().values
    assert values.sum(axis=1).min() > 0.8 * values.sum(axis=1).max()


def test_rows_that_are_read_later_sample_the_object_later() -> None:
    course = replace(HELD, travel_m=6e-3, direction_rad=0.0, moving_scans=6)
    pressing = Pressing(object=Object(shape="bar", size_m=0.012), course=course, faults=QUIET, force_n=3.0)
    at_once = simulate_relief(pressing, GRID, "grid")
    rolling = simulate_relief(replace(pressing, faults=replace(QUIET, scan_share=1.0)), GRID, "grid")
    assert rolling.sensor.delay_s[0] == 0
    assert rolling.sensor.delay_s[-1] == pytest.approx(4 / 5 / 50.0)
    top, bottom = (recording.load().values.reshape(-1, 12, 12) for recording in (at_once, rolling))
    assert np.array_equal(top[:, :2], bottom[:, :2])
    assert np.abs(top[:, 7] - bottom[:, 7]).max() > 1.0
    now, later = (values[1:5, 7] @ np.arange(12) / values[1:5, 7].sum(axis=1) for values in (top, bottom))
    assert (later > now).all()  # it moves to the right


@pytest.mark.parametrize("place", mostly_long(PLACES, "palm"))
def test_every_layout_reads_a_moving_object_that_the_pipeline_finds(place: str) -> None:
    at = PLACES[place]
    pressing = case("nut", place, "all")
    course = replace(pressing.course, moving_scans=24)
    recording = simulate_relief(replace(pressing, course=course), sensor_at(at), at.pad)
    layout, values = recording.layout, recording.load().values
    own = layout.of_pad(layout.pads.index(at.pad))
    assert (np.delete(values, np.arange(own.start, own.stop), axis=1) == 0).all()
    if recording.sensor.unit == "count":
        assert np.array_equal(values, np.round(values))
    scans = api.conditioned(recording)
    contact = scans.contact[:, layout.pads.index(at.pad)]
    assert not contact[:10].any()
    assert contact[30:].mean() > 0.95


@pytest.mark.parametrize(
    "effect",
    mostly_long(list(EFFECTS)[1:], "cover", "gains", "hysteresis", "noise", "dead", "load"),
)
def test_every_effect_changes_the_readings(effect: str) -> None:
    plain, changed = read_with("none"), read_with(effect)
    assert plain.shape != changed.shape or not np.array_equal(plain, changed)


@pytest.mark.long
def test_the_same_seed_makes_the_same_recording_and_another_one_another() -> None:
    place = PLACES["hex"]
    pressings = (case("ring", "hex", "all", seed=seed) for seed in (3, 3, 4))
    brief = (replace(one, course=replace(one.course, **BRIEF)) for one in pressings)
    first, again, other = (simulate_relief(one, sensor_at(place), place.pad).load().values for one in brief)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("moved", get_args(Moved))
def test_objects_move_as_asked_for(moved: Moved) -> None:
    course = case("nut", "grid", moved=moved).course
    assert (course.travel_m > 0) == (moved in ("slide", "slide-turn"))
    assert (course.turn_rad != 0) == (moved in ("turn", "slide-turn"))


def test_unknown_names_are_refused() -> None:
    with pytest.raises(NameUnknown, match="layout"):
        case("nut", "foot")
    with pytest.raises(NameUnknown, match="effect"):
        case("nut", "grid", "rain")
    with pytest.raises(NameUnknown, match="pad"):
        simulate_relief(Pressing(), GRID, "palm")


@pytest.mark.long
def test_a_recording_of_150_scans_takes_about_a_second() -> None:
    place = PLACES["grid"]
    begun = process_time()
    assert len(simulate_relief(case("nut", "grid"), sensor_at(place), place.pad).load()) == 150
    assert process_time() - begun < 5  # 0.3 s on an idle core
