from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from tabled import parse
from taxelflow.errors import SensorFileInvalid
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.sensor import sensor_of

TABLE = 'name = "hand"\nunit = "kPa"\n[[pads]]\nname = "tip"\ntaxels = "tip.csv"\n'


CSV = "x_mm,y_mm\n0,0\n3,0\n0,4\n"


def test_a_table_may_stand_in_a_csv_file_beside_the_sensor_file(tmp_path: Path) -> None:
    (tmp_path / "tip.csv").write_text("index,area_mm2,x_mm,y_mm\n2,1,0,0\n0,2,3,0\n1,3,0,4\n")
    (tmp_path / "hand.toml").write_text(TABLE)
    sensor = load_sensor(str(tmp_path / "hand.toml"))
    assert sensor.pads[0].taxels == ((0.0, 0.0), (0.003, 0.0), (0.0, 0.004))
    np.testing.assert_allclose(sensor.layout.area_m2, [1e-6, 2e-6, 3e-6])
    np.testing.assert_array_equal(sensor.channel_map.to_readings(np.array([[10.0, 20.0, 30.0]])), [[30, 10, 20]])


def test_a_sensor_with_a_table_is_whole_without_its_file(tmp_path: Path) -> None:
    (tmp_path / "tip.csv").write_text(CSV)
    (tmp_path / "hand.toml").write_text(TABLE)
    sensor = load_sensor(str(tmp_path / "hand.toml"))
    again = sensor_of(msgspec.json.decode(msgspec.json.encode(sensor)), "recording")
    assert again == sensor
    assert again.layout is sensor.layout


@pytest.mark.parametrize(
    ("table", "seen"),
    [
        ("", "the columns are missing"),
        ("x_m,y_m\n", "no rows"),
        ("x_m,z_m\n1,2\n", "the columns are x_m,z_m"),
        ("x_m,y_m,x_mm\n1,2,3\n", "the columns are x_m,y_m,x_mm"),
        ("x_m,y_m,colour\n1,2,3\n", "unknown column 'colour'"),
        ("x_m,y_m\n1,2,3\n", "row 1 has 3 fields, the header 2"),
        ("x_m,y_m\n1,2\n1,two\n", "row 2, column y_m: 'two' is not a number"),
        ("x_m,y_m\n1,nan\n", "row 1, column y_m: nan is out of range"),
        ("x_m,y_m,index\n1,2,0.5\n", "row 1, column index: 0.5 is out of range"),
        ("x_m,y_m,area_m2\n1,2,0\n", "row 1, column area_m2: 0 is not an area above 0"),
        ("x_m,y_m,z_m\n0,0,0\n1,1,1\n", "rows have 3 numbers, a position without a normal"),
    ],
)
def test_a_broken_table_is_named_with_row_and_column(tmp_path: Path, table: str, seen: str) -> None:
    (tmp_path / "tip.csv").write_text(table)
    (tmp_path / "hand.toml").write_text(TABLE)
    with pytest.raises(
        SensorFileInvalid, match=r"hand\.toml: table \[\[pads\]\] number 1 \(tip\), field taxels: "
    ) as caught:
        load_sensor(str(tmp_path / "hand.toml"))
    assert seen in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_table_that_is_missing_or_no_text_is_named(tmp_path: Path) -> None:
    (tmp_path / "hand.toml").write_text(TABLE)
    with pytest.raises(SensorFileInvalid, match=r"the table 'tip.csv' cannot be read \(No such file"):
        load_sensor(str(tmp_path / "hand.toml"))
    (tmp_path / "tip.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(SensorFileInvalid, match=r"the table 'tip.csv' cannot be read"):
        load_sensor(str(tmp_path / "hand.toml"))
    with pytest.raises(SensorFileInvalid, match="give the rows themselves"):
        parse(TABLE)


def test_what_a_table_holds_the_sensor_file_does_not_repeat(tmp_path: Path) -> None:
    (tmp_path / "tip.csv").write_text("x_m,y_m,index\n0,0,0\n1,1,1\n")
    (tmp_path / "hand.toml").write_text(TABLE + "index = [1, 0]\n")
    with pytest.raises(
        SensorFileInvalid, match=r"index is in the table 'tip.csv' and in the sensor file; give it once"
    ):
        load_sensor(str(tmp_path / "hand.toml"))
