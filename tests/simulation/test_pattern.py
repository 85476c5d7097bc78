from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.messages import Floats
from taxelflow.simulation.contact import taxel_pressure
from taxelflow.simulation.load import State
from taxelflow.simulation.parameters import Contact, Load
from taxelflow.simulation.pattern import Analytic
from taxelflow.simulation.texture import feet_of

PITCH_M, SIDE = 0.004, 16
SHAPES = ("airbag", "hertz", "elongated", "feet", "textured", "bulb")
AXIS = (np.arange(SIDE) - (SIDE - 1) / 2) * PITCH_M
X, Y = (grid.ravel() for grid in np.meshgrid(AXIS, -AXIS))

shapes = st.sampled_from(SHAPES)
places = st.floats(-0.006, 0.006)
angles = st.floats(-3.0, 3.0)


def contact(shape: Any, **fields: Any) -> Contact:
    return Contact(shape, **{"radius_m": 0.005 if shape == "feet" else 0.009, "aspect": 1.5, **fields})


def state(force: float = 1.0, tilt: float = 0.0, roll_m: float = 0.0, deformed: float = 0.0) -> State:
    return State(*(np.array([[number]]) for number in (force, tilt, roll_m, deformed, 0.0)))


def image(
    touching: Contact, pose: tuple[float, float, float], load: Load | None = None, now: State | None = None
) -> Floats:
    """(rows, cols) on a square grid, row 0 on top."""
    pattern = Analytic(touching, load or Load(), seed=3)
    pressure = taxel_pressure(pattern, np.array([[pose]]), now or state(), X, Y, (0.9 * PITCH_M, 0.9 * PITCH_M))
    return pressure.reshape(SIDE, SIDE)


@given(shapes, places, places, angles, st.integers(-2, 2), st.integers(-2, 2))
def test_a_shift_by_taxels_shifts_the_image(shape: str, x: float, y: float, angle: float, cols: int, up: int) -> None:
    there = image(contact(shape), (x, y, angle))
    moved = image(contact(shape), (x + cols * PITCH_M, y + up * PITCH_M, angle))
    shifted = np.roll(there, (-up, cols), axis=(0, 1))
    np.testing.assert_allclose(moved[2:-2, 2:-2], shifted[2:-2, 2:-2], rtol=1e-6, atol=1e-3)


@given(shapes, places, places, angles)
def test_a_quarter_turn_turns_the_image(shape: str, x: float, y: float, angle: float) -> None:
    turned = image(contact(shape), (-y, x, angle + np.pi / 2))
    np.testing.assert_allclose(turned, np.rot90(image(contact(shape), (x, y, angle))), rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize("shape", SHAPES)
def test_pressure_is_never_negative_and_peaks_about_where_it_should(shape: str) -> None:
    pressure = image(contact(shape, ring_m=0.012), (0.0, 0.0, 0.0))
    assert pressure.min() >= 0
    textured = shape in ("textured", "bulb")
    assert 0.8 * 80e3 < pressure.max() < (2.2 if textured else 1.01) * 80e3


@pytest.mark.parametrize("shape", ["airbag", "hertz", "elongated"])
@given(st.floats(0.2, 3.0), st.floats(0.0, 0.5))
def test_the_sum_follows_the_force_however_the_contact_grows(shape: str, force: float, growth: float) -> None:
    axis = np.linspace(-0.06, 0.06, 241)
    grown = Analytic(contact(shape), Load(growth=growth), 0)
    one, pressed = (grown(axis[:, np.newaxis], axis[np.newaxis], state(f)).sum() for f in (1.0, force))
    assert pressed == pytest.approx(force * one, rel=0.01)


def test_a_hertz_contact_grows_with_the_cube_root_of_the_force() -> None:
    pressed = image(contact("hertz"), (0.0, 0.0, 0.0), Load(growth=1 / 3), state(8.0))
    twice = image(contact("hertz", radius_m=0.018, peak_pa=160e3), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(pressed, twice, rtol=1e-9)


@pytest.mark.parametrize("feet", [2, 3, 5, 8])
def test_no_two_feet_are_equal_so_no_turn_is_a_symmetry(feet: int) -> None:
    on_ring = contact("feet", feet=feet, ring_m=0.02, radius_m=0.004)
    places, heights = feet_of(on_ring)
    np.testing.assert_allclose(np.hypot(*places.T), 0.02)
    assert len(set(np.round(heights, 6))) == feet
    still = image(on_ring, (0.0, 0.0, 0.0))
    for turn in range(1, feet):
        turned = image(on_ring, (0.0, 0.0, 2 * np.pi * turn / feet))
        assert np.abs(turned - still).max() > 0.04 * still.max()


@pytest.mark.parametrize("shape", ["airbag", "feet", "textured"])
def test_an_object_deforms_as_it_travels(shape: str) -> None:
    soft = contact(shape, deform_1_m=2.0)
    fresh, later = (image(soft, (0.0, 0.0, 0.0), now=state(deformed=cycles)) for cycles in (0.0, 0.25))
    np.testing.assert_array_equal(fresh, image(contact(shape), (0.0, 0.0, 0.0)))
    assert np.abs(later - fresh).max() > 0.02 * fresh.max()


def test_a_rolling_bag_moves_its_pressure_but_not_its_texture() -> None:
    along, across = np.linspace(-0.008, 0.008, 50), np.zeros(50)
    bag, rough = (Analytic(contact(shape), Load(roll_m=0.004), 0) for shape in ("airbag", "textured"))
    still, rolled = state(), state(roll_m=0.004)
    np.testing.assert_allclose(bag(along, across, rolled), bag(along - 0.004, across, still))
    texture = rough(along, across, still) / bag(along, across, still)
    np.testing.assert_allclose(rough(along, across, rolled), texture * bag(along, across, rolled))


def test_many_feet_add_up_like_few() -> None:
    soft = contact("feet", feet_on="disc", feet=40, ring_m=0.03, radius_m=0.003)
    places, heights = feet_of(soft)
    x, y = np.random.default_rng(0).uniform(-0.03, 0.03, (2, 500))
    r2 = ((x[:, np.newaxis] - places[:, 0]) ** 2 + (y[:, np.newaxis] - places[:, 1]) ** 2) / 0.003**2
    every = 80e3 * np.sum(heights * np.exp(-(r2**2)), axis=1)
    np.testing.assert_allclose(Analytic(soft, Load(), 0)(x, y, state())[0], every, atol=1e-3)


def test_tilt_presses_one_side_and_relieves_the_other() -> None:
    load = Load(tilt=0.6, towards_rad=np.pi / 2)
    flat, tilted = (image(contact("airbag"), (0, 0, 0), load, state(tilt=tilt)) for tilt in (0.0, 0.6))
    assert tilted[:8].sum() > 1.2 * flat[:8].sum()
    assert tilted.sum() == pytest.approx(flat.sum(), rel=1e-3)
    np.testing.assert_allclose(tilted, tilted[:, ::-1], rtol=1e-9, atol=1e-3)
