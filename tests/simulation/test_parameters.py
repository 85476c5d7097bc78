from __future__ import annotations

from typing import Any

import pytest

from taxelflow.errors import ParameterInvalid
from taxelflow.simulation.parameters import Contact, Load, Motion, Second, Sensing
from taxelflow.simulation.scenario import Scenario


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
        (Motion, {"turn_rad_s": float("inf")}, r"motion.turn_rad_s must be between -1e\+06 and 1e\+06 \(got inf\)"),
        (Motion, {"centre_m": (0.0, float("nan"))}, r"motion.centre_m must be between -1e\+06 and 1e\+06 \(got nan\)"),
        (Contact, {"feet_at_m": ((float("nan"), 0.0),)}, r"contact.feet_at_m must be between .*\(got nan\)"),
        (Load, {"roll_m": float("nan")}, r"load.roll_m must be between -1e\+06 and 1e\+06 \(got nan\)"),
        (Load, {"towards_rad": float("inf")}, r"load.towards_rad must be between .*\(got inf\)"),
        (Sensing, {"drift_pa_s": float("nan")}, r"sensing.drift_pa_s must be between .*\(got nan\)"),
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
