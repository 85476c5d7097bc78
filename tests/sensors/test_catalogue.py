from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taxelflow.errors import GridNameInvalid, NameUnknown, PitchNeeded, SensorFileInvalid
from taxelflow.sensors.catalogue import builtin_sensors, catalogue, load_sensor


def test_the_papers_hand_has_its_162_taxels() -> None:
    sensor = load_sensor("barretthand-162")
    layout = sensor.layout
    assert layout.taxels == 162
    assert [int(count) for count in np.diff(layout.starts)[: layout.pad_count]] == [22, 24] * 3 + [24]
    assert (sensor.unit, layout.pads[layout.pad_count - 1]) == ("kPa", "palm")


def test_the_papers_palm_is_grouped_as_in_the_paper() -> None:
    layout = load_sensor("barretthand-162").layout
    assert layout.pads[layout.pad_count :] == ("palm_left", "palm_centre", "palm_right")
    members = [layout.source[layout.of_pad(pad)] for pad in range(7, 10)]
    assert [len(own) for own in members] == [10, 4, 10]  # 4x3 without two corners, 4x1, 4x3 without two corners
    assert sorted(np.concatenate(members)) == list(range(138, 162))


def test_the_papers_palm_is_numbered_as_in_the_paper() -> None:
    layout = load_sensor("barretthand-162").layout
    own = layout.of_pad(6)
    assert (own.start, own.stop) == (138, 162)
    numbers = layout.grid(6, np.arange(162.0))
    rows = [row[np.isfinite(row)].tolist() for row in numbers]
    assert [len(row) for row in rows] == [5, 7, 7, 5]
    assert rows[1] == list(range(143, 150))


def test_the_assumed_layout_of_the_tips_is_marked() -> None:
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
    for name, sensor in catalogue():
        loaded = load_sensor(name.replace("PITCH", "1"))
        assert loaded == sensor
        assert loaded.name == name.replace("@PITCHmm", "@1mm")
        assert sum(pad.count for pad in sensor.pads) == loaded.layout.taxels


def test_an_unknown_sensor_comes_with_the_list() -> None:
    known = r"known are barretthand-162, .*schunk-sdh2, .*grid:16x16@4mm, or the path"
    with pytest.raises(NameUnknown, match=rf"'barrett'; did you mean 'barretthand-162'\? {known}"):
        load_sensor("barrett")


def test_a_path_without_a_file_is_not_called_a_name(tmp_path: Path) -> None:
    remedy = "give the path of a TOML file, or a name of `taxelflow sensors`"
    for name in ("nothere.toml", "folder/hand"):
        with pytest.raises(SensorFileInvalid, match=f"^sensor file {name}: path: there is no such file; {remedy}$"):
            load_sensor(name)
    with pytest.raises(SensorFileInvalid, match="path: it is no regular file"):
        load_sensor(str(tmp_path))


def test_every_built_in_sensor_names_its_source() -> None:
    assert all(sensor.note for _, sensor in catalogue())


@pytest.mark.parametrize(
    ("name", "pads", "taxels", "columns"),
    [
        ("barretthand-bh280-96", 4, 96, 96),
        ("icub-fingertip-12", 1, 12, 12),
        ("icub-fingertips-60", 5, 60, 60),
        ("icub-forearm", 24, 240, 384),
        ("xela-4x4@4.7mm", 1, 16, 48),
        ("inspire-rh56dftp@3.0mm", 17, 1062, 1062),
    ],
)
def test_built_in_sensors_have_the_taxels_of_their_makers(name: str, pads: int, taxels: int, columns: int) -> None:
    sensor = load_sensor(name)
    assert (len(sensor.pads), sensor.layout.taxels, sensor.channel_map.columns) == (pads, taxels, columns)


def test_the_bh280_reads_its_palm_from_the_right() -> None:
    sensor = load_sensor("barretthand-bh280-96")
    layout = sensor.layout
    palm = layout.of_pad(3)
    first = int(np.argmin(sensor.channel_map.column[palm]))
    assert sensor.channel_map.column[palm][first] == 72
    np.testing.assert_allclose([layout.x_m[palm][first], layout.y_m[palm][first]], [0.022, 0.0159])
    assert layout.area_m2[palm] == pytest.approx(9.7e-5)
    assert sensor.to_si == 1e4


