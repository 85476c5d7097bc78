from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synthetic import grid_sensor
from taxelflow.errors import NameUnknown, ParameterInvalid, SensorFileInvalid
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor, parse_sensor, sensor_of, with_contacts

GOOD = """
name = "hand"
unit = "kPa"
[[pads]]
name = "palm"
rows = 2
cols = 3
pitch_m = [0.01, 0.012]
missing = [[0, 0]]
[[pads]]
name = "tip"
rows = 1
cols = 1
pitch_m = [0.004, 0.004]
"""


def parse(text: str) -> Sensor:
    return parse_sensor(text.encode(), "hand.toml")


def test_a_sensor_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "hand.toml"
    path.write_text(GOOD)
    sensor = load_sensor(str(path))
    assert (sensor.name, sensor.to_si, sensor.si_unit) == ("hand", 1e3, "Pa")
    assert [pad.name for pad in sensor.pads] == ["palm", "tip"]
    assert sensor.pads[0].missing == ((0, 0),)
    assert sensor.layout.taxels == 6


def test_whole_numbers_will_do_as_lengths() -> None:
    parse(GOOD.replace("[0.01, 0.012]", "[1, 1]"))


def test_counts_without_a_scale_stay_counts() -> None:
    text = GOOD.replace("kPa", "count").encode()
    sensor = parse_sensor(text, "a")
    assert (sensor.to_si, sensor.si_unit) == (1.0, "count")
    scaled = parse_sensor(b"scale_pa = 0.8\n" + text, "a")
    assert (scaled.to_si, scaled.si_unit) == (0.8, "Pa")


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (('name = "hand"', ""), "top level.*name"),
        (('unit = "kPa"', ""), "top level.*unit"),
        (('unit = "kPa"', 'unit = "bar"'), "field unit.*bar"),
        (('unit = "kPa"', 'unit = "kPa"\nscale_pa = 2.0'), "field scale_pa.*kPa"),
        (('unit = "kPa"', 'unit = "count"\nscale_pa = -2.0'), "field scale_pa"),
        (('unit = "kPa"', 'unit = "count"\nscale_pa = nan'), "field scale_pa"),
        (('unit = "kPa"', 'unit = "kPa"\nfull_scale = 0'), "field full_scale"),
        (('unit = "kPa"', 'unit = "kPa"\nfull_scale = inf'), "field full_scale"),
        (('unit = "kPa"', 'unit = "kPa"\ncolour = "red"'), "top level.*colour"),
        (("rows = 2", ""), "number 1.*rows"),
        (("rows = 2", "rows = 0"), "number 1.*field rows"),
        (("rows = 2", "rows = 2.5"), "number 1.*field rows"),
        (("rows = 2", 'rows = "two"'), "number 1.*field rows"),
        (("rows = 2", "rows = true"), "number 1.*field rows"),
        (("rows = 2", "rows = 100000"), "number 1.*field rows"),
        (("cols = 1", "cols = -1"), "number 2.*field cols"),
        (("pitch_m = [0.01, 0.012]", ""), "number 1.*pitch_m"),
        (("pitch_m = [0.01, 0.012]", "pitch_m = 0.01"), "number 1.*field pitch_m"),
        (("pitch_m = [0.01, 0.012]", "pitch_m = [0.01]"), "number 1.*field pitch_m"),
        (("pitch_m = [0.01, 0.012]", "pitch_m = [0.01, 0]"), "number 1.*field pitch_m"),
        (("pitch_m = [0.01, 0.012]", "pitch_m = [0.01, nan]"), "number 1.*field pitch_m"),
        (("pitch_m = [0.01, 0.012]", "pitch_m = [inf, 0.01]"), "number 1.*field pitch_m"),
        (("missing = [[0, 0]]", "missing = [[2, 0]]"), "number 1.*palm.*field missing.*outside"),
        (("missing = [[0, 0]]", "missing = [[0, 3]]"), "number 1.*palm.*field missing.*outside"),
        (("missing = [[0, 0]]", "missing = [[0, -1]]"), "number 1.*field missing"),
        (("missing = [[0, 0]]", "missing = [0, 0]"), "number 1.*field missing"),
        (("missing = [[0, 0]]", "missing = [[0, 0], [0, 0]]"), "number 1.*field missing.*twice"),
        (("pitch_m = [0.004, 0.004]", "pitch_m = [0.004, 0.004]\nmissing = [[0, 0]]"), "number 2.*tip.*no taxel"),
        (('name = "tip"', 'name = "palm"'), r"\[\[pads\]\].*field name.*palm"),
        (('name = "tip"', 'name = ""'), "number 2.*field name"),
        (('name = "tip"', 'name = "a,b"'), "number 2.*field name"),
        (('name = "tip"', "name = 7"), "number 2.*field name"),
        (("cols = 1", "cols = 1\ncolumns = 1"), "number 2.*columns"),
        (("[[pads]]", "[[grids]]"), "top level"),
    ],
    ids=lambda value: value[1] or f"no {value[0]}" if isinstance(value, tuple) else "",
)
def test_a_broken_sensor_file_is_named_with_table_and_field(change: tuple[str, str], where: str) -> None:
    assert change[0] in GOOD
    with pytest.raises(SensorFileInvalid, match=f"sensor file hand.toml: .*{where}") as caught:
        parse(GOOD.replace(*change))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", [b"name = ", b"\xff\xfe", b"[[pads]", b'name = "a"\nname = "b"', b"", b"pads = []"])
def test_what_is_no_toml_or_no_sensor_is_refused_in_one_line(text: bytes) -> None:
    with pytest.raises(SensorFileInvalid, match=r"sensor file hand\.toml") as caught:
        parse_sensor(text, "hand.toml")
    assert "\n" not in str(caught.value)


def test_a_sensor_without_pads_is_refused() -> None:
    with pytest.raises(SensorFileInvalid, match="pads"):
        parse_sensor(b'name = "a"\nunit = "Pa"\npads = []', "a")


TABLE = 'name = "hand"\nunit = "kPa"\n[[pads]]\nname = "tip"\ntaxels = "tip.csv"\n'
CSV = "x_mm,y_mm\n0,0\n3,0\n0,4\n"
POINTS = "taxels = [[0, 0], [0.003, 0], [0, 0.004]]"
INLINE = f'name = "hand"\nunit = "kPa"\n[[pads]]\nname = "tip"\n{POINTS}\n'


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


def test_what_a_table_says_the_sensor_file_does_not_say_again(tmp_path: Path) -> None:
    (tmp_path / "tip.csv").write_text("x_m,y_m,index\n0,0,0\n1,1,1\n")
    (tmp_path / "hand.toml").write_text(TABLE + "index = [1, 0]\n")
    with pytest.raises(
        SensorFileInvalid, match=r"index is in the table 'tip.csv' and in the sensor file; give it once"
    ):
        load_sensor(str(tmp_path / "hand.toml"))


CURVED = "taxels = [[0, 0, 0, 0, 0, 1], [0.003, 0, 0, 0, 0, 1], [0, 0.004, 0, 0, 0, 1]]"


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        ((POINTS, ""), "field rows: it is missing or 0"),
        ((POINTS, "taxels = []"), "field rows: it is missing or 0"),
        ((POINTS, f"{POINTS}\nrows = 2"), "field rows: given beside a table"),
        ((POINTS, f'{POINTS}\norder = "column-major"'), "field order and first: given beside a table"),
        ((POINTS, f'{POINTS}\norder = "spiral"'), "field order: invalid enum value 'spiral'"),
        ((POINTS, "taxels = [[0, 0], [0.003, 0, 0, 0, 0, 1]]"), "field taxels: rows have 2, 6 numbers"),
        ((POINTS, "taxels = [[0, 0], [0.003, 0], [0, 0]]"), "two taxels are closer than a thousandth of the pad"),
        ((POINTS, "taxels = [[0, 0]]"), "the pitch of a single taxel cannot be computed; give pitch_m"),
        ((POINTS, 'taxels = [[0, "a"]]'), "field taxels"),
        ((POINTS, CURVED.replace("0.004, 0, 0, 0, 1", "0.004, 0, 0, 0, 0")), "a normal is 0, 0, 0"),
        (
            (POINTS, CURVED.replace("0.004, 0, 0, 0, 1", "0.004, 0, 0, 0, 2")),
            "a normal has length 2; its length must be 1",
        ),
        (
            (POINTS, "taxels = [[0, 0], [0.003, 0], [0.003, 1e-7]]"),
            "closer than a thousandth of the pad; correct their positions",
        ),
        (
            (POINTS, "taxels = [[0, 0, 1, 0, 0, 1], [0, 0, -1, 0, 0, -1], [1, 0, 0, 1, 0, 0], [-1, 0, 0, -1, 0, 0]]"),
            "the skin is closed; split it into several pads",
        ),
        ((POINTS, f"{POINTS}\narea_m2 = [1.0, 2.0]"), "field area_m2: 2 areas for 3 taxels"),
        ((POINTS, f"{POINTS}\narea_m2 = 0"), "field area_m2"),
        ((POINTS, f"{POINTS}\nindex = [0, 1]"), "field index: 2 numbers for 3 taxels"),
        ((POINTS, f"{POINTS}\nindex = [0, 1, 1]"), "order of the source's numbers: 2 taxels read number 1 of the scan"),
        ((POINTS, f"{POINTS}\nindex = [0, 1, 3]"), "a taxel of pad tip reads number 3 of 3, counted from 0"),
        ((POINTS, f"{POINTS}\nchannels = 5"), "field channels: 5 numbers for 3 taxels; give the index"),
        ((POINTS, f"{POINTS}\npose = [0, 0, 0, 0, 0, 0, 2]"), "field pose: quaternion of length 2"),
        ((POINTS, f"{POINTS}\npose = [0, 0, 0]"), "field pose"),
        (('unit = "kPa"', 'unit = "kPa"\ngain = [1.0, 2.0]'), "field gain: 2 gains for 3 taxels"),
        (('unit = "kPa"', 'unit = "kPa"\ngain = [1.0, 2.0, 0.0]'), "field gain"),
        (('unit = "kPa"', 'unit = "kPa"\ndelay_s = [0.0]'), "field delay_s: 1 delays for 3 taxels"),
        (('unit = "kPa"', 'unit = "kPa"\npolarity = 2'), "field polarity: invalid enum value 2"),
        (('unit = "kPa"', 'unit = "kPa"\naxes = 2'), "field axes: invalid enum value 2"),
        (('unit = "kPa"', 'unit = "kPa"\nnormal = "w"'), "field normal: invalid enum value 'w'"),
        (
            ('unit = "kPa"', 'unit = "kPa"\nchannels = 2'),
            "order of the source's numbers: a taxel reads number 2 of a scan of 2",
        ),
        (('unit = "kPa"', 'unit = "N"\n'), None),
        (
            (POINTS, f'{POINTS}\narea_m2 = [1e-6, 1e-6, 2e-6]\n[[pads]]\nname="b"\n{POINTS}\nstart = 2'),
            "2 taxels read number 2",
        ),
        (
            (POINTS, f'{POINTS}\n[[groups]]\nname="g"\npatches=[{{pad="tip", rows=[0, 1]}}]'),
            "rows of tip, with a table",
        ),
        (
            (POINTS, f'{POINTS}\n[[groups]]\nname="g"\npatches=[{{pad="tip", taxels=[3]}}]'),
            "taxels of tip; list each once, between 0 and 2",
        ),
    ],
    ids=lambda value: str(value)[:60] if isinstance(value, str) else "",
)
def test_each_fault_of_tables_and_wiring_is_named(change: tuple[str, str], seen: str | None) -> None:
    text = INLINE.replace(*change)
    assert text != INLINE
    if seen is None:
        parse(text)
        return
    with pytest.raises(SensorFileInvalid) as caught:
        parse(text)
    assert seen in str(caught.value)
    assert str(caught.value).startswith("sensor file hand.toml: ")
    assert "\n" not in str(caught.value)


