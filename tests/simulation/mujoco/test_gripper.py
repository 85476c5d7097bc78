from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.errors import ExtraMissing, NameUnknown, ParameterInvalid
from taxelflow.numerics.geometry import se3_of
from taxelflow.numerics.gravity import G_M_S2
from taxelflow.simulation.mujoco.events import EVENTS, Happening, Load
from taxelflow.simulation.mujoco.gripper import Gripper, sensor_of
from taxelflow.simulation.mujoco.objects import OBJECTS, STANDARD_OBJECTS, shape
from taxelflow.simulation.mujoco.plant import Actuator, Held
from taxelflow.simulation.mujoco.plants import TRIAL
from taxelflow.simulation.mujoco.skin import Skin
from taxelflow.simulation.mujoco.trial import Rehearsal, Trial, drawn_in_turn

if TYPE_CHECKING:
    from taxelflow.messages import Floats

MASS_KG, FRICTION = 0.3, 0.6
LEAST_N = MASS_KG * G_M_S2 / (2 * FRICTION)
NO_EVENT = Happening("none", MASS_KG, 1.0, 1.0, 0.0, 1.0, 0.0)


def gripper(kind: str, kinetic: float = 1.0, actuator: Actuator | None = None) -> Gripper:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'taxelflow[sim]'")
    held = Held(shape(kind, np.random.default_rng(3)), MASS_KG, FRICTION, kinetic)
    return Gripper(held, actuator=actuator or Actuator())


def lifted(plant: Gripper, force_n: float, until_s: float = 1.8) -> Floats:
    """(scans, 4): time, place along y and z, mean normal force of a lift with a constant force."""
    path = []
    while plant.t_s < until_s:
        force = -5.0 if plant.t_s < 0.15 else max(force_n, 3.0) if plant.t_s < 0.5 else force_n
        _, truth = plant.scan(force, NO_EVENT.load(plant.t_s))
        path.append((truth.t_s, *truth.slid_m, truth.normal_n.mean()))
    return np.array(path)


def test_the_solver_is_pinned() -> None:
    """Others let a held object creep: see `scene`."""
    mujoco = pytest.importorskip("mujoco")
    option = gripper("ball").model.opt
    assert option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert option.noslip_iterations >= 3
    assert option.noslip_tolerance == 0.0


@pytest.mark.parametrize("kind", mostly_long(STANDARD_OBJECTS, "box"))
def test_twice_the_least_grip_holds_without_creep(kind: str) -> None:
    path = lifted(gripper(kind), 2 * LEAST_N)
    steady = path[path[:, 0] > 1.3]
    assert abs(steady[-1, 2] - steady[0, 2]) / (steady[-1, 0] - steady[0, 0]) < 1e-6
    assert path[-1, 3] == pytest.approx(2 * LEAST_N, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["ball", "rod", "box"])
def test_friction_holds_just_under_its_limit_and_slides_just_above(kind: str) -> None:
    holding, sliding = (lifted(gripper(kind), LEAST_N / share) for share in (0.98, 1.02))
    assert abs(holding[-1, 2] - holding[0, 2]) < 2e-5
    assert sliding[-1, 2] < -5e-3


def test_kinetic_friction_may_be_below_static() -> None:
    held = lifted(gripper("ball", kinetic=0.7), 1.1 * LEAST_N)
    assert abs(held[-1, 2]) < 1e-4  # it never starts
    plant = gripper("ball", kinetic=0.7)
    lifted(plant, 1.1 * LEAST_N)
    for _ in range(5):
        plant.scan(1.1 * LEAST_N, Load(2 * MASS_KG, np.array([0.0, 0.0, -G_M_S2]), np.zeros(3)))
    before = plant.scan(1.1 * LEAST_N, NO_EVENT.load(9.0))[1]
    for _ in range(5):
        _, after = plant.scan(1.1 * LEAST_N, NO_EVENT.load(9.0))
    assert after.speed_m_s > before.speed_m_s  # the old load is back, and it slides on, faster


@pytest.mark.parametrize("kind", mostly_long(OBJECTS, "ball", "box", "convex"))
def test_taxels_sum_to_the_normal_force(kind: str) -> None:
    plant = gripper(kind)
    lifted(plant, 2 * LEAST_N, until_s=TRIAL.lift_s)
    _, truth = plant.scan(2 * LEAST_N, NO_EVENT.load(TRIAL.lift_s))
    for side in range(2):
        pressure = plant.pressure(side, truth.normal_n[side])
        assert pressure.sum() * plant.skin.pitch_m**2 == pytest.approx(truth.normal_n[side], rel=0.02)
        assert (pressure > 0).sum() > 10  # a field, not a point


