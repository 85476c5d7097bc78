from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taxelflow.errors import ParameterInvalid
from taxelflow.simulation.parameters import Contact, Load, Motion, Second, Sensing
from taxelflow.simulation.scenario import DESCRIPTIONS, SCENARIOS, Scenario
from taxelflow.simulation.simulate import simulate


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (Contact, {"radius_m": 0.0}, r"contact.radius_m must be a finite number above 0 \(got 0\.0\)"),
        (Contact, {"feet": 0}, r"contact.feet must be between 1 and 10000 \(got 0\)"),
        (Contact, {"texture": 1.5}, r"contact.texture must be between 0 and 1 \(got 1\.5\)"),
        (Contact, {"deform_1_m": -1.0}, r"contact.deform_1_m must be 0 or more \(got -1\.0\)"),
        (Motion, {"interval_s": (0.4, 0.1)}, r"motion.interval_s must be two numbers above 0, smaller first"),
        (
            Motion,
            {"kind": "stick-slip", "travel_m": 0.01},
            r"motion.travel_m must be at least 0\.012 m, twice the longest slip \(got 0\.01\)",
        ),
        (Motion, {"rest_s": -1.0}, r"motion.rest_s must be 0 or more \(got -1\.0\)"),
        (Load, {"growth": 0.7}, r"load.growth must be between 0 and 0\.5 \(got 0\.7\)"),
        (Load, {"multiples": (0.0, 1.0)}, r"load.multiples must be a finite number above 0 \(got 0\.0\)"),
        (Load, {"tilt": float("nan")}, r"load.tilt must be between -1 and 1 \(got nan\)"),
        (Sensing, {"scan_share": 1.1}, r"sensing.scan_share must be between 0 and 1 \(got 1\.1\)"),
        (Sensing, {"jitter_s": -0.1}, r"sensing.jitter_s must be 0 or more \(got -0\.1\)"),
        (Scenario, {"load": Load(lift_s=9.0)}, r"load.lift_s must be at most motion.rest_s, 3 s: .*\(got 9\.0\)"),
        (
            Scenario,
            {"contact": Contact("feet"), "load": Load(roll_m=0.01)},
            r"load.roll_m must be 0 for contact.shape feet",
        ),
        (Scenario, {"solver": "elastic", "contact": Contact(deform_1_m=1.0)}, r"must be 0 with solver elastic"),
        (Load, {"steps": -1}, r"load.steps must be between 0 and 10000 \(got -1\)"),
        (Scenario, {"load": Load(steps=3)}, r"load.steps must be 0, except for contact.shape feet"),
        (Scenario, {"pad": "hand", "second": Second(there=True)}, r"second.there must be False for pad hand"),
        (
            Scenario,
            {"second": Second(load=Load(lift_s=9.0))},
            r"load.lift_s must be at most motion.rest_s, 3 s: .*\(got 9\.0\)",
        ),
        (
            Scenario,
            {"solver": "elastic", "contact": Contact("bulb"), "load": Load(roll_m=0.01)},
            r"must be 0 for a textured contact with solver elastic",
        ),
    ],
)
def test_bad_values_are_refused_with_what_is_allowed(kind: type, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterInvalid, match=message):
        kind(**values)


def test_every_scenario_is_described() -> None:
    assert list(DESCRIPTIONS) == list(SCENARIOS)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_runs_within_full_scale_and_touches(name: str) -> None:
    scenario = SCENARIOS[name]
    motion = replace(scenario.motion, stick_slip_s=1.0)
    if name.startswith("hold"):
        motion = replace(motion, turn_s=2.0)
    sensing = replace(scenario.sensing, rate_hz=min(20.0, scenario.sensing.rate_hz))
    recording = simulate(replace(scenario, motion=motion, sensing=sensing))
    values, truth = recording.load().values, recording.truth
    assert truth is not None
    assert truth.slipping is not None
    assert np.isfinite(values).all()
    full = scenario.sensing.full_scale_pa / recording.sensor.to_si
    assert 0.3 * full < values.max() <= full
    assert truth.slipping.any() == (name not in ("press", "roll", "tilt") and not name.startswith("hold"))


def test_the_bulb_and_the_object_on_the_hand_touch_what_the_figures_show() -> None:
    for name, pads in (("bulb-pull", 7), ("turn-over-hand", 5), ("slide-and-turn-over-hand", 5)):
        recording = simulate(SCENARIOS[name])
        layout, values = recording.layout, recording.load().values
        loaded = [values[:, layout.of_pad(pad)].max() > 30.0 for pad in range(layout.pad_count)]
        assert sum(loaded) == pads, name


def test_the_papers_stroke_is_what_it_always_was() -> None:
    # docs/accuracy.md rests on these scans: a new fault must not draw from their generator
    raw = simulate(SCENARIOS["stroke"]).load()
    assert (raw.t_s[0], raw.values.sum()) == pytest.approx((0.0909945267602, 77738.5923754), rel=1e-9)