def test_forces_become_pressures_by_the_area_of_a_taxel() -> None:
    forces = INLINE.replace('"kPa"', '"N"')
    assert parse(forces.replace(POINTS, f"{POINTS}\narea_m2 = 4e-6")).to_si == pytest.approx(2.5e5)
    with pytest.raises(SensorFileInvalid, match="field unit: N, with taxels of 1e-06 to 2e-06 m2"):
        parse(forces.replace(POINTS, f"{POINTS}\narea_m2 = [1e-6, 1e-6, 2e-6]"))


def test_a_grid_sends_all_its_places_or_only_its_taxels() -> None:
    text = GOOD.replace("missing = [[0, 0]]", "missing = [[0, 0]]\nchannels = {}")
    assert parse(text.format(5)).channel_map.columns == 6
    assert parse(text.format(6)).channel_map.columns == 7
    with pytest.raises(
        SensorFileInvalid, match=r"number 1 \(palm\), field channels: 7 numbers for 5 taxels in 6 cells"
    ):
        parse(text.format(7))


FIELDS = (*Sensor.__struct_fields__, "colour")
PAD_FIELDS = (*Pad.__struct_fields__, "colour")
ODD = st.recursive(
    st.sampled_from(
        [0, 1, 2, 3, -1, 0.004, 1e5, 1e300, True, "", "N", "count", "tip", "z", "bottom-left", "column-major"]
    ),
    lambda inner: (
        st.lists(inner, max_size=6) | st.dictionaries(st.sampled_from(["pad", "rows", "taxels"]), inner, max_size=2)
    ),
    max_leaves=12,
)


