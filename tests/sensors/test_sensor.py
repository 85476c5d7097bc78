from __future__ import annotations

import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synthetic import grid_sensor
from tabled import CURVED, GOOD, INLINE, POINTS, parse
from taxelflow import Live, read, recording
from taxelflow.errors import NameUnknown, ParameterInvalid, SensorFileInvalid
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor, checked, parse_sensor, sensor_of, with_contacts


def test_a_sensor_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "hand.toml"
    path.write_text(GOOD)
    sensor = load_sensor(str(path))
    assert (sensor.name, sensor.to_si, sensor.si_unit) == ("hand", 1e3, "Pa")
    assert [pad.name for pad in sensor.pads] == ["palm", "tip"]
    assert sensor.pads[0].missing == ((0, 0),)
    assert sensor.layout.taxels == 6


def test_whole_numbers_will_do_as_lengths() -> None:
    parse(GOOD.replace("[0.01, 0.012]", "[0.01, 0.012]\norigin_m = [1, 0]"))


def test_counts_without_a_scale_stay_counts() -> None:
    text = GOOD.replace("kPa", "count").encode()
    sensor = parse_sensor(text, "a")
    assert (sensor.to_si, sensor.si_unit) == (1.0, "count")
    scaled = parse_sensor(b"scale_pa = 0.8\n" + text, "a")
    assert (scaled.to_si, scaled.si_unit) == (0.8, "Pa")


@pytest.mark.parametrize("text", [b"name = ", b"\xff\xfe", b"[[pads]", b'name = "a"\nname = "b"', b"", b"pads = []"])
def test_what_is_no_toml_or_no_sensor_is_refused_in_one_line(text: bytes) -> None:
    with pytest.raises(SensorFileInvalid, match=r"sensor file hand\.toml") as caught:
        parse_sensor(text, "hand.toml")
    assert "\n" not in str(caught.value)


def test_a_sensor_without_pads_is_refused() -> None:
    with pytest.raises(SensorFileInvalid, match="pads"):
        parse_sensor(b'name = "a"\nunit = "Pa"\npads = []', "a")


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


@pytest.mark.long
@given(
    sensor=st.dictionaries(st.sampled_from(FIELDS), ODD, max_size=3),
    pad=st.dictionaries(st.sampled_from(PAD_FIELDS), ODD, max_size=4),
    curved=st.booleans(),
)
@settings(max_examples=150)
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
        ("palm=2,palm=3", r"contacts must name each pad once \(got 'palm=2,palm=3'\)"),
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


def test_megapascals_are_a_unit() -> None:
    assert parse(GOOD.replace("kPa", "MPa")).to_si == 1e6
    assert load_sensor("grid:2x2@4mm,MPa").unit == "MPa"


def test_each_taxel_may_have_an_offset_of_its_own() -> None:
    sensor = grid_sensor(1, 3, offset=(1.0, 2.0, 3.0), polarity=-1)
    source = sensor.channel_map
    np.testing.assert_array_equal(source.to_readings(np.array([[0.0, 0.0, 0.0]])), [[1.0, 2.0, 3.0]])
    readings = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(source.to_readings(source.to_source(readings)), readings)
    with pytest.raises(SensorFileInvalid, match="field offset: 2 offsets for 6 taxels; give one per taxel, or none"):
        parse("offset = [1, 2]\n" + GOOD)
    with pytest.raises(SensorFileInvalid, match="field offset: an empty list"):
        parse("offset = []\n" + GOOD)


def test_sizes_are_checked_before_the_layout_is_computed() -> None:
    pads = "".join(f'[[pads]]\nname = "p{n}"\nrows = 100\ncols = 200\npitch_m = [1, 1]\n' for n in range(2))
    with pytest.raises(SensorFileInvalid, match="40000 taxels, and a sensor has at most 32768"):
        parse('name = "s"\nunit = "Pa"\n' + pads)
    groups = "".join(f'[[groups]]\nname = "g{n}"\npatches = [{{pad = "p0"}}]\n' for n in range(59))
    with pytest.raises(SensorFileInvalid, match=r"tables \[\[groups\]\]: 1200000 taxels of pads, groups and contacts"):
        parse('name = "s"\nunit = "Pa"\n' + pads[: len(pads) // 2] + groups)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"unit": "mPa"}, "field unit: unknown value 'mPa'"),
        ({"gain": (1.0,)}, "field gain: 1 gains for 6 taxels"),
        ({"pads": (Pad("pad", 2, 3),)}, "field pitch_m: it is missing"),
        ({"pads": (Pad("pad", 2, 3, (4.0, 4.0)),)}, "4 m between taxels"),
        ({"note": object()}, "a value is of type object"),
    ],
)
def test_a_sensor_made_in_python_is_checked_as_a_file_is(tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    given = msgspec.structs.replace(grid_sensor(2, 3), **changed)
    path = tmp_path / "scans.csv"
    path.write_text("t_s,a,b,c,d,e,f\n0,0,0,0,0,0,0\n")
    for use in (Live, partial(recording, np.arange(2.0), np.zeros((2, 6))), partial(read, path)):
        with pytest.raises(SensorFileInvalid, match=message):
            use(given)


def test_lists_and_arrays_in_a_sensor_made_in_python_become_tuples() -> None:
    places = np.array([[0.0, 0.0], [0.004, 0.0], [0.0, 0.004]])
    given = Sensor("made", "kPa", [Pad("pad", taxels=places)], gain=np.ones(3))  # type: ignore[arg-type]
    assert checked(given).pads[0].taxels == ((0.0, 0.0), (0.004, 0.0), (0.0, 0.004))
    assert checked(given).gain == (1.0, 1.0, 1.0)
