from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from costly import mostly_long
from synthetic import grid_sensor, recorded
from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.dead_taxels import silent_taxels, working
from taxelflow.estimation.template.observations import Scanned
from taxelflow.pipeline import api
from taxelflow.simulation.relief.cases import PLACES, case, sensor_at
from taxelflow.simulation.relief.simulate import simulate_relief

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.relief.parameters import Shape

COLUMNS, ROWS, NOISE = 9, 5, 0.005
TAXELS = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))]).astype(np.float64)
DENSE = np.linspace(-0.4, 0.4, 5)

OBJECTS: dict[str, Callable[[Floats, Floats], Bools]] = {
    "disc": lambda u, v: np.hypot(u, v) < 1.6,
    "ring": lambda u, v: np.abs(np.hypot(u, v) - 1.5) < 0.6,
    "wide ring": lambda u, v: np.abs(np.hypot(u, v) - 2.0) < 0.6,
    "rails": lambda u, v: (np.abs(u) < 2.0) & (np.abs(np.abs(v) - 1.0) < 0.5),
    "long rails": lambda u, v: (np.abs(u) < 6.0) & (np.abs(np.abs(v) - 1.0) < 0.5),
    "feet": lambda u, v: (np.abs(np.abs(u) - 1.5) < 0.5) & (np.abs(np.abs(v) - 1.5) < 0.5),
    "corner": lambda u, v: (np.maximum(np.abs(u), np.abs(v)) < 2.0) & ((u < -0.5) | (v < -0.5)),
    "slot": lambda u, v: (np.maximum(np.abs(u), np.abs(v)) < 2.0) & ~((np.abs(v) < 0.5) & (u > -1.0)),
}


def slid(kind: str, way: Floats, angle: float = 0.0, dead: tuple[int, ...] = ()) -> Scanned:
    """Scans of an object whose middle goes along way (scans, 2), in pitches; a taxel reads the mean over itself."""
    du, dv = (axis.ravel() for axis in np.meshgrid(DENSE, DENSE))
    x, y = (TAXELS[axis][:, np.newaxis] + part for axis, part in enumerate((du, dv)))
    cos, sin = np.cos(angle), np.sin(angle)
    readings = np.empty((len(way), TAXELS.shape[1]))
    for k, (left, low) in enumerate(way):
        u, v = cos * (x - left) + sin * (y - low), cos * (y - low) - sin * (x - left)
        readings[k] = OBJECTS[kind](u, v).mean(axis=1)
    readings[:, list(dead)] = 0.0
    readings += np.random.default_rng(0).normal(0.0, NOISE, readings.shape)
    taxels = TAXELS.shape[1]
    variance = np.full(readings.shape, NOISE**2)
    return Scanned.of(np.arange(len(way)) / 10, TAXELS, readings, variance, np.full(taxels, np.inf), np.zeros(taxels))


def across(low: float, scans: int = 25) -> Floats:
    return np.stack([np.linspace(-1.0, COLUMNS, scans), np.full(scans, low)], axis=1)


@pytest.mark.parametrize("scans", [12, 25])
@pytest.mark.parametrize("low", [1.6, 2.0, 2.4])
@pytest.mark.parametrize("dead", [(21, 22), (22, 23), (13, 22), (22, 31), (22,), (21, 23), (13, 23)])
def test_what_does_not_answer_under_a_sliding_object_is_found(dead: tuple[int, ...], low: float, scans: int) -> None:
    assert silent_taxels(slid("disc", across(low, scans), dead=dead)).tolist() == list(dead)


@pytest.mark.parametrize(
    ("middle", "dead", "found"),
    [
        ((4.0, 2.0), 22, [22]),
        ((4.0, 0.3), 4, [4]),
        ((0.5, 0.5), 0, []),
        ((COLUMNS - 1.5, ROWS - 1.5), 44, []),
    ],
    ids=["inside", "edge", "corner", "other corner"],
)
def test_under_an_object_at_rest_a_silent_corner_is_not_dead(
    middle: tuple[float, float], dead: int, found: list[int]
) -> None:
    """All neighbours of the silent taxel are loaded; at a corner the object may end."""
    assert silent_taxels(slid("disc", np.tile(middle, (10, 1)), dead=(dead,))).tolist() == found


