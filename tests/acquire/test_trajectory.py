from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.acquire.trajectory import read_trajectory
from taxelflow.errors import TruthInvalid

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("header", ["t_s,x_m,y_m", "t_s, x_m, y_m", "\ufefft_s,x_m,y_m"])
def test_a_trajectory_is_times_and_places(tmp_path: Path, header: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(header + "\n0,1,2\n0.5,3,4\n", encoding="utf-8")
    found = read_trajectory(path)
    np.testing.assert_array_equal(found.t_s, [0, 0.5])
    np.testing.assert_array_equal(found.place_m, [[1, 2], [3, 4]])


def test_theta_is_allowed(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t_s,x_m,y_m,theta_rad\n0,1,2,9\n1,3,4,9\n")
    np.testing.assert_array_equal(read_trajectory(path).place_m, [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("", "header"),
        ("t,x,y\n0,1,2\n", "header 't,x,y'"),
        ("t_s,x_m,y_m\n", "0 rows"),
        ("t_s,x_m,y_m\n0,1,2\n", "1 rows"),
        ("t_s,x_m,y_m\n0,1,2\n1,2\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n1,2,far\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n1,2,nan\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n0,1,3\n1,2,3\n", "row 3"),
        ("t_s,x_m,y_m\n0,1,2\n2,1,3\n1,2,3\n", "row 4"),
    ],
)
def test_what_is_no_trajectory_is_refused_in_one_line(tmp_path: Path, text: str, seen: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(TruthInvalid, match=seen) as error:
        read_trajectory(path)
    assert "\n" not in str(error.value)
