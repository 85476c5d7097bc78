"""Tables whose columns are named by pads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.acquire.columns import Columns
from taxelflow.errors import RecordingCorrupt
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path


def sensor(folder: Path, *pads: str) -> Path:
    """Pads of 1 x 2 taxels."""
    path = folder / "sensor.toml"
    tables = [f'[[pads]]\nname = "{pad}"\nrows = 1\ncols = 2\npitch_m = [0.01, 0.01]\n' for pad in pads]
    path.write_text('name = "two"\nunit = "kPa"\n' + "".join(tables))
    return path


def table(folder: Path, *names: str) -> Path:
    path = folder / "a.csv"
    numbers = ",".join(str(number) for number in range(len(names)))
    path.write_text(f"t_s,{','.join(names)}\n0.0,{numbers}\n0.1,{numbers}\n")
    return path


def test_pads_in_another_order_than_the_sensors_are_refused(tmp_path: Path) -> None:
    path = table(tmp_path, "Right_0", "Right_1", "Left_0", "Left_1")
    own = sensor(tmp_path, "left", "right")
    with pytest.raises(
        RecordingCorrupt, match=r"column 'Right_0' stands where sensor 'two' has pad left; .*'\*left\*'"
    ):
        read(path, own)
    chosen = read(path, own, columns=Columns(taxels=("Left*", "Right*"))).load()
    np.testing.assert_array_equal(chosen.values[0], [2.0, 3.0, 0.0, 1.0])
    np.testing.assert_array_equal(read(path, own, columns=Columns(order="file")).load().values[0], range(4))


def test_columns_of_parquet_files_are_compared_too(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names = ("right0", "right1", "left0", "left1")
    parquet.write_table(arrow.table({"t_s": [0.0, 0.1]} | {name: [1.0, 2.0] for name in names}), tmp_path / "a.parquet")
    with pytest.raises(RecordingCorrupt, match="column 'right0' stands where"):
        read(tmp_path / "a.parquet", sensor(tmp_path, "left", "right"))


@pytest.mark.parametrize(
    ("pads", "names"),
    [
        (("left", "right"), ("left0", "left1", "right0", "right1")),
        (("left", "right"), ("a0", "a1", "b0", "b1")),
        (("left", "right"), ("right", "left", "x", "y")),
        (("f1", "f11"), ("f10", "f11", "f110", "f111")),
        (("tip", "tip_2"), ("tip_0", "tip_1", "tip_2_0", "tip_2_1")),
        (("up", "down"), ("group0", "group1", "group2", "group3")),
    ],
)
def test_other_names_are_read_in_their_order(tmp_path: Path, pads: tuple[str, str], names: tuple[str, ...]) -> None:
    found = read(table(tmp_path, *names), sensor(tmp_path, *pads), columns=Columns()).load()
    np.testing.assert_array_equal(found.values[0], range(4))