@example("disc", 0.0, (1.0, 1.0), (1.0, 2.0))  # passes a corner that it does not touch
@example("rails", 4.5198, (3.0935, 2.9312), (0.6837, 1.96))  # a taxel reads 18 standard deviations, and no more
@given(
    st.sampled_from(["disc", "ring", "wide ring", "rails"]),
    st.floats(0.0, 2 * np.pi),
    st.tuples(st.floats(1.0, COLUMNS - 2.0), st.floats(1.0, ROWS - 2.0)),
    st.tuples(st.floats(-8.0, 8.0), st.floats(-3.0, 3.0)),
)
def test_gaps_of_an_object_that_slides_are_no_dead_taxels(
    kind: str, angle: float, start: tuple[float, float], travel: tuple[float, float]
) -> None:
    """One that keeps its gap over a taxel, as rails that move along themselves do, looks as if the taxel were dead."""
    if np.hypot(*travel) > 1.5:  # at rest every gap looks the same
        scanned = slid(kind, start + np.linspace(0.0, 1.0, 20)[:, np.newaxis] * travel, angle)
        suspects = silent_taxels(scanned)
        assert len(suspects) <= (0 if kind in {"disc", "ring"} else 2)
        dead = solve_contact(scanned).dead if len(suspects) else suspects
        assert (scanned.readings[:, dead] < 10 * NOISE).all()


@pytest.mark.parametrize(
    ("kind", "start", "travel", "angle"),
    mostly_long(
        [
            ("wide ring", (6.757, 2.607), (-0.601, -1.414), 1.1968),
            ("wide ring", (5.94, 1.354), (-1.181, -0.948), 2.7518),
            ("rails", (6.136, 1.865), (-7.94, -1.726), 3.292),
            ("rails", (3.047, 2.524), (7.852, 1.019), 3.2591),
            ("rails", (2.5, 2.5), (0.0, 2.5), 5.0),
            ("rails", (3.0, 2.0), (-7.0, -2.5), 3.5),
            ("rails", (3.5, 2.0), (5.5, -1.5), 6.0),
        ],
        ("wide ring", (5.94, 1.354), (-1.181, -0.948), 2.7518),
        ("rails", (2.5, 2.5), (0.0, 2.5), 5.0),
    ),
)
def test_a_gap_that_a_smooth_pattern_half_fills_is_not_dead(
    kind: str, start: tuple[float, float], travel: tuple[float, float], angle: float
) -> None:
    """The pattern predicts a few percent of the largest reading in a gap, less than it errs elsewhere."""
    way = np.array(start) + np.linspace(0.0, 1.0, 20)[:, np.newaxis] * np.array(travel)
    assert solve_contact(slid(kind, way, angle)).dead.tolist() == []


@pytest.mark.parametrize(
    ("kind", "start", "travel", "angle"),
    mostly_long(
        [
            ("feet", (3.0, 2.0), (5.0, -1.43), 4.94),
            ("feet", (2.0, 2.5), (4.9, -1.0), 2.94),
            ("corner", (4.0, 2.0), (3.0, -0.24), 2.175),
            ("slot", (3.5, 2.2), (2.2, 0.0), 3.19),
        ],
        ("slot", (3.5, 2.2), (2.2, 0.0), 3.19),
    ),
)
def test_what_the_pattern_explains_is_a_gap_and_not_dead(
    kind: str, start: tuple[float, float], travel: tuple[float, float], angle: float
) -> None:
    way = np.array(start) + np.linspace(0.0, 1.0, 40)[:, np.newaxis] * np.array(travel)
    assert solve_contact(slid(kind, way, angle)).dead.tolist() == []


