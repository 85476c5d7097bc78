from __future__ import annotations

import pytest

from synthetic import grid_sensor
from taxelflow.contacts.features import ContactFeatures
from taxelflow.contacts.session import ContactSession
from taxelflow.errors import ParameterInvalid


@pytest.mark.parametrize("threshold", [-0.1, float("inf"), float("nan")])
def test_a_threshold_out_of_range_is_refused(threshold: float) -> None:
    with pytest.raises(ParameterInvalid, match=r"features.threshold must be 0 or more \(got .*\)"):
        ContactFeatures(threshold)


def test_parameters_start_a_session_of_the_contact_stage() -> None:
    assert isinstance(ContactFeatures().start(grid_sensor(4, 7), 6.0, 4.0), ContactSession)