def test_the_bh280s_fingers_are_unrolled_towards_the_tip() -> None:
    layout = load_sensor("barretthand-bh280-96").layout
    own = layout.of_pad(0)
    x, y = layout.x_m[own].reshape(8, 3), layout.y_m[own].reshape(8, 3)
    assert (np.diff(x, axis=0) > 0).all()
    np.testing.assert_allclose(y, np.tile([0.0052, 0, -0.0052], (8, 1)), atol=2e-5)
    np.testing.assert_allclose(np.diff(x[:5, 0]), 0.006, rtol=5e-3)  # on the flat part they are 6 mm apart
    assert layout.stretch[0] < 0.01


def test_an_icub_fingertip_counts_down_from_255() -> None:
    sensor = load_sensor("icub-fingertip-12")
    np.testing.assert_array_equal(sensor.channel_map.to_readings(np.full((1, 12), 245.0)), 10.0)


def test_the_forearm_reads_no_temperatures_and_lies_on_its_arm() -> None:
    sensor = load_sensor("icub-forearm")
    layout = sensor.layout
    assert not set(sensor.channel_map.column % 12) & {6, 10}
    np.testing.assert_allclose(np.linalg.norm(layout.normal, axis=1), 1.0, atol=1e-6)
    middle = layout.place_m.mean(axis=0)
    outwards = np.sum((layout.place_m - middle)[:, [0, 2]] * layout.normal[:, [0, 2]], axis=1)
    assert (outwards > 0).all()


def test_inspires_palm_runs_up_its_columns() -> None:
    sensor = load_sensor("inspire-rh56dftp@3.0mm")
    raw = np.arange(1062.0)
    palm = sensor.layout.grid(16, sensor.channel_map.to_readings(raw[np.newaxis])[0])
    np.testing.assert_array_equal(palm, raw[950:].reshape(14, 8).T[::-1])
    assert sensor.layout.pitch_m[16].tolist() == [0.003, 0.003]


@pytest.mark.parametrize("name", ["inspire-rh56dftp", "xela-4x4", "xela-4x4@", "xela-4x4@4.7", "xela-4x4@mm"])
def test_a_pitch_that_is_not_published_is_asked_for(name: str) -> None:
    stem = name.partition("@")[0]
    with pytest.raises(
        PitchNeeded, match=rf"sensor {stem}: .*add it to the name, as in {stem}@3.0mm or {stem}@3x2.5mm"
    ):
        load_sensor(name)


def test_a_pitch_may_differ_by_axis() -> None:
    np.testing.assert_allclose(load_sensor("xela-4x4@4.7x4.5mm").layout.pitch_m, [[0.0047, 0.0045]])


def test_a_pitch_that_is_known_is_not_asked_for() -> None:
    with pytest.raises(NameUnknown, match="whose pitch is known"):
        load_sensor("schunk-sdh2@3mm")


def test_a_plain_grid_is_named_by_rows_cols_and_pitch() -> None:
    sensor = load_sensor("grid:4x7@10x10.6mm")
    assert (sensor.layout.shapes, sensor.unit) == (((4, 7),), "count")
    np.testing.assert_allclose(sensor.layout.pitch_m, [[0.01, 0.0106]])
    assert load_sensor("grid:16x16@4mm,N/cm2").unit == "N/cm2"


@pytest.mark.parametrize(
    "name", ["grid:", "grid:16x16", "grid:16@4mm", "grid:16x16@4", "grid:axb@4mm", "grid:2x2@-4mm"]
)
def test_an_invalid_grid_is_refused_with_the_form(name: str) -> None:
    with pytest.raises(GridNameInvalid, match=r"as in grid:16x16@4mm or grid:4x7@10x10.6mm, and a unit"):
        load_sensor(name)


@pytest.mark.parametrize("name", ["grid:0x4@4mm", "grid:9999x4@4mm", "grid:2x2@0mm", "grid:2x2@4mm,bar"])
def test_a_grid_out_of_bounds_is_refused_like_a_file(name: str) -> None:
    with pytest.raises(SensorFileInvalid, match="sensor file grid:"):
        load_sensor(name)