@pytest.mark.parametrize("dead", [(22,), (22, 23)])
def test_what_the_pattern_denies_is_dead(dead: tuple[int, ...]) -> None:
    assert solve_contact(slid("disc", across(2.0), dead=dead)).dead.tolist() == list(dead)


@pytest.mark.long
@pytest.mark.parametrize(("shape", "place", "dead"), [("coin", "sdh", 124), ("dome", "palm", 154)])
def test_a_dead_taxel_at_the_rim_of_a_contact_is_found(shape: Shape, place: str, dead: int) -> None:
    """Never more than two of its neighbours are loaded at once."""
    at = PLACES[place]
    recording = simulate_relief(case(shape, place, "all", seed=4), sensor_at(at), at.pad)
    notes = api.estimate(recording, "template").summary.notes
    assert any(f"do not answer to the pattern: taxels {dead} of {at.pad}" in note for note in notes)


@pytest.mark.long
@pytest.mark.parametrize(("shape", "place"), [("dome", "xela"), ("bolt", "xela")])
def test_a_dead_taxel_is_found_where_its_pattern_explains_it_too(shape: Shape, place: str) -> None:
    """With and without it, such a fit leaves the same error; without it, the scans are likelier."""
    at = PLACES[place]
    recording = simulate_relief(case(shape, place, "all", seed=61), sensor_at(at), at.pad)
    notes = api.estimate(recording, "template").summary.notes
    assert any(f"do not answer to the pattern: taxels 10 of {at.pad}" in note for note in notes)


@given(st.sampled_from(["feet", "rails", "corner", "slot", "wide ring"]), st.floats(0.0, 2 * np.pi))
def test_two_silent_neighbours_under_an_object_at_rest_may_be_its_gap(kind: str, angle: float) -> None:
    still = np.tile([[COLUMNS / 2 - 0.5, ROWS / 2 - 0.5]], (20, 1))
    found = TAXELS[:, silent_taxels(slid(kind, still, angle))]
    apart = np.hypot(*(found[:, :, np.newaxis] - found[:, np.newaxis, :]))
    assert not (np.abs(apart - 1.0) < 0.1).any()


def test_a_taxel_that_answers_elsewhere_is_not_dead() -> None:
    """The hole of a ring comes over every taxel of its way, between scans in which it is loaded."""
    ring = slid("ring", across(2.0, 200))
    hole = ring.readings[:, 22] < 5 * NOISE
    assert (hole & (ring.readings[:, [13, 21, 23, 31]] > 0.5).all(axis=1)).any()
    assert silent_taxels(ring).tolist() == []


def test_a_taxel_that_clearly_reads_under_load_is_weak_and_not_dead() -> None:
    disc = slid("disc", across(2.0))
    disc.readings[:, 22] *= 0.35
    assert solve_contact(disc).dead.tolist() == []


@pytest.mark.parametrize("before", [True, False], ids=["known to work", "not touched before"])
def test_a_taxel_that_reads_in_another_contact_is_not_dead(before: bool) -> None:
    """A ring at rest keeps its hole over a taxel, as over a dead one."""
    ring = np.tile([[4.0, 2.0]], (20, 1))
    other, idle = slid("disc", across(2.0)).readings if before else slid("disc", ring[:1] + 100.0).readings, 10
    nothing = np.random.default_rng(1).normal(0.0, NOISE, (idle, TAXELS.shape[1]))
    values = np.concatenate([nothing, other, nothing, slid("ring", ring).readings, nothing])
    sensor = grid_sensor(ROWS, COLUMNS, pitch_m=(0.004, 0.004))
    notes = api.estimate(recorded(1e3 * values, sensor), "template").summary.notes
    assert any("do not answer to the pattern: taxels 22 of" in note for note in notes) is not before


def test_light_scans_and_noise_show_of_no_taxel_that_it_works() -> None:
    readings, noise = np.zeros((2, 4)), np.full(4, NOISE)
    readings[0] = 1.0, 0.11, 0.09, 9 * NOISE
    readings[1] = 0.19, 0.0, 0.0, 0.18
    assert working(readings, noise).tolist() == [True, True, False, False]
