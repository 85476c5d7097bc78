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
        ({"contact_off": 7.0}, "contact_off must be above 0 and at most contact_on, 6.0 (got 7.0)"),
        ({"contact_off": 0.0}, "contact_off must be above 0 and at most contact_on, 6.0 (got 0.0)"),
        ({"contact_off": -1.0}, "contact_off must be above 0 and at most contact_on, 6.0 (got -1.0)"),
        ({"contact_on": float("nan")}, "contact_on must be a finite number above 0 (got nan)"),
        ({"contact_off": float("nan")}, "contact_off must be above 0 and at most contact_on, 6.0 (got nan)"),
        ({"tare": "sometimes"}, "tare must be one of auto, none, start (got 'sometimes')"),
        ({"repeats": "perhaps"}, "repeats must be one of drop, keep (got 'perhaps')"),
        ({"drift": "away"}, "drift must be one of keep, follow (got 'away')"),
        ({"mask": "3;4"}, "mask must be auto, none, or numbers of taxels such as 17,203 (got '3;4')"),
        *(
            ({"mask": mask}, "mask must be auto, none, or numbers of taxels")
            for mask in ("-1", "some", "1,x", "", "1.5")
        ),
        ({"lowpass_hz": -1.0}, "lowpass_hz must be a frequency in Hz, or 0 for no filter (got -1.0)"),
        ({"lowpass_hz": float("inf")}, "lowpass_hz must be a frequency in Hz, or 0 for no filter (got inf)"),
        ({"lowpass_hz": float("nan")}, "lowpass_hz must be a frequency in Hz, or 0 for no filter (got nan)"),
        ({"median_scans": 0}, "median_scans must be an odd number of scans from 1 to 99 (got 0)"),
        ({"median_scans": 4}, "median_scans must be an odd number of scans from 1 to 99 (got 4)"),
        ({"median_scans": 2.5}, "median_scans must be an odd number of scans from 1 to 99 (got 2.5)"),
        ({"median_scans": 101}, "median_scans must be an odd number of scans from 1 to 99 (got 101)"),
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
    with pytest.raises(ParameterInvalid, match=r"mask must list taxels between 0 and 5 \(got 6\)"):
        Conditioner(mask="6").start(grid_sensor(2, 3), np.zeros(6, dtype=np.bool_), None)
