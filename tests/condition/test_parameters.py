from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import ParameterInvalid


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"contact_off": 7.0}, "contact_off is 7.0; it lies above 0, up to contact_on = 6.0"),
        ({"contact_off": 0.0}, "contact_off is 0.0; it lies above 0"),
        ({"contact_off": -1.0}, "contact_off is -1.0; it lies above 0"),
        ({"contact_on": float("nan")}, "contact_off is 4.0; it lies above 0, up to contact_on = nan"),
        ({"contact_off": float("nan")}, "contact_off is nan; it lies above 0"),
        ({"tare": "sometimes"}, "tare is 'sometimes'; it is one of auto, none, start"),
        ({"repeats": "perhaps"}, "repeats is 'perhaps'; it is one of drop, keep"),
        ({"drift": "away"}, "drift is 'away'; it is one of keep, follow"),
        ({"mask": "3;4"}, "mask is '3;4'; it is auto, none, or numbers of taxels such as 17,203"),
        *(({"mask": mask}, "it is auto, none, or numbers of taxels") for mask in ("-1", "some", "1,x", "", "1.5")),
        ({"lowpass_hz": -1.0}, "lowpass_hz is -1.0; it is a frequency in Hz, or 0 for none"),
        ({"lowpass_hz": float("inf")}, "lowpass_hz is inf; it is a frequency in Hz"),
        ({"lowpass_hz": float("nan")}, "lowpass_hz is nan; it is a frequency in Hz"),
        ({"median_scans": 0}, "median_scans is 0; it is an odd number from 1 to 99"),
        ({"median_scans": 4}, "median_scans is 4; it is an odd number from 1 to 99"),
        ({"median_scans": 101}, "median_scans is 101; it is an odd number from 1 to 99"),
    ],
    ids=str,
)
def test_parameters_out_of_range_are_refused_by_name(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterInvalid, match=re.escape(message)):
        Conditioner(**parameters)


def test_a_list_of_taxels_is_masked() -> None:
    assert Conditioner(mask="3, 17").off == [3, 17]
    assert Conditioner(mask="auto").off == Conditioner().off == []


def test_a_taxel_that_the_sensor_does_not_have_cannot_be_masked() -> None:
    with pytest.raises(ParameterInvalid, match="mask is 6; this sensor's taxels are numbered from 0 to 5"):
        Conditioner(mask="6").start(grid_sensor(2, 3), np.zeros(6, dtype=np.bool_), None)