def test_an_object_that_sinks_moves_down_in_both_pads() -> None:
    plant = gripper("ball")
    lifted(plant, 1.5 * LEAST_N, until_s=TRIAL.lift_s)
    rows = np.repeat(np.arange(16), 16)
    centres = []
    for _ in range(2):
        readings, truth = plant.scan(0.5 * LEAST_N, Load(MASS_KG, np.array([0, 2.0, -G_M_S2]), np.zeros(3)))
        for _ in range(3):
            readings, truth = plant.scan(0.5 * LEAST_N, Load(MASS_KG, np.array([0, 2.0, -G_M_S2]), np.zeros(3)))
        centres.append([[pad @ rows, pad @ np.tile(np.arange(16), 16)] / pad.sum() for pad in readings])
    assert truth.slid_m[1] < -1e-3
    assert truth.slid_m[0] > 2e-4
    (left, right) = np.array(centres[1]) - np.array(centres[0])
    assert left[0] > 0.2  # row 0 is on top
    assert right[0] > 0.2
    assert left[1] > 0 > right[1]  # the pads face each other
    assert plant.down @ [0.0, -left[0]] > 0  # y is up
    assert plant.joints == pytest.approx(np.full(2, plant.joints.mean()), abs=1e-3)
    assert plant.joints.min() > 0.005


@pytest.mark.parametrize("kind", mostly_long(["ball", "rod", "bottle"], "ball"))
def test_pads_press_as_hard_on_an_object_that_slides_fast(kind: str) -> None:
    plant = gripper(kind)
    lifted(plant, 1.5 * LEAST_N, until_s=TRIAL.lift_s)
    gravity = np.array([0.0, 0.0, -G_M_S2])
    truths = [plant.scan(0.7 * LEAST_N, Load(MASS_KG, gravity, np.zeros(3)))[1] for _ in range(12)]
    assert truths[-1].speed_m_s > 0.15
    for truth in truths[8:]:
        assert truth.normal_n == pytest.approx(0.7 * LEAST_N, rel=0.1)
    gained = np.diff([truth.speed_m_s for truth in truths[8:]]) * plant.rate_hz
    np.testing.assert_allclose(gained, 0.3 * G_M_S2, rtol=0.1)  # friction is mu times the normal force


def test_latency_delays_the_force() -> None:
    prompt, late = gripper("ball"), gripper("ball", actuator=Actuator(latency_s=0.05))
    for plant in (prompt, late):
        lifted(plant, 2 * LEAST_N, until_s=TRIAL.lift_s)
        plant.forces = [plant.scan(4 * LEAST_N, NO_EVENT.load(TRIAL.lift_s))[1].normal_n.mean() for _ in range(10)]  # type: ignore[attr-defined]
    np.testing.assert_allclose(late.forces[5:], prompt.forces[:5], rtol=0.02)  # type: ignore[attr-defined]


@pytest.mark.parametrize("bandwidth_hz", [5.0, 20.0])
def test_the_force_follows_with_the_bandwidth(bandwidth_hz: float) -> None:
    """A lag of first order: 1 - 1 / e of a step after 1 / (2 pi f)."""
    plant = gripper("ball", actuator=Actuator(bandwidth_hz=bandwidth_hz))
    lifted(plant, 2 * LEAST_N, until_s=TRIAL.lift_s)
    began_s = plant.t_s
    seen = [plant.scan(3 * LEAST_N, NO_EVENT.load(TRIAL.lift_s))[1] for _ in range(20)]
    t_s = np.array([truth.t_s for truth in seen]) - began_s
    share = (np.array([truth.normal_n.mean() for truth in seen]) - 2 * LEAST_N) / LEAST_N
    np.testing.assert_allclose(share, 1.0 - np.exp(-2.0 * np.pi * bandwidth_hz * t_s), atol=0.08)


def test_no_force_is_above_the_limit() -> None:
    plant = gripper("ball", actuator=Actuator(max_n=2.5 * LEAST_N))
    path = lifted(plant, 4 * LEAST_N)
    assert path[-1, 3] == pytest.approx(2.5 * LEAST_N, rel=0.02)
    assert path[:, 3].max() < 2.6 * LEAST_N


def test_without_mujoco_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraMissing, match=r"mujoco is not installed; .*taxelflow\[sim\]"):
        Gripper(Held(shape("ball", np.random.default_rng(0)), 0.3, 0.6))


@pytest.mark.parametrize(("name", "value"), [("bandwidth_hz", 0.0), ("latency_s", -1.0), ("max_n", np.nan)])
def test_an_actuator_out_of_range_is_refused(name: str, value: float) -> None:
    with pytest.raises(ParameterInvalid, match=rf"actuator\.{name} must be"):
        replace(Actuator(), **{name: value})


def test_a_rate_that_does_not_divide_the_solvers_is_refused() -> None:
    pytest.importorskip("mujoco")
    with pytest.raises(ParameterInvalid, match="rate_hz must divide 2000 Hz"):
        Gripper(Held(shape("ball", np.random.default_rng(0)), 0.3, 0.6), rate_hz=30.0)


def test_a_trial_is_drawn_from_its_seed_alone() -> None:
    assert Trial.drawn(7, "bumpy", "pull") == Trial.drawn(7, "bumpy", "pull") != Trial.drawn(8, "bumpy", "pull")
    with pytest.raises(NameUnknown, match="unknown object 'bal'; did you mean 'ball'"):
        Trial.drawn(7, "bal", "pull")
    with pytest.raises(NameUnknown, match="unknown event 'push'"):
        Trial.drawn(7, "ball", "push")
    with pytest.raises(ParameterInvalid, match="seed must be 0 or more"):
        Trial.drawn(-1, "ball", "pull")


