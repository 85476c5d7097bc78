from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.acquire.base import HAND
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.numerics.geometry import transform
from taxelflow.pipeline.api import read
from taxelflow.simulation.contact import taxel_pressure
from taxelflow.simulation.load import state_at
from taxelflow.simulation.motion import move
from taxelflow.simulation.parameters import Contact, Load, Motion, Second, Sensing
from taxelflow.simulation.pattern import Analytic
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.simulate import of_second, pressures, save, simulate
from taxelflow.simulation.texture import feet_of

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats

EXACT = Sensing(noise_pa=0.0, baseline_pa=(0.0, 0.0), bits=32)
ROUND_KPA = 1e-6
"""What 32 bits leave."""


def values(scenario: Scenario) -> Floats:
    return simulate(scenario).load().values


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario(sensing=Sensing(rate_hz=1e9)),
        Scenario(motion=Motion(rest_s=1e9)),
        Scenario(motion=Motion(speed_m_s=1e-12)),
        Scenario(motion=Motion(rest_s=1e300)),
    ],
)
def test_a_recording_larger_than_memory_is_refused(scenario: Scenario) -> None:
    too_large = r"rate_hz must be at most .* Hz, .* 162 taxels over .* are more than .* GB, a fifth of this machine's"
    with pytest.raises(ParameterInvalid, match=too_large):
        simulate(scenario)


def test_on_the_palm_the_hand_frame_is_the_pads() -> None:
    motion = Motion(turn_rad_s=0.2)
    scenario = Scenario(contact=Contact("elongated", radius_m=0.01), motion=motion, sensing=EXACT)
    palm = slice(138, 162)
    np.testing.assert_allclose(values(replace(scenario, pad=HAND))[:, palm], values(scenario)[:, palm], atol=ROUND_KPA)


@pytest.mark.parametrize("pad", ["finger1_tip", "finger2_mid", "finger3_mid"])
def test_an_object_on_a_finger_is_the_same_through_the_hand(pad: str) -> None:
    motion = Motion(speed_m_s=0.01, direction_rad=0.4, travel_m=0.02, middle_m=(0.001, -0.002), angle_rad=0.3)
    on_pad = Scenario(
        pad=pad,
        contact=Contact("feet", radius_m=0.004, ring_m=0.007),
        motion=replace(motion, turn_rad_s=0.3),
        sensing=EXACT,
    )
    recording = simulate(on_pad)
    layout = recording.layout
    number = layout.pads.index(pad)
    home = layout.T_hand[number]
    through = replace(
        on_pad.motion,
        middle_m=tuple(transform(home, np.array(motion.middle_m))),
        direction_rad=motion.direction_rad + home[2],
        angle_rad=motion.angle_rad + home[2],
    )
    own = layout.of_pad(number)
    on_hand = values(replace(on_pad, pad=HAND, motion=through))
    np.testing.assert_allclose(on_hand[:, own], recording.load().values[:, own], atol=ROUND_KPA)
    truth = simulate(replace(on_pad, pad=HAND, motion=through)).truth
    assert truth is not None
    assert truth.pad == HAND


def test_a_hand_needs_a_pad_with_a_place(tmp_path: Path) -> None:
    file = tmp_path / "two.toml"
    pads = "".join(f'[[pads]]\nname = "{name}"\nrows = 4\ncols = 4\npitch_m = [0.01, 0.01]\n' for name in "ab")
    file.write_text(f'name = "two"\nunit = "Pa"\n{pads}')
    with pytest.raises(
        ParameterInvalid, match=r"pad must name a pad: no pad of .*two\.toml has a position .* origin_m"
    ):
        simulate(Scenario(sensor=str(file), pad=HAND))
    with pytest.raises(NameUnknown, match=r"unknown pad 'c'; known are a, b, hand"):
        simulate(Scenario(sensor=str(file), pad="c"))


def test_a_group_is_no_pad_to_touch() -> None:
    said = r"unknown pad 'palm_left'; did you mean 'palm'\? known are finger1_tip, .*palm, hand$"
    with pytest.raises(NameUnknown, match=said):
        simulate(Scenario(pad="palm_left"))


