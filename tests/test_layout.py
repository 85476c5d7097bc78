from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor
from taxelflow.catalogue import builtin_sensors, load_sensor
from taxelflow.errors import NameUnknown, SensorFileInvalid
from taxelflow.sensor import parse_sensor

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


def parse(text: str) -> object:
    return parse_sensor(text.encode(), "hand.toml")


def test_the_papers_hand_has_its_162_taxels() -> None:
    sensor = load_sensor("barretthand-162")
    layout = sensor.layout
    assert layout.taxels == 162
    assert [int(count) for count in np.diff(layout.starts)[: layout.pad_count]] == [22, 24] * 3 + [24]
    assert (sensor.unit, layout.pads[layout.pad_count - 1]) == ("kPa", "palm")


def test_the_papers_palm_is_grouped_as_the_paper_says() -> None:
    layout = load_sensor("barretthand-162").layout
    assert layout.pads[layout.pad_count :] == ("palm_left", "palm_centre", "palm_right")
    members = [layout.source[layout.of_pad(pad)] for pad in range(7, 10)]
    assert [len(own) for own in members] == [10, 4, 10]  # 4x3 without two corners, 4x1, 4x3 without two corners
    assert sorted(np.concatenate(members)) == list(range(138, 162))


def test_the_papers_palm_is_numbered_as_the_paper_says() -> None:
    layout = load_sensor("barretthand-162").layout
    own = layout.of_pad(6)
    assert (own.start, own.stop) == (138, 162)
    numbers = layout.grid(6, np.arange(162.0))
    rows = [row[np.isfinite(row)].tolist() for row in numbers]
    assert [len(row) for row in rows] == [5, 7, 7, 5]
    assert rows[1] == list(range(143, 150))


def test_the_assumed_layout_of_the_tips_says_so() -> None:
    sensor = load_sensor("barretthand-162")
    tips = [pad for pad in sensor.pads if pad.name.endswith("_tip")]
    assert len(tips) == 3
    assert all("assumption" in pad.note for pad in tips)


def test_the_sdh2_has_456_live_taxels_in_six_pads() -> None:
    sensor = load_sensor("schunk-sdh2")
    assert sensor.layout.taxels == 456
    assert sensor.layout.shapes == ((14, 6), (13, 6)) * 3
    assert sensor.to_si == pytest.approx(0.000473e6 / 592.1, rel=1e-4)


def test_every_built_in_sensor_loads_under_its_own_name() -> None:
    assert {"barretthand-162", "grid-16x16", "schunk-sdh2"} <= set(builtin_sensors())
    for name in builtin_sensors():
        assert load_sensor(name).name == name


def test_x_points_right_along_columns_and_y_up_against_rows() -> None:
    layout = grid_sensor(3, 4, pitch_m=(0.01, 0.02)).layout
    np.testing.assert_allclose(layout.x_m[:4], [-0.015, -0.005, 0.005, 0.015])
    np.testing.assert_allclose(layout.y_m[[0, 4, 8]], [0.02, 0, -0.02])


@given(rows=st.integers(1, 12), cols=st.integers(1, 12))
def test_the_origin_is_the_pads_centre(rows: int, cols: int) -> None:
    layout = grid_sensor(rows, cols).layout
    assert layout.x_m.mean() == pytest.approx(0, abs=1e-15)
    assert layout.y_m.mean() == pytest.approx(0, abs=1e-15)


def test_a_missing_taxel_moves_no_other() -> None:
    whole, holed = grid_sensor(2, 3).layout, grid_sensor(2, 3, missing=((0, 1), (1, 2))).layout
    np.testing.assert_array_equal(holed.x_m, np.delete(whole.x_m, [1, 5]))
    np.testing.assert_array_equal(holed.y_m, np.delete(whole.y_m, [1, 5]))
    assert holed.taxels == 4


def test_a_scan_becomes_a_picture_with_row_0_on_top() -> None:
    layout = grid_sensor(2, 3, pads=2, missing=((0, 1),)).layout
    picture = layout.grid(1, np.arange(10.0))
    np.testing.assert_array_equal(picture, [[5, np.nan, 6], [7, 8, 9]])
    assert layout.grid(1, np.arange(10.0), fill=0.0)[0, 1] == 0


def test_a_border_is_where_a_neighbour_lacks() -> None:
    border = grid_sensor(3, 4).layout.border.reshape(3, 4, 2)
    assert border[..., 0].tolist() == [[True, False, False, True]] * 3
    assert border[..., 1].tolist() == [[True] * 4, [False] * 4, [True] * 4]


def test_a_hole_in_the_grid_is_a_border_for_its_neighbours() -> None:
    layout = grid_sensor(3, 3, missing=((1, 1),)).layout
    border = dict(zip(zip(layout.row.tolist(), layout.col.tolist(), strict=True), layout.border.tolist(), strict=True))
    assert border[1, 0] == [True, False]
    assert border[0, 1] == [False, True]


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


def test_an_unknown_sensor_comes_with_the_list() -> None:
    with pytest.raises(
        NameUnknown, match=r"'barrett'; known are barretthand-162, .*schunk-sdh2, .*grid:16x16@4mm, or the path"
    ):
        load_sensor("barrett")


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


def test_a_layout_is_computed_once() -> None:
    assert grid_sensor(3, 3).layout is grid_sensor(3, 3).layout


def test_a_folder_is_no_sensor(tmp_path: Path) -> None:
    with pytest.raises(NameUnknown):
        load_sensor(str(tmp_path))