def test_mass_friction_and_offset_are_random_and_become_the_plants() -> None:
    held = [Trial.drawn(seed, "box", "none").held for seed in range(200)]
    for values, low, high in (
        ([one.mass_kg for one in held], 0.1, 0.5),
        ([one.friction for one in held], 0.35, 0.9),
        ([one.offset_m[0] for one in held], -0.003, 0.003),
        ([one.offset_m[1] for one in held], -0.003, 0.003),
    ):
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    pytest.importorskip("mujoco")
    model = Gripper(held[0]).model
    body = model.body("object")
    np.testing.assert_allclose(body.ipos, [0.0, *held[0].offset_m])
    assert body.mass == pytest.approx(held[0].mass_kg)
    assert model.pair_friction[:, 0] == pytest.approx(held[0].friction)


@pytest.mark.long
def test_random_convex_meshes_differ_and_are_grasped_and_held() -> None:
    pytest.importorskip("mujoco")
    meshes = set()
    for seed in range(4):
        trial = Trial.drawn(seed, "convex", "none")
        meshes.add(trial.held.shape.mesh)
        rehearsal = Rehearsal(trial)
        *_, lifted_at = rehearsal.start()
        assert rehearsal.grasped
        for _ in range(60):
            moment = rehearsal.step(2.5 * trial.least_n(TRIAL.lifted_s))
        assert np.linalg.norm(moment.truth.slid_m - lifted_at.truth.slid_m) < 1e-3
    assert len(meshes) == 4


def test_objects_and_events_come_in_turn() -> None:
    trials = list(drawn_in_turn(5, 8, ("ball", "rod"), ("pour", "weak", "pull", "none"), Trial.drawn))
    assert len({(trial.object, trial.event) for trial in trials}) == 8
    assert [trial.seed for trial in trials] == list(range(5, 13))
    with pytest.raises(ParameterInvalid, match="trials must be at least 1"):
        next(drawn_in_turn(5, 0, ("ball",), ("pour",), Trial.drawn))


@pytest.mark.parametrize("event", EVENTS)
def test_the_least_force_follows_the_load(event: str) -> None:
    trial = Trial.drawn(4, "ball", event)
    before, after = trial.least_n(1.2), trial.least_n(4.0)
    assert before == pytest.approx(trial.held.mass_kg * G_M_S2 / (2 * trial.held.friction))
    assert (after > 1.2 * before) == (event in {"pour", "pull", "shake", "double"})
    assert (trial.first_n < before) == (event == "weak")


def test_a_rehearsal_knows_whether_the_object_was_grasped() -> None:
    pytest.importorskip("mujoco")
    trial = Trial.drawn(1, "ball", "none")
    grasping = Rehearsal(trial)
    assert len(list(grasping.start())) == 80
    assert grasping.grasped
    weak = Rehearsal(trial, actuator=Actuator(max_n=0.1 * trial.first_n))
    assert list(weak.start())
    assert not weak.grasped


@pytest.mark.parametrize(("left", "right", "grasped"), [(5.1, 5.1, True), (5.1, 4.9, False), (4.9, 20.0, False)])
def test_half_of_the_force_on_each_pad_is_a_grasp(left: float, right: float, grasped: bool) -> None:
    plant = gripper("ball")
    _, truth = plant.scan(0.0, NO_EVENT.load(0.0))
    assert plant.grasps(replace(truth, normal_n=np.array([left, right])), 10.0) == grasped


def test_the_seed_draws_the_noise_of_the_taxels() -> None:
    pytest.importorskip("mujoco")
    held = Held(shape("ball", np.random.default_rng(3)), MASS_KG, FRICTION)
    one, same, other = (Gripper(held, seed=seed).scan(-5.0, NO_EVENT.load(0.0))[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_the_pads_of_the_sensor_face_each_other_with_their_y_axes_up() -> None:
    sensor = sensor_of(Skin())
    left, right = (se3_of(np.array(pad.pose[:3]), np.array(pad.pose[3:])) for pad in sensor.pads)
    for pad, other, along in ((left, right, 1.0), (right, left, -1.0)):
        way = other[:3, 3] - pad[:3, 3]
        np.testing.assert_allclose(pad[:3, 2], way / np.linalg.norm(way), atol=1e-12)
        np.testing.assert_allclose(pad[:3, 1], [0.0, 0.0, 1.0], atol=1e-12)
        np.testing.assert_allclose(pad[:3, 0], [0.0, along, 0.0], atol=1e-12)
    assert left[0, 3] < right[0, 3]
    assert (sensor.full_scale, sensor.unseen_error) == (Skin().full_scale_pa, 0.0)


def test_the_sensor_has_two_pads_of_the_skin() -> None:
    layout = sensor_of(Skin(rows=8)).layout
    assert layout.pads == ("left", "right")
    assert layout.taxels == 2 * 8 * 16
