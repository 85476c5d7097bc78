"""An object on an elastic skin: what sinking, tilting and sliding leave of its pattern."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from elastic_skin import PLACES, pressed
from taxelflow.numerics.rest_or_slide import compare, overlap
from taxelflow.numerics.slid import Skin
from taxelflow.numerics.sunk_and_tilted import squares_at_rest

if TYPE_CHECKING:
    from taxelflow.messages import Floats

NOISE = 1e-3
SKIN = Skin.of(PLACES.T)


def left(after: Floats, moved: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    """Shares of a pattern that rest and a slide leave, beside the one at the origin."""
    found = compare(SKIN, pressed(), after, NOISE, np.array([*moved, 0.0]))
    norm = float(np.linalg.norm(after))
    return np.sqrt(found.rest) / norm, np.sqrt(found.slide) / norm


@pytest.mark.parametrize("change", [{"tilt": (0.05, 0.02)}, {"depth": 0.8}, {"depth": 1.3, "tilt": (-0.04, 0.03)}])
def test_an_object_that_sinks_and_tilts_is_explained_at_rest(change: dict[str, float]) -> None:
    rest, slide = left(pressed(**change))  # type: ignore[arg-type]
    assert rest < 0.05
    assert slide > 1.5 * rest


def test_an_object_that_sinks_goes_nowhere() -> None:
    found = compare(SKIN, pressed(), pressed(depth=0.8), NOISE, np.array([0.3, 0.0, 0.0]), sinks=True)
    assert np.hypot(found.x, found.y) < 0.1
    assert not found.moves(np.array([0.3, 0.0]))


def test_an_object_that_slides_moves() -> None:
    found = compare(SKIN, pressed(), pressed(x=0.7), NOISE, np.array([0.7, 0.0, 0.0]), sinks=True)
    assert found.moves(np.array([0.7, 0.0]))
    assert not found.moves(np.array([-0.7, 0.0]))


def test_load_and_tilt_in_proportion_to_pressure_are_rest_too() -> None:
    rest, _ = left(pressed() * (1.2 + 0.05 * PLACES[:, 0]))
    assert rest < 0.03


def test_an_object_that_slides_is_explained_as_a_slide() -> None:
    rest, slide = left(pressed(x=0.7, y=-0.3))
    assert rest > 2 * slide


def test_where_the_pose_has_gone_helps_where_a_texture_repeats() -> None:
    after = pressed(x=2.0)
    assert left(after, (2.0, 0.0))[1] <= left(after)[1]


def test_a_turn_is_a_slide() -> None:
    rest, slide = left(pressed(turn=0.25))
    assert rest > 1.5 * slide


def test_scale_changes_nothing() -> None:
    after, scale = pressed(x=0.5), 2.0**13  # which rounds nothing
    one = compare(SKIN, pressed(), after, NOISE, np.zeros(3))
    more = compare(SKIN, scale * pressed(), scale * after, scale * NOISE, np.zeros(3))
    squares = np.isin(one._fields, ["slide", "rest", "rest_of_all", "gain_errors", "pressed"])
    assert np.allclose(more, np.where(squares, scale**2, 1.0) * np.array(one), rtol=1e-9, atol=1e-9)


def test_taxels_on_a_line_know_a_slide_along_it() -> None:
    line = np.column_stack([np.arange(10.0), np.zeros(10)])
    before, after = (np.maximum(3.0 - np.abs(line[:, 0] - middle), 0.0) ** 0.5 for middle in (4.0, 4.8))
    found = compare(Skin.of(line.T), before, after, NOISE, np.array([0.8, 0.0, 0.0]))
    assert np.isfinite(found).all()
    assert np.sqrt(found.slide) < 0.1 * np.linalg.norm(after)


def test_without_load_nothing_is_left() -> None:
    none = np.zeros(len(PLACES))
    assert compare(SKIN, none, none, NOISE, np.zeros(3))[:3] == (0.0,) * 3


def test_patterns_are_comparable_where_half_of_the_load_is_on_the_same_taxels() -> None:
    assert overlap(SKIN, pressed(), pressed()).comparable
    assert not overlap(SKIN, pressed(x=-3.0), pressed(x=3.0)).comparable
    assert not overlap(SKIN, pressed(), np.zeros(len(PLACES))).comparable


def test_a_slide_that_knows_little_of_the_pattern_explains_nothing() -> None:
    found = compare(SKIN, pressed(), pressed(), NOISE, np.array([30.0, 0.0, 0.0]), sinks=True)
    assert np.hypot(found.x, found.y) < 0.1


def smooth(x: float) -> Floats:
    return np.asarray(np.exp(-((PLACES[:, 0] - x) ** 2 + PLACES[:, 1] ** 2) / (2 * 2.5**2)))


def test_errors_of_the_gains_do_not_show_that_a_smooth_object_rests() -> None:
    gains = 1.0 + 0.05 * np.random.default_rng(0).standard_normal(len(PLACES))
    patterns = gains * smooth(0.0), gains * smooth(0.4)
    exact, scattered = (compare(SKIN, *patterns, NOISE, np.zeros(3), gain_error=error) for error in (0.0, 0.05))
    assert exact.rests()
    assert not scattered.rests()
    assert scattered.log_ratio() == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("change", [{"x": 0.7}, {"depth": 0.8, "tilt": (0.05, 0.02)}, {"x": 0.3, "tilt": (0.04, 0.0)}])
def test_errors_of_the_gains_show_no_slide(change: dict[str, float]) -> None:
    after = pressed(**change)  # type: ignore[arg-type]
    exact, scattered = (compare(SKIN, pressed(), after, NOISE, np.zeros(3), gain_error=error) for error in (0.0, 0.05))
    assert min(exact.log_ratio(), 0.0) - 1e-9 <= scattered.log_ratio() <= exact.log_ratio() + 1e-9


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_no_slide(seed: int) -> None:
    random, noise = np.random.default_rng(seed), 0.05
    before, after = (pressed() + random.normal(0.0, noise / np.sqrt(2.0), len(PLACES)) for _ in range(2))
    found = compare(SKIN, before, after, noise, np.zeros(3))
    assert not found.slides()
    assert not found.shifts(noise)


def test_a_change_of_the_load_is_no_shift_of_the_pattern() -> None:
    assert not compare(SKIN, pressed(), 0.6 * pressed(), NOISE, np.zeros(3)).shifts(NOISE)
    assert compare(SKIN, pressed(), 0.6 * pressed(x=0.7), NOISE, np.zeros(3)).shifts(NOISE)


def test_a_slide_of_few_taxels_is_not_shown_by_them() -> None:
    two = np.zeros(len(PLACES))
    two[[44, 45]] = 1.0, 0.5
    other = np.zeros(len(PLACES))
    other[[44, 45]] = 0.3, 1.2
    found = compare(SKIN, two, other, NOISE, np.zeros(3))
    assert found.free_slide < 1.0
    assert not found.slides()


def test_taxels_that_a_plane_lifts_and_presses_in_turn_do_not_hide_the_best_fit() -> None:
    """An object that lifts off real taxels: the rounds that look for those in contact come to no end."""
    places = (
        np.array(
            [[-3, 1], [-1, 1], [1, 1], [3, 1], [-1, -1], [1, -1], [3, -1], [5, -1], [-1, -3], [1, -3], [3, -3], [5, -3]]
        ).T
        / 2.0
    )
    before = np.array([97.8, 318.4, 249.0, 183.1, 1485.0, 2148.3, 596.1, 106.3, 2533.1, 1202.9, 227.9, 346.0])
    after = np.array([11.8, 0.0, -0.2, 0.0, 865.0, 1070.0, -0.6, 0.0, 1640.8, 396.0, 0.0, 57.0])
    rest, _ = squares_at_rest(places, before, after, np.arange(12), 76.0)
    gain = before @ after / (before @ before)
    assert rest < np.sum((after - gain * before) ** 2)
