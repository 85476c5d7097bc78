from __future__ import annotations

import pytest

from tabled import CURVED, GOOD, INLINE, POINTS, parse
from taxelflow.errors import SensorFileInvalid
from taxelflow.sensors.sensor import parse_sensor


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


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        ((POINTS, ""), "field rows: it is missing or 0"),
        ((POINTS, "taxels = []"), "field rows: it is missing or 0"),
        ((POINTS, f"{POINTS}\nrows = 2"), "field rows: given beside a table"),
        ((POINTS, f'{POINTS}\norder = "column-major"'), "field order and first: given beside a table"),
        ((POINTS, f'{POINTS}\norder = "spiral"'), "field order: unknown value 'spiral'"),
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
        (
            (POINTS, "taxels = [[0, 0], [4, 0], [0, 4]]"),
            "(tip), field taxels: 4 m between taxels; give it in m: 4 mm are 0.004",
        ),
        (
            (POINTS, "taxels = [[0, 0, 0, 0, 0, 1], [4, 0, 0, 0, 0, 1], [0, 4, 0, 0, 0, 1], [4, 4, 0, 0, 0, 1]]"),
            "field taxels: 4 m between taxels; give it in m",
        ),
        ((POINTS, f"{POINTS}\npitch_m = [4, 4]"), "field pitch_m: 4 m between taxels; give it in m: 4 mm are 0.004"),
        (
            (POINTS, f"{POINTS}\norigin_m = [30, 40]"),
            "field origin_m: 50 m from the hand's origin; give it in m: 40 mm are 0.04",
        ),
        (
            (POINTS, f"{POINTS}\nangle_rad = -90"),
            "field angle_rad: -90 rad; give it in rad, from -6.28 to 6.28: 90 deg are 1.571",
        ),
        (
            (POINTS, f"{POINTS}\npose = [30, 0, 40, 0, 0, 0, 1]"),
            "field pose: 50 m from the frame's origin; give x, y, z in m: 40 mm are 0.04",
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
        (('unit = "kPa"', 'unit = "kPa"\npolarity = 2'), "field polarity: unknown value 2"),
        (('unit = "kPa"', 'unit = "kPa"\naxes = 2'), "field axes: unknown value 2"),
        (('unit = "kPa"', 'unit = "kPa"\nnormal = "w"'), "field normal: unknown value 'w'"),
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
def test_each_error_of_tables_and_channels_is_named(change: tuple[str, str], seen: str | None) -> None:
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


def test_a_sensor_file_may_give_the_number_of_separate_contacts() -> None:
    text = 'name = "s"\nunit = "Pa"\n[[pads]]\nname = "a"\nrows = 2\ncols = 2\npitch_m = [0.01, 0.01]\ncontacts = '
    assert parse_sensor(f"{text}2".encode(), "s.toml").layout.pads == ("a", "a#1", "a#2")
    with pytest.raises(
        SensorFileInvalid, match=r"s\.toml: table \[\[pads\]\] number 1, field contacts: .*at most 8, got 9"
    ):
        parse_sensor(f"{text}9".encode(), "s.toml")
    group = '\n[[groups]]\nname = "a#2"\npatches = [{pad = "a"}]\n'
    with pytest.raises(SensorFileInvalid, match=r"'a#2' is used 2 times; .*a name of its own, unlike a contact's"):
        parse_sensor(f"{text}2{group}".encode(), "s.toml")
