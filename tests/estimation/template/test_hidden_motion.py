"""Objects that reach across the pad: a motion that no reading shows is never `ok`, whatever slopes a map has."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from costly import mostly_long
from synthetic import grid_sensor, recorded
from taxelflow.estimation.base import Mode
from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.solution import Hidden
from taxelflow.messages import OK, Floats
from taxelflow.pipeline import api

RATE_HZ, PITCH_M, REST = 25.0, 0.003, 20
PATH_M = np.concatenate([np.zeros(20), np.linspace(0.0, 0.008, 40), np.full(20, 0.008)])
ANGLE = 0.6
"""Of a rod, in rad."""
ways = pytest.mark.parametrize(
    "way", mostly_long([ANGLE, ANGLE + 1.2, None], ANGLE), ids=["along", "obliquely", "rests"]
)


def pressed(shape: str, x_m: Floats, y_m: Floats) -> Floats:
    """Pressure (..., taxels) at places in the object's frame, as a share of the largest."""
    along, across = np.cos(ANGLE) * x_m + np.sin(ANGLE) * y_m, np.cos(ANGLE) * y_m - np.sin(ANGLE) * x_m
    rod: Floats = np.exp(-0.5 * (across / (1.2 * PITCH_M)) ** 2)
    if shape == "rod":
        return rod
    if shape == "short rod":
        return rod * np.exp(-0.5 * (along / (1.5 * PITCH_M)) ** 2)
    if shape == "smooth plate":
        return np.ones_like(x_m)
    if shape == "wide dome":
        dome: Floats = np.maximum(1.0 - (x_m**2 + y_m**2) / 0.02**2, 0.0)
        return dome
    waves = np.sin(x_m / 0.0021 + 0.4) + np.sin(y_m / 0.0026 + 1.1) + np.sin((x_m + y_m) / 0.0037)
    plate: Floats = 0.6 + (0.008 if shape == "faint plate" else 0.12) * waves
    return plate


@cache
def ok_share(shape: str, way: float | None, mode: Mode, scatter: float = 0.03, taxels: int = 8) -> tuple[float, float]:
    """Share of the poses in contact that are `ok`, and of these that are wrong: of an object at rest or moved in a
    direction, rad. scatter: of the gains. taxels: on each side of the pad.
    """
    sensor, random = (
        grid_sensor(taxels, taxels, pitch_m=(PITCH_M, PITCH_M), unseen_error=0.05),
        np.random.default_rng(2),
    )
    layout = sensor.layout
    moved = np.zeros((2, len(PATH_M))) if way is None else PATH_M * np.array([[np.cos(way)], [np.sin(way)]])
    at = pressed(shape, layout.x_m - moved[0][:, np.newaxis], layout.y_m - moved[1][:, np.newaxis])
    loaded = 50e3 * at * (1.0 + scatter * random.standard_normal(taxels**2))
    values = np.concatenate([np.zeros((REST, taxels**2)), loaded])
    values += 100.0 * random.standard_normal(values.shape)
    result = api.estimate(recorded(values, sensor, np.arange(len(values)) / RATE_HZ), "template", mode=mode)
    slips = result.slips
    used = slips.contact[:, 0] & (slips.quality[:, 0] == OK)
    true = np.concatenate([np.zeros((REST, 2)), moved.T])[used]
    error = slips.pose[used, 0, :2] - true
    error -= np.median(error, axis=0) if len(error) else 0.0
    deviation = np.sqrt(np.diagonal(slips.covariance[used, 0, :2, :2], axis1=1, axis2=2))
    wrong = np.any((np.abs(error) > 3 * deviation) & (np.abs(error) > 3e-4), axis=1)
    return float(used.sum() / len(PATH_M)), float(wrong.mean()) if len(wrong) else 0.0


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("shape", ["rod", "smooth plate"])
@ways
def test_a_motion_that_no_reading_shows_is_never_ok(shape: str, way: float | None, mode: Mode) -> None:
    assert ok_share(shape, way, mode) == (0.0, 0.0)


@pytest.mark.parametrize("mode", ["batch", "stream"])
@ways
def test_gains_that_scatter_by_twice_the_declared_error_do_not_show_it(way: float | None, mode: Mode) -> None:
    assert ok_share("smooth plate", way, mode, 0.1) == (0.0, 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_rod_that_slides_across_itself_may_have_rested_along_itself(seed: int) -> None:
    hidden = hidden_of("rod", ANGLE + 0.5 * np.pi, seed)
    assert abs(hidden.direction @ (np.cos(ANGLE), np.sin(ANGLE))) > 0.98
    np.testing.assert_array_equal(hidden.at_rest, hidden.direction)


def test_where_all_motion_is_shown_there_is_no_such_direction() -> None:
    assert not hidden_of("short rod", ANGLE, 0)


def hidden_of(shape: str, way: float, seed: int) -> Hidden:
    """Of an object that moves in a direction, rad."""
    layout = grid_sensor(8, 8, pitch_m=(PITCH_M, PITCH_M), unseen_error=0.05).layout
    random = np.random.default_rng(seed)
    x_m, y_m = 0.75 * PATH_M * np.array([[np.cos(way)], [np.sin(way)]])
    at = pressed(shape, layout.x_m - x_m[:, np.newaxis], layout.y_m - y_m[:, np.newaxis])
    readings = 50e3 * at * (1.0 + 0.03 * random.standard_normal(64)) + 100.0 * random.standard_normal(at.shape)
    places = np.stack([layout.x_m, layout.y_m]) / PITCH_M
    noise, limits = np.full(readings.shape, 100.0**2), (np.full(64, np.inf), np.zeros(64))
    return solve_contact(Scanned.of(np.arange(len(at)) / RATE_HZ, places, readings, noise, *limits, 0.05)).hidden


@pytest.mark.long
@pytest.mark.parametrize("taxels", [12, 24])
@pytest.mark.parametrize("way", [ANGLE, ANGLE + 1.2], ids=["along", "obliquely"])
def test_such_gains_are_not_the_texture_of_a_plate_on_larger_pads(way: float, taxels: int) -> None:
    assert ok_share("faint plate", way, "batch", 0.1, taxels) == (0.0, 0.0)


@pytest.mark.parametrize("way", mostly_long([ANGLE, ANGLE + 1.2], ANGLE + 1.2), ids=["along", "obliquely"])
def test_of_a_dome_wider_than_the_pad_such_gains_do_not_show_how_far_it_moved(way: float) -> None:
    assert ok_share("wide dome", way, "batch", 0.1)[1] == 0.0


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
@pytest.mark.parametrize("way", mostly_long([ANGLE, ANGLE + 1.2], ANGLE), ids=["along", "obliquely"])
def test_an_end_shows_the_motion_of_a_rod(way: float, mode: Mode) -> None:
    ok, wrong = ok_share("short rod", way, mode)
    assert ok > 0.6
    assert wrong == 0.0


@pytest.mark.long
def test_texture_shows_the_motion_of_a_plate_that_covers_the_pad() -> None:
    ok, wrong = ok_share("textured plate", ANGLE, "batch")
    assert ok > 0.5
    assert wrong < 0.02
