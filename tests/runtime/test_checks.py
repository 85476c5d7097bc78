from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest

from taxelflow import Conditioner, Contact, Load, Motion, Sensing, SlipMonitor, Smoothing
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import ParameterInvalid
from taxelflow.fusion.parameters import RigidField
from taxelflow.fusion.spatial.parameters import SpatialField
from taxelflow.pipeline.api import estimator
from taxelflow.runtime import registry

STAGES = (
    Conditioner,
    SlipMonitor,
    Smoothing,
    RigidField,
    SpatialField,
    ContactFeatures,
    Contact,
    Load,
    Motion,
    Sensing,
)


@pytest.mark.parametrize("value", ["x", None, [1, 2], True])
@pytest.mark.parametrize("stage", STAGES)
def test_what_is_no_number_is_refused_by_name(stage: Any, value: Any) -> None:
    numbers = [one.name for one in fields(stage) if one.type in ("float", "int")]
    assert numbers
    for name in numbers:
        with pytest.raises(ParameterInvalid, match=rf"{name} must be a number \(got"):
            stage(**{name: value})


@pytest.mark.parametrize("method", registry.names("estimator"))
def test_a_method_names_its_parameter_that_is_no_number(method: str) -> None:
    for one in fields(registry.find("estimator", method)):
        with pytest.raises(ParameterInvalid, match=rf"^{one.name} must be a number \(got 'x'\)"):
            estimator(method, **{one.name: "x"})


def test_a_mask_is_text() -> None:
    for mask in (None, [17, 203]):
        with pytest.raises(ParameterInvalid, match="mask must be auto, none, or numbers of taxels such as 17,203"):
            Conditioner(mask=mask)  # type: ignore[arg-type]
