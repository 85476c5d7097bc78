from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.simulation.scenario import DESCRIPTIONS, SCENARIOS
from taxelflow.simulation.simulate import simulate


def test_every_scenario_is_described() -> None:
    assert list(DESCRIPTIONS) == list(SCENARIOS)


@pytest.mark.parametrize(
    "name",
    mostly_long(
        SCENARIOS,
        *(name for name in SCENARIOS if name not in ("two-contacts", "two-contacts-meet", "slide-and-turn-over-hand")),
    ),
)
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


@pytest.mark.long
def test_the_bulb_and_the_object_on_the_hand_touch_what_the_figures_show() -> None:
    for name, pads in (("bulb-pull", 7), ("turn-over-hand", 5), ("slide-and-turn-over-hand", 5)):
        recording = simulate(SCENARIOS[name])
        layout, values = recording.layout, recording.load().values
        loaded = [values[:, layout.of_pad(pad)].max() > 30.0 for pad in range(layout.pad_count)]
        assert sum(loaded) == pads, name


def test_the_papers_stroke_is_what_it_always_was() -> None:
    # docs/accuracy.md rests on these scans: a new sensor error must not draw from their generator
    raw = simulate(SCENARIOS["stroke"]).load()
    assert (raw.t_s[0], raw.values.sum()) == pytest.approx((0.0909945267602, 77738.5923754), rel=1e-9)
