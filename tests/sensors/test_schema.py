from __future__ import annotations

import pytest

from tabled import GOOD, INLINE, POINTS, parse
from taxelflow.errors import SensorFileInvalid

NEEDS = "; a sensor has name, unit (Pa, kPa, MPa, psi, N/cm2, N or count) and [[pads]] with name and either rows"
ROWS = "; give all rows as [x, y], or all as [x, y, z, nx, ny, nz], in m"
PAD = "table [[pads]] number 1"


def refused(text: str) -> str:
    """The message for a sensor file, without the file's name."""
    with pytest.raises(SensorFileInvalid) as caught:
        parse(text)
    return str(caught.value).removeprefix("sensor file hand.toml: ")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("polarity = 2", "top level, field polarity: unknown value 2; known are -1, 1"),
        ('polarity = "up"', "top level, field polarity: expected a whole number, got text ('up'); known are -1, 1"),
        ('normal = "w"', "top level, field normal: unknown value 'w'; known are 'x', 'y', 'z'"),
        ("axes = 2", "top level, field axes: unknown value 2; known are 1, 3"),
        (
            'shear = ["x", "w"]',
            "top level, field shear[1]: unknown value 'w'; known are '-x', '-y', '-z', 'x', 'y', 'z'",
        ),
    ],
)
def test_an_unknown_value_comes_with_those_that_are_known(line: str, says: str) -> None:
    assert refused(INLINE.replace('unit = "kPa"', f'unit = "kPa"\n{line}')) == says


def test_an_unknown_value_comes_with_the_nearest_one() -> None:
    for field, value, near in (("order", "colum-major", "column-major"), ("first", "top_left", "top-left")):
        says = refused(GOOD.replace("rows = 2", f'rows = 2\n{field} = "{value}"'))
        assert says.startswith(f"{PAD}, field {field}: unknown value '{value}'; did you mean '{near}'? known are '")
    says = refused(GOOD.replace('"kPa"', '"kpa"'))
    assert says.startswith("top level, field unit: unknown value 'kpa'; did you mean 'kPa'? known are 'MPa', 'N',")


def test_an_unknown_unit_comes_with_that_of_other_numbers() -> None:
    assert "'psi'; use count for volts" in refused(GOOD.replace('"kPa"', '"V"'))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            ("rows = 2", "rows = 2\ncolums = 3"),
            f"{PAD}: unknown field 'colums'; did you mean 'cols'? known are name, rows,",
        ),
        (('unit = "kPa"', 'unit = "kPa"\nzzz = 1'), "top level: unknown field 'zzz'; known are name, unit, pads,"),
        (
            ('unit = "kPa"', 'unit = "kPa"\nhand = {joint = 1}'),
            "table [hand]: unknown field 'joint'; did you mean 'joints'? known are urdf, base, joints,",
        ),
        (
            ('unit = "kPa"', 'unit = "kPa"\ngroups = [{name = "g", patches = [{pad = "tip", row = 1}]}]'),
            "table [[groups]] number 1, field patches[0]: unknown field 'row'; did you mean 'rows'? known are pad,",
        ),
    ],
    ids=["pad", "sensor", "hand", "patch"],
)
def test_an_unknown_field_comes_with_those_of_its_table(change: tuple[str, str], says: str) -> None:
    assert refused(GOOD.replace(*change)).startswith(says)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("pitch_m = 0.01", f"pitch_m: expected a list, got a number (0.01){NEEDS}"),
        ("pitch_m = [0.01]", f"pitch_m: expected a list of length 2, got length 1{NEEDS}"),
        ("pitch_m = [0.01, nan]", f"pitch_m[1]: expected a number above 0, got nan{NEEDS}"),
        ("pitch_m = {x = 0.01}", f"pitch_m: expected a list, got a table{NEEDS}"),
        ("contacts = 9", "contacts: expected a whole number of at most 8, got 9; give such a value"),
        ("area_m2 = 'wide'", "area_m2: expected a number or a list, got text ('wide'); give such a value"),
        ("angle_rad = inf", "angle_rad: expected a number below 1000000, got inf; give such a value"),
        ("link = ''", "link: expected text of length at least 1, got ''; give such a value"),
    ],
)
def test_types_and_limits_are_in_words(line: str, says: str) -> None:
    field = line.partition(" ")[0]
    text = (
        GOOD.replace("pitch_m = [0.01, 0.012]", line)
        if field == "pitch_m"
        else GOOD.replace("rows = 2", f"rows = 2\n{line}")
    )
    assert refused(text).startswith(f"{PAD}, field {says}")


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ("[[0, 0], [nan, 0]]", "[1][0]: expected a number above -1000000, got nan"),
        ("[[0, inf], [1, 0]]", "[0][1]: expected a number below 1000000, got inf"),
        ("[[0, 0], [0, -2e6]]", "[1][1]: expected a number above -1000000, got -2000000.0"),
        ("[0, 1]", "[0]: expected a list, got a whole number (0)"),
    ],
)
def test_a_place_that_is_none_is_named_with_its_taxel(points: str, says: str) -> None:
    assert refused(INLINE.replace(POINTS, f"taxels = {points}")) == f"{PAD}, field taxels{says}{ROWS}"


def test_a_frames_header_is_hexadecimal() -> None:
    says = refused(INLINE.replace('unit = "kPa"', 'unit = "kPa"\nframe = {header = "AA5"}'))
    assert "table [frame], field header: expected 1 to 8 bytes, each as two hexadecimal digits, such as" in says


def test_a_long_value_is_cut() -> None:
    says = refused(INLINE.replace('unit = "kPa"', f'unit = "{"k" * 500}"'))
    assert len(says.partition(";")[0]) < 100
