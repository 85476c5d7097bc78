from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import svg_words
from taxelflow.control.baselines import Constant
from taxelflow.errors import ExtraMissing, GraphicsMissing
from taxelflow.evaluation.control import Course
from taxelflow.evaluation.control_film import film_course
from taxelflow.evaluation.control_plot import headline, plot_course
from taxelflow.simulation.mujoco.camera import Arrow, Camera
from taxelflow.simulation.mujoco.events import EVENTS
from taxelflow.simulation.mujoco.gripper import Gripper
from taxelflow.simulation.mujoco.objects import shape
from taxelflow.simulation.mujoco.plant import Held
from taxelflow.simulation.mujoco.trial import Trial

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")


@pytest.mark.parametrize("event", EVENTS)
def test_a_headline_states_what_happens_with_its_numbers(event: str) -> None:
    trial = Trial.drawn(3, "bumpy", event)
    line = headline(trial)
    assert line.startswith("A bumpy block ")
    assert f"{1e3 * trial.held.mass_kg:.0f} g" in line


def test_a_course_is_drawn_with_units_and_the_line_is_explained(tmp_path: Path) -> None:
    for event, word in (("pour", "time in s; line: the load begins to change"), ("none", "time in s")):
        course = Course(Trial.drawn(1, "ball", event), Constant(), end_s=0.83)
        assert {"force in N", "slid in mm", word} <= set(svg_words(plot_course(course, tmp_path / "a.svg")))


@pytest.mark.long
def test_a_film_has_every_second_scan_and_its_end_for_a_second(tmp_path: Path) -> None:
    course = Course(Trial.drawn(1, "ball", "none"), Constant(), end_s=0.86)
    try:
        frames = film_course(course, tmp_path / "grip.gif")
    except (ExtraMissing, GraphicsMissing) as error:
        pytest.skip(str(error))
    assert frames == 3 + 25
    assert (tmp_path / "grip.gif").stat().st_size > 10_000


@pytest.mark.long
def test_an_arrow_is_visible_in_its_colour_even_inside_the_object() -> None:
    plant = Gripper(Held(shape("box", np.random.default_rng(0)), 0.3, 0.6))
    arrow = Arrow(np.zeros(3), np.array([0.0, 0.0, -0.02]), "#0000ff")
    try:
        with Camera(plant, 240, 240) as camera:
            with_arrow, without = camera.frame(arrows=lambda: [arrow]), camera.frame()
    except GraphicsMissing as error:
        pytest.skip(str(error))
    changed = with_arrow[(with_arrow != without).any(axis=-1)].astype(float)
    assert len(changed) > 40
    assert (changed[:, 2] > changed[:, 0]).mean() > 0.6  # blue; its rim is blended with the box


@pytest.mark.long
def test_the_plant_is_drawn_where_its_joints_were() -> None:
    plant = Gripper(Held(shape("ball", np.random.default_rng(0)), 0.3, 0.6))
    before = plant.data.qpos.copy()
    moved = before.copy()
    moved[4] -= 0.02  # the object, down
    try:
        with Camera(plant, 120, 120) as camera:
            first, lower, again = camera.frame(before), camera.frame(moved), camera.frame(before)
    except GraphicsMissing as error:
        pytest.skip(str(error))
    np.testing.assert_array_equal(first, again)
    assert (first != lower).any()