def test_a_rolling_scan_reads_every_taxel_at_its_own_time() -> None:
    scenario = Scenario(
        contact=Contact("textured"),
        motion=Motion(turn_rad_s=0.2),
        load=Load("ramp", (0.5, 1.0)),
        sensing=replace(EXACT, scan_share=0.8),
    )
    recording = simulate(scenario)
    raw, layout, truth = recording.load(), recording.layout, recording.truth
    assert truth is not None
    np.testing.assert_array_equal(truth.pose, move(scenario.motion, raw.t_s).pose)  # of the scan's start
    pattern = Analytic(scenario.contact, scenario.load, scenario.seed)
    for taxel in (138, 150, 161):
        when = raw.t_s[:, np.newaxis] + 0.8 / 7.0 * taxel / 162
        state = state_at(scenario.load, scenario.motion, when, np.zeros_like(when))
        at = layout.x_m[[taxel]], layout.y_m[[taxel]]
        alone = taxel_pressure(pattern, move(scenario.motion, when).pose, state, *at, (0.009, 0.009))
        np.testing.assert_allclose(raw.values[:, taxel], alone[:, 0] / 1e3, atol=ROUND_KPA)


def test_jitter_changes_the_reported_times_only() -> None:
    scenario = SCENARIOS["stroke"]
    jittered = simulate(replace(scenario, sensing=replace(scenario.sensing, jitter_s=0.01)))
    steady = simulate(scenario)
    assert jittered.truth is not None
    assert steady.truth is not None
    np.testing.assert_array_equal(jittered.load().values, steady.load().values)
    np.testing.assert_array_equal(jittered.truth.t_s, steady.truth.t_s)
    assert np.abs(jittered.load().t_s - steady.load().t_s).max() > 0.005


@pytest.mark.parametrize("pad", ["palm", HAND])
def test_truth_and_delays_are_saved_and_truth_comes_back(tmp_path: Path, pad: str) -> None:
    scenario = replace(SCENARIOS["stroke"], pad=pad, sensing=Sensing(scan_share=0.5))
    made = save(scenario, tmp_path / "a.npz").truth
    found = read(tmp_path / "a.npz").truth
    assert made is not None
    assert found is not None
    assert found.pad == pad
    assert made.slipping is not None
    assert found.slipping is not None
    np.testing.assert_array_equal(found.pose, made.pose)
    np.testing.assert_array_equal(found.slipping, made.slipping)
    np.testing.assert_allclose(read(tmp_path / "a.npz").layout.delay_s[:162], 0.5 / 7 * np.arange(162) / 162)


def test_two_objects_press_as_much_as_each_alone_and_both_have_a_truth(tmp_path: Path) -> None:
    two = replace(SCENARIOS["two-contacts"], sensing=EXACT)
    first = simulate(replace(two, second=Second()))
    both = simulate(two)
    t_s = both.known_truth.t_s
    beside = pressures(of_second(two), both.layout, [0], t_s) / both.sensor.to_si
    np.testing.assert_allclose(both.load().values, first.load().values + beside, atol=ROUND_KPA)
    truth = both.known_truth
    np.testing.assert_array_equal(truth.pose, first.known_truth.pose)
    assert truth.second is not None
    np.testing.assert_array_equal(truth.second, move(two.second.motion, t_s, two.seed + 1).pose)
    save(two, tmp_path / "two.npz")
    np.testing.assert_array_equal(read(tmp_path / "two.npz").known_truth.second, truth.second)
    assert first.known_truth.second is None


@pytest.mark.parametrize("feet", mostly_long([4, 9], 4))
def test_feet_lift_one_by_one_and_come_down_again(feet: int) -> None:
    contact = Contact("feet", radius_m=0.003, feet=feet, ring_m=0.02)
    motion = Motion(travel_m=0.0, strokes=1, turn_s=10.0, middle_m=(0.0, 0.0), rest_s=1.0)
    sensing = replace(EXACT, rate_hz=20.0)
    still = Scenario("grid-16x16", "grid", contact=contact, motion=motion, sensing=sensing)
    down = values(still)[0]
    recording = simulate(replace(still, load=Load(steps=feet)))
    pressed = recording.load().values
    progress = (recording.known_truth.t_s - 1.0) / 10.0 * feet
    layout, (at, _) = recording.layout, feet_of(contact)
    nearest = np.hypot(layout.x_m[:, np.newaxis] - at[:, 0], layout.y_m[:, np.newaxis] - at[:, 1]).argmin(axis=1)
    for foot in range(feet):
        under = (nearest == foot) & (down > 1.0)
        up = np.abs(progress - foot - 0.5) < 0.1
        assert up.any()
        assert pressed[up][:, under].max() < 0.01 * down[under].max()
        np.testing.assert_allclose(
            pressed[up][:, ~under & (nearest != foot)],
            np.tile(down[~under & (nearest != foot)], (up.sum(), 1)),
            atol=1e-3,
        )
    np.testing.assert_allclose(pressed[[0, -1]], [down, down], atol=ROUND_KPA)
