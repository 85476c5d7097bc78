from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.errors import ExtraMissing
from taxelflow.simulation import elastic
from taxelflow.simulation.elastic import Elastic, grid_of, solved
from taxelflow.simulation.load import State
from taxelflow.simulation.parameters import Contact, Load, Motion, Sensing
from taxelflow.simulation.pattern import Analytic
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.messages import Floats

PITCH_M = 0.01


@pytest.fixture
def solver() -> None:
    pytest.importorskip("tamaas", reason="tamaas is not installed: pip install 'taxelflow[elastic]'")


def field(contact: Contact, force: float = 1.0) -> tuple[Floats, float]:
    """Pressure over the peak on the solver's grid, and the area of a cell in m2."""
    box_m, points = grid_of(contact, force, PITCH_M)
    return solved(contact, 0, force, box_m, points), (box_m / points) ** 2


def still(force: float = 1.0) -> State:
    return State(*(np.array([[number]]) for number in (force, 0.0, 0.0, 0.0, 0.0)))


@pytest.mark.usefixtures("solver")
def test_a_sphere_is_pressed_by_the_law_of_hertz() -> None:
    pressure, cell_m2 = field(Contact("hertz"))
    assert pressure.sum() * cell_m2 == pytest.approx(2 / 3 * np.pi * 0.015**2, rel=0.01)
    assert pressure.max() == pytest.approx(1.0, rel=0.1)
    assert np.sum(pressure > 0) * cell_m2 == pytest.approx(np.pi * 0.015**2, rel=0.1)
    x = np.linspace(-0.02, 0.02, 101)[np.newaxis]
    contact = Contact("hertz")
    solved_pa = Elastic(contact, Load(), 0, PITCH_M)(x, 0 * x, still())
    formula_pa = Analytic(contact, Load(), 0)(x, 0 * x, still())
    assert np.sqrt(np.mean((solved_pa - formula_pa) ** 2)) < 0.05 * contact.peak_pa


@pytest.mark.usefixtures("solver")
def test_a_sphere_looks_the_same_from_all_sides() -> None:
    pressure, _ = field(Contact("hertz"))
    for turned in (pressure.T, pressure[::-1], pressure[:, ::-1]):
        np.testing.assert_allclose(turned, pressure, atol=1e-4)


@pytest.mark.usefixtures("solver")
@pytest.mark.parametrize(
    "shape", mostly_long(["airbag", "elongated", "feet", "textured", "bulb"], "airbag", "feet", "textured")
)
def test_every_shape_carries_its_force_with_about_its_peak(shape: Any) -> None:
    contact = Contact(shape, radius_m=0.005 if shape == "feet" else 0.012, texture=0.2)
    pressure, cell_m2 = field(contact)
    box_m, points = grid_of(contact, 1.0, PITCH_M)
    axis = (np.arange(points) - (points - 1) / 2) * box_m / points
    formula = Analytic(contact, Load(), 0)(axis[:, np.newaxis], axis[np.newaxis], still())
    assert pressure.min() >= 0
    assert pressure.sum() == pytest.approx(formula.sum() / contact.peak_pa, rel=1e-3)
    smoothed = np.sort(pressure.ravel())[-int(max(4, 25e-6 / cell_m2 / 4)) :].mean()
    assert 0.7 < smoothed < 1.8


@pytest.mark.usefixtures("solver")
def test_the_contact_grows_with_the_cube_root_of_the_force() -> None:
    (one, cell), (eight, larger_cell) = field(Contact("hertz")), field(Contact("hertz"), 8.0)
    assert np.sum(eight > 0) * larger_cell == pytest.approx(4 * np.sum(one > 0) * cell, rel=0.1)
    assert eight.max() == pytest.approx(2 * one.max(), rel=0.05)


@pytest.mark.long
@pytest.mark.usefixtures("solver")
def test_loads_between_those_solved_are_interpolated_and_none_is_none() -> None:
    pattern = Elastic(Contact("hertz"), Load("ramp", (1.0, 4.0)), 0, PITCH_M)
    x = np.linspace(-0.015, 0.015, 61)[np.newaxis]
    one, between, four, lifted = (pattern(x, 0 * x, still(force)) for force in (1.0, 1.2, 4.0, 0.0))
    assert one.max() < between.max() < four.max()
    assert between.max() / one.max() == pytest.approx(1.2 ** (1 / 3), rel=0.03)
    assert not lifted.any()


@pytest.mark.usefixtures("solver")
def test_a_simulated_stroke_agrees_with_the_formula(capfd: pytest.CaptureFixture[str]) -> None:
    scenario = Scenario(
        contact=Contact("hertz"),
        motion=Motion(speed_m_s=0.05),
        sensing=Sensing(noise_pa=0.0, baseline_pa=(0.0, 0.0), bits=24),
    )
    formula, solver = (simulate(replace(scenario, solver=solver)) for solver in ("analytic", "elastic"))
    assert np.abs(solver.load().values - formula.load().values).max() < 8.0  # of 80 kPa
    assert formula.truth is not None
    assert solver.truth is not None
    np.testing.assert_array_equal(solver.truth.pose, formula.truth.pose)
    assert capfd.readouterr() == ("", "")


@pytest.mark.long
@pytest.mark.usefixtures("solver")
def test_feet_turned_over_the_hand_are_solved_too() -> None:
    recording = simulate(replace(SCENARIOS["turn-over-hand"], solver="elastic"))
    layout, values = recording.layout, recording.load().values
    loaded = [values[:, layout.of_pad(pad)].max() > 20.0 for pad in range(layout.pad_count)]
    assert sum(loaded) == 5


def test_without_the_solver_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tamaas", None)
    elastic.solved.cache_clear()
    with pytest.raises(ExtraMissing, match=r"tamaas is not installed; .*taxelflow\[elastic\]"):
        simulate(replace(SCENARIOS["stroke"], solver="elastic"))
