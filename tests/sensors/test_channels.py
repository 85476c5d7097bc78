from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import grid_sensor, recorded
from taxelflow.errors import SensorFileInvalid, TaxelCountWrong
from taxelflow.messages import RawScans
from taxelflow.pipeline.api import read
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor, sensor_of
from taxelflow.simulation.parameters import Motion
from taxelflow.simulation.scenario import Scenario
from taxelflow.simulation.simulate import save


def seen(raw: Any, rows: int, cols: int, **fields: Any) -> Any:
    """A source's numbers of one grid as its picture."""
    sensor = Sensor(name="a", unit="Pa", pads=(Pad(name="a", rows=rows, cols=cols, pitch_m=(1, 1), **fields),))
    return sensor.layout.grid(0, sensor.channel_map.to_readings(np.asarray(raw, dtype=float)[np.newaxis])[0]).tolist()


@pytest.mark.parametrize(
    ("order", "first", "picture"),
    [
        ("row-major", "top-left", [[0, 1, 2], [3, 4, 5]]),
        ("row-major", "top-right", [[2, 1, 0], [5, 4, 3]]),
        ("row-major", "bottom-left", [[3, 4, 5], [0, 1, 2]]),
        ("row-major", "bottom-right", [[5, 4, 3], [2, 1, 0]]),
        ("column-major", "top-left", [[0, 2, 4], [1, 3, 5]]),
        ("column-major", "top-right", [[4, 2, 0], [5, 3, 1]]),
        ("column-major", "bottom-left", [[1, 3, 5], [0, 2, 4]]),
        ("column-major", "bottom-right", [[5, 3, 1], [4, 2, 0]]),
    ],
)
def test_a_grid_is_read_from_any_corner_along_rows_or_columns(order: str, first: str, picture: list[list[int]]) -> None:
    assert seen(range(6), 2, 3, order=order, first=first) == picture


def test_missing_places_are_sent_or_not() -> None:
    nan = pytest.approx(np.nan, nan_ok=True)
    assert seen(range(5), 2, 3, missing=((0, 1),), first="bottom-left") == [[3, nan, 4], [0, 1, 2]]
    assert seen(range(6), 2, 3, missing=((0, 1),), first="bottom-left", channels=6) == [[3, nan, 5], [0, 1, 2]]


def test_several_sensors_stand_in_one_stream() -> None:
    wide = Pad(name="wide", rows=1, cols=3, pitch_m=(1, 1))
    tip = Pad(name="tip", taxels=((0.0, 0.0), (1.0, 0.0)), index=(3, 1), channels=4, start=5)
    channel_map = Sensor(name="a", unit="Pa", pads=(wide, tip), channels=12).channel_map
    assert channel_map.columns == 12
    np.testing.assert_array_equal(channel_map.to_readings(np.arange(12.0)[np.newaxis]), [[0, 1, 2, 8, 6]])


def test_the_normal_axis_is_chosen_of_three() -> None:
    raw = np.arange(12.0)[np.newaxis]
    for normal, first in (("x", 0), ("y", 1), ("z", 2)):
        sensor = grid_sensor(2, 2, axes=3, normal=normal)
        np.testing.assert_array_equal(sensor.channel_map.to_readings(raw), [np.arange(4) * 3 + first])


def test_polarity_offset_and_gain_make_load_positive() -> None:
    channel_map = grid_sensor(1, 2, offset=255.0, polarity=-1, gain=(1.0, 2.0)).channel_map
    np.testing.assert_array_equal(
        channel_map.to_readings(np.array([[255.0, 255.0], [205.0, 205.0]])), [[0, 0], [50, 100]]
    )


@given(
    rows=st.integers(1, 5),
    cols=st.integers(1, 5),
    order=st.sampled_from(["row-major", "column-major"]),
    first=st.sampled_from(["top-left", "top-right", "bottom-left", "bottom-right"]),
    axes=st.sampled_from([1, 3]),
    polarity=st.sampled_from([1, -1]),
)
def test_what_is_sent_is_read_back(rows: int, cols: int, order: Any, first: Any, axes: Any, polarity: Any) -> None:
    pad = Pad(name="a", rows=rows, cols=cols, pitch_m=(1, 1), order=order, first=first)
    gain = tuple(np.linspace(0.5, 2.0, rows * cols))
    channel_map = Sensor(
        name="a", unit="Pa", pads=(pad,), axes=axes, polarity=polarity, offset=7.0, gain=gain
    ).channel_map
    readings = np.random.default_rng(0).normal(0, 10, (3, rows * cols))
    sent = channel_map.to_source(readings)
    assert sent.shape == (3, rows * cols * axes)
    np.testing.assert_allclose(channel_map.to_readings(sent), readings, atol=1e-12)