@given(
    sensor=st.dictionaries(st.sampled_from(FIELDS), ODD, max_size=3),
    pad=st.dictionaries(st.sampled_from(PAD_FIELDS), ODD, max_size=4),
    curved=st.booleans(),
)
@settings(max_examples=300)
def test_whatever_a_sensor_file_holds_it_is_a_sensor_or_one_line(
    sensor: dict[str, Any], pad: dict[str, Any], curved: bool
) -> None:
    table = tomllib.loads(INLINE.replace(POINTS, CURVED) if curved else GOOD)
    table["pads"][0].update(pad)
    table.update(sensor)
    try:
        made = sensor_of(table, "odd.toml")
    except SensorFileInvalid as error:
        assert "\n" not in str(error)
    else:
        layout = made.layout
        assert made.channel_map.to_readings(np.zeros((1, made.channel_map.columns))).shape == (1, layout.taxels)
        assert np.isfinite(layout.x_m).all()
        assert made.to_si > 0


def test_contacts_are_asked_for_on_every_pad_or_by_name() -> None:
    hand = grid_sensor(4, 4, pads=2)
    assert with_contacts(hand, 2).layout.pads == ("pad0", "pad1", "pad0#1", "pad0#2", "pad1#1", "pad1#2")
    assert with_contacts(hand, {"pad1": 3}).layout.pads == ("pad0", "pad1", "pad1#1", "pad1#2", "pad1#3")
    assert with_contacts(hand, "2") == with_contacts(hand, 2)
    assert with_contacts(hand, " pad0=1, pad1=3 ") == with_contacts(hand, {"pad1": 3})
    assert with_contacts(with_contacts(hand, 2), 1) == hand


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (0, r"contacts must be a whole number from 1 to 8 \(got 0\)"),
        ("9", r"contacts must be a whole number from 1 to 8 \(got 9\)"),
        ("pad0=0", r"contacts must be a whole number from 1 to 8 \(got 0\)"),
        ({"pad0": 2.5}, r"contacts must be a whole number from 1 to 8 \(got 2\.5\)"),
        (True, r"contacts must be a whole number from 1 to 8 \(got True\)"),
        ("-1", r"contacts must be a number such as 2, or a number per pad as in palm=2,thumb=3 \(got '-1'\)"),
        ("pad0", r"contacts must be a number such as 2.*\(got 'pad0'\)"),
        ("pad0=2,", r"contacts must be a number such as 2.*\(got 'pad0=2,'\)"),
        ("", r"contacts must be a number such as 2.*\(got ''\)"),
        ("=2", r"contacts must be a number such as 2.*\(got '=2'\)"),
        ("pad0=two", r"contacts must be a number such as 2.*\(got 'pad0=two'\)"),
    ],
)
def test_contacts_asked_for_in_vain(asked: Any, message: str) -> None:
    with pytest.raises(ParameterInvalid, match=message):
        with_contacts(grid_sensor(4, 4), asked)


