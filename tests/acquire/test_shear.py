"""Shear from every reader to the same arrays, and back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sheared import sheared
from synthetic import grid_sensor
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.xela import XelaParser
from taxelflow.cli import main
from taxelflow.errors import RecordingCorrupt, SensorFileInvalid, TimesNotIncreasing
from taxelflow.messages import cut, joined
from taxelflow.pipeline import api
from taxelflow.pipeline.live.api import Live
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

THREE = grid_sensor(2, 3, axes=3, shear=("x", "-y"), offset=100.0, polarity=-1, shear_gain=2.0)
XELA = "xela-4x4@4.7mm"
READINGS = np.random.default_rng(0).normal(0, 10, (8, 6))
SHEAR = np.random.default_rng(1).normal(0, 10, (8, 6, 2))
TIMES = np.arange(8) / 10


def made() -> Recording:
    return api.recording(TIMES, READINGS, THREE, shear=SHEAR)


def shear_of(recording: Recording) -> Floats:
    shear = recording.load().shear
    assert shear is not None
    return shear


def test_arrays_give_the_shear_that_they_were_given() -> None:
    np.testing.assert_allclose(shear_of(made()), SHEAR, atol=1e-12)
    np.testing.assert_allclose(made().load().values, READINGS, atol=1e-12)
    picture = api.recording(TIMES, READINGS.reshape(8, 2, 3), THREE, shear=SHEAR.reshape(8, 2, 3, 2))
    np.testing.assert_allclose(shear_of(picture), SHEAR, atol=1e-12)


def test_a_sensor_of_one_axis_gets_three() -> None:
    recording = api.recording(TIMES, READINGS, "grid:2x3@4mm,kPa", shear=SHEAR)
    assert (recording.sensor.axes, recording.sensor.shear) == (3, ("x", "y"))
    np.testing.assert_array_equal(shear_of(recording), SHEAR)
    assert api.recording(TIMES, READINGS, "grid:2x3@4mm,kPa").load().shear is None


@pytest.mark.parametrize("suffix", [".npz", ".mcap", ".parquet", ".csv"])
def test_files_hold_it_in_the_numbers_that_the_source_sends(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    api.convert(made(), path)
    back = api.read(path, THREE if suffix == ".csv" else None)
    np.testing.assert_array_equal(shear_of(back), shear_of(made()))
    source = joined(list(back.source_blocks()))
    assert source.shear is None
    assert source.values.shape == (8, 18)


@pytest.mark.long
def test_a_log_of_a_live_run_holds_it(tmp_path: Path) -> None:
    api.convert(made(), tmp_path / "a.npz")
    log = tmp_path / "log.mcap"
    arguments = ["run", f"replay:{tmp_path / 'a.npz'}?speed=max", "--to", f"mcap:{log}?draw=0"]
    assert main(arguments) == 0
    np.testing.assert_array_equal(shear_of(api.read(log)), shear_of(made()))


@pytest.mark.parametrize("shear", [SHEAR[:, :, 0], SHEAR[:, :5], SHEAR[:7], [["a"]]])
def test_shear_of_another_shape_is_refused(shear: Any) -> None:
    with pytest.raises(RecordingCorrupt, match=r"shape|numbers"):
        api.recording(TIMES, READINGS, THREE, shear=shear)


def test_a_sensor_of_three_axes_that_point_anywhere_is_refused() -> None:
    with pytest.raises(SensorFileInvalid, match="field shear"):
        api.recording(TIMES, READINGS, grid_sensor(2, 3, axes=3), shear=SHEAR)


def test_repeated_and_wrong_times_take_their_shear_along() -> None:
    t_s = np.array([0, 0.1, 0.1, 0.2, 0.3, 0.2, 0.5, 0.6])
    blocks = api.recording(t_s, READINGS, THREE, shear=SHEAR).blocks()
    first = next(blocks)
    assert first.shear is not None
    np.testing.assert_allclose(first.shear, SHEAR[[0, 1, 3, 4]], atol=1e-12)
    with pytest.raises(TimesNotIncreasing):
        next(blocks)


def test_of_an_xela_module_x_points_right_and_y_down(tmp_path: Path) -> None:
    numbers = np.arange(4 * 48.0).reshape(4, 48)
    names = [f"txl{taxel}_{axis}" for taxel in range(1, 17) for axis in "xyz"]
    np.savetxt(tmp_path / "a.csv", numbers, "%.1f", ",", header=",".join(names), comments="")
    recording = api.read(tmp_path / "a.csv", XELA, columns=Columns(rate_hz=10.0))
    sent = numbers.reshape(4, 16, 3)
    np.testing.assert_array_equal(shear_of(recording), np.stack([sent[..., 0], -sent[..., 1]], axis=2))
    np.testing.assert_array_equal(recording.load().values, sent[..., 2])


def test_the_servers_messages_bring_it_to_the_live_loop() -> None:
    seen: list[Any] = []
    live = Live(XELA)
    step = live.run.step
    live.run.step = lambda raw: (seen.append(raw), step(raw))[1]  # type: ignore[method-assign]
    parser = XelaParser(48, Faults())
    data = ",".join(f"{number:04X}" for number in range(48))
    ((t_s, values),) = parser.feed(f'{{"message": 1, "1": {{"time": 2.5, "data": "{data}"}}}}'.encode())
    assert t_s is not None
    live.step(t_s, values)
    sent = np.arange(48.0).reshape(16, 3)
    np.testing.assert_array_equal(seen[0].shear[0], np.stack([sent[:, 0], -sent[:, 1]], axis=1))


@pytest.mark.parametrize("slip", [0.0, 1.0])
def test_the_live_loop_hears_the_witness(slip: float) -> None:
    slides = np.zeros(100)
    slides[60:75] = slip
    recording = sheared(np.zeros(100), slides)
    live = Live(recording)
    source = joined(list(recording.source_blocks()))
    found = [live.push(cut(source, scan, scan + 1)) for scan in range(len(source))]
    assert (np.nanmax(joined([*found, live.finish()]).evidence) > 0) == (slip > 0)


def test_the_real_module_spreads_under_load(recordings: Path) -> None:
    folder = recordings / "xela-flat" / "2021-11-24-15-19-34"
    recording = api.read(folder / "xela_sensor1.csv", XELA, columns=Columns(rate_hz=48.0))
    raw, layout = recording.load(), load_sensor(XELA).layout
    assert raw.shear is not None
    idle, loaded = slice(0, 12), raw.values.sum(axis=1).argmax()
    load = raw.values[loaded] - raw.values[idle].mean(axis=0)
    shear = raw.shear[loaded] - raw.shear[idle].mean(axis=0)
    arm = np.stack([layout.x_m, layout.y_m], axis=1)
    arm = arm - load @ arm / load.sum()
    own = shear - np.outer(load, shear.sum(axis=0)) / load.sum()
    assert ((arm * own).sum(axis=0) > 0).all()  # outwards along both axes