def test_a_plain_source_is_passed_on_untouched() -> None:
    values = np.ones((2, 4))
    assert grid_sensor(2, 2).channel_map.to_readings(values) is values


def test_a_recording_gives_readings_and_counts_the_numbers_that_its_source_sends() -> None:
    sensor = grid_sensor(1, 2, axes=3, offset=100.0)
    raw = recorded(np.full((3, 6), 101.0), sensor).load()
    np.testing.assert_array_equal(raw.values, 1.0)
    with pytest.raises(TaxelCountWrong, match="has 2 taxels per scan but sensor 'grid' has 6"):
        recorded(np.ones((3, 2)), sensor).load()


@pytest.mark.parametrize("sentinel", [1e300, -1e300, 3.4e38, 1.7e308])
@pytest.mark.parametrize("fields", [{}, {"offset": 5.0, "gain": (1.0, 1e9)}], ids=["identity", "gain"])
def test_a_number_beyond_any_sensors_is_missing(sentinel: float, fields: dict[str, Any]) -> None:
    sensor = grid_sensor(1, 2, **fields)
    sent = np.array([[7.0, 8.0], [sentinel, 8.0], [7.0, 1e12]])
    values = recorded(sent, sensor).load().values
    assert np.isnan(values).tolist() == [[False, False], [True, False], [False, False]]
    assert np.array_equal(sent[1], [sentinel, 8.0])  # the source's own array


def test_shear_beyond_any_sensors_is_missing() -> None:
    channel_map = grid_sensor(1, 1, axes=3, shear=("x", "-y")).channel_map
    raw = channel_map.of_source(RawScans(np.zeros(1), np.array([[1e300, 2.0, 3.0]])))
    assert raw.shear is not None
    np.testing.assert_array_equal(raw.shear, [[[np.nan, -2.0]]])
    np.testing.assert_array_equal(raw.values, [[3.0]])


def test_what_the_source_sent_is_kept_for_files() -> None:
    sensor = grid_sensor(1, 2, axes=3, offset=100.0)
    sent = np.arange(18.0).reshape(3, 6)
    (block,) = recorded(sent, sensor).source_blocks()
    np.testing.assert_array_equal(block.values, sent)


def test_a_simulated_recording_of_a_sensor_with_a_channel_map_is_read_back(tmp_path: Path) -> None:
    scenario = Scenario(sensor="icub-fingertip-12", pad="fingertip", motion=Motion(travel_m=0.01, strokes=1))
    made = save(scenario, tmp_path / "tip.npz").load()
    again = read(tmp_path / "tip.npz")
    np.testing.assert_allclose(again.load().values, made.values, atol=1e-9)
    assert next(again.source_blocks()).values.max() <= 256


@given(
    normal=st.sampled_from("xyz"),
    swapped=st.booleans(),
    signs=st.tuples(st.sampled_from(["", "-"]), st.sampled_from(["", "-"])),
    gain=st.floats(0.1, 10),
)
def test_shear_that_is_sent_is_read_back(normal: Any, swapped: bool, signs: tuple[str, str], gain: float) -> None:
    first, second = [axis for axis in "xyz" if axis != normal][:: -1 if swapped else 1]
    shear: Any = (signs[0] + first, signs[1] + second)
    channel_map = grid_sensor(2, 3, axes=3, normal=normal, shear=shear, shear_gain=gain, offset=7.0).channel_map
    random = np.random.default_rng(0)
    readings, along = random.normal(0, 10, (4, 6)), random.normal(0, 10, (4, 6, 2))
    raw = channel_map.of_source(RawScans(np.arange(4.0), channel_map.to_source(readings, along)))
    assert raw.shear is not None
    np.testing.assert_allclose(raw.shear, along, atol=1e-12)
    np.testing.assert_allclose(raw.values, readings, atol=1e-12)
    sent = channel_map.to_source(np.zeros((1, 6)), np.eye(2)[np.newaxis, [0] * 6])[0].reshape(6, 3)
    assert (sent[:, "xyz".index(first)] * (-1 if signs[0] else 1) > 0).all()  # a pull to the right is along the first


@pytest.mark.parametrize(
    "fields",
    [{"axes": 1}, {"axes": 3, "normal": "x"}, {"axes": 3, "shear": ["x", "x"]}, {"axes": 3, "shear": ["x", "z"]}],
)
def test_shear_axes_that_do_not_lie_in_the_skin_are_refused(fields: dict[str, Any]) -> None:
    pads = [{"name": "a", "rows": 2, "cols": 2, "pitch_m": [1e-3, 1e-3]}]
    with pytest.raises(SensorFileInvalid, match="field shear"):
        sensor_of({"name": "a", "unit": "Pa", "pads": pads, "shear": ["x", "-y"], **fields}, "a.toml")