def test_contacts_of_a_pad_that_is_not_there() -> None:
    with pytest.raises(NameUnknown, match=r"unknown pad 'palm'; known are pad0, pad1"):
        with_contacts(grid_sensor(4, 4, pads=2), "palm=2")


def test_contacts_whose_name_is_taken() -> None:
    pads = (Pad("a", 2, 2, (0.01, 0.01)), Pad("a#2", 2, 2, (0.01, 0.01)))
    with pytest.raises(
        ParameterInvalid, match=r"contacts must leave the name a#2 free: rename the pad or group of that name"
    ):
        with_contacts(Sensor("hand", "Pa", pads), "a=2")


def test_a_sensor_file_may_say_how_many_contacts_are_told_apart() -> None:
    text = 'name = "s"\nunit = "Pa"\n[[pads]]\nname = "a"\nrows = 2\ncols = 2\npitch_m = [0.01, 0.01]\ncontacts = '
    assert parse_sensor(f"{text}2".encode(), "s.toml").layout.pads == ("a", "a#1", "a#2")
    with pytest.raises(SensorFileInvalid, match=r"s\.toml: table \[\[pads\]\] number 1, field contacts: .*<= 8"):
        parse_sensor(f"{text}9".encode(), "s.toml")
    group = '\n[[groups]]\nname = "a#2"\npatches = [{pad = "a"}]\n'
    with pytest.raises(SensorFileInvalid, match=r"'a#2' is used 2 times; .*a name of its own, unlike a contact's"):
        parse_sensor(f"{text}2{group}".encode(), "s.toml")


def test_entries_of_contacts_are_those_of_their_pad() -> None:
    layout = with_contacts(grid_sensor(3, 4, pads=2), {"pad1": 2}).layout
    assert layout.contact_of.tolist() == [-1, -1, 1, 1]
    assert (layout.taxels, layout.entries, layout.pad_count) == (24, 48, 2)
    pad, first = layout.of_pad(1), layout.of_pad(2)
    for name in ("source", "row", "col", "x_m", "y_m", "border", "adjacent", "delay_s", "area_m2"):
        np.testing.assert_array_equal(getattr(layout, name)[pad], getattr(layout, name)[first], err_msg=name)
    assert layout.independent.tolist() == [True, True, False, False]  # the rigid object goes by pads
