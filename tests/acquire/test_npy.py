from __future__ import annotations

from typing import TYPE_CHECKING, Any

import h5py
import msgspec
import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.acquire.columns import Columns
from taxelflow.errors import RecordingCorrupt, SensorNeeded, TaxelCountWrong
from taxelflow.pipeline.api import convert, read

if TYPE_CHECKING:
    from pathlib import Path

SENSOR = grid_sensor(2, 3)
VALUES = np.random.default_rng(0).integers(0, 4096, (2500, 2, 3))
RATE = Columns(rate_hz=100.0)


@pytest.mark.parametrize("kind", ["u2", "f4", ">f8", "i8"])
@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("order", ["C", "F"])
def test_scans_of_any_kind_and_shape_come_out_as_they_were(tmp_path: Path, kind: str, flat: bool, order: Any) -> None:
    array = VALUES.astype(kind).reshape(2500, 6) if flat else VALUES.astype(kind)
    np.save(tmp_path / "a.npy", np.asarray(array, order=order))
    recording = read(tmp_path / "a.npy", SENSOR, columns=RATE)
    scans = recording.load()
    assert (recording.scans, recording.format) == (2500, "npy")
    np.testing.assert_array_equal(scans.values, VALUES.reshape(2500, 6))
    np.testing.assert_allclose(scans.t_s, np.arange(2500) / 100)
    assert "times computed from the rate of 100 Hz" in recording.notes


def test_the_time_may_be_a_column_or_in_a_file(tmp_path: Path) -> None:
    t_s = np.arange(20) / 10
    np.save(tmp_path / "a.npy", np.column_stack([VALUES[:20].reshape(20, 6), t_s]))
    np.save(tmp_path / "b.npy", VALUES[:20])
    np.save(tmp_path / "t.npy", t_s)
    column = read(tmp_path / "a.npy", SENSOR, columns=Columns(time="6")).load()
    beside = read(tmp_path / "b.npy", SENSOR, columns=Columns(times=tmp_path / "t.npy")).load()
    for scans in (column, beside):
        np.testing.assert_allclose(scans.t_s, t_s)
        np.testing.assert_array_equal(scans.values, VALUES[:20].reshape(20, 6))


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".h5"])
def test_an_image_is_what_the_sensor_sent_whatever_the_file(tmp_path: Path, suffix: str) -> None:
    pad = msgspec.structs.replace(SENSOR.pads[0], order="column-major", first="bottom-left")
    sensor = msgspec.structs.replace(SENSOR, pads=(pad,), offset=255.0, polarity=-1)
    t_s, images = np.arange(20) / 100, VALUES[:20].reshape(20, 2, 3)
    path = tmp_path / f"a{suffix}"
    if suffix == ".npz":
        np.savez(path, t=t_s, pressure=images)
    elif suffix == ".npy":
        np.save(path, images)
    else:
        with h5py.File(path, "w") as file:
            file["t"], file["pressure"] = t_s, images
    scans = read(path, sensor, columns=RATE if suffix == ".npy" else None).load()
    np.testing.assert_array_equal(scans.values, 255.0 - images.reshape(20, 6))


def test_an_image_of_another_shape_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", VALUES.reshape(2500, 3, 2))
    with pytest.raises(RecordingCorrupt, match=r"its scans have shape \(3, 2\), and the grid of sensor grid \(2, 3\)"):
        read(tmp_path / "a.npy", SENSOR, columns=RATE)
    np.save(tmp_path / "b.npy", VALUES.reshape(2500, 6, 1))
    assert read(tmp_path / "b.npy", SENSOR, columns=RATE).scans == 2500


def test_it_converts(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", VALUES)
    convert(read(tmp_path / "a.npy", SENSOR, columns=RATE), tmp_path / "a.npz")
    np.testing.assert_array_equal(read(tmp_path / "a.npz").load().values, VALUES.reshape(2500, 6))


def test_without_times_the_ways_to_give_them_are_named(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", VALUES)
    with pytest.raises(RecordingCorrupt, match=r"it holds no times; give the rate by --columns\.rate-hz, or a file"):
        read(tmp_path / "a.npy", SENSOR)


@pytest.mark.parametrize(
    ("array", "seen"),
    [(np.zeros(5), r"its scans are float64 \(5,\)"), (np.zeros((5, 6), complex), "complex128"), (np.array("a"), "<U1")],
)
def test_what_is_no_scans_is_refused(tmp_path: Path, array: Any, seen: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(RecordingCorrupt, match=seen):
        read(tmp_path / "a.npy", SENSOR, columns=RATE)


def test_objects_are_not_loaded_and_a_cut_file_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([object()]), allow_pickle=True)
    with pytest.raises(RecordingCorrupt):
        read(tmp_path / "a.npy", SENSOR, columns=RATE)
    (tmp_path / "a.npy").write_text("0.0,1,2,3,4,5,6\n")
    with pytest.raises(RecordingCorrupt, match="the magic string is not correct"):
        read(tmp_path / "a.npy", SENSOR, columns=RATE)
    np.save(tmp_path / "b.npy", VALUES)
    (tmp_path / "b.npy").write_bytes((tmp_path / "b.npy").read_bytes()[:-10])
    with pytest.raises(RecordingCorrupt, match=r"numpy\.save"):
        read(tmp_path / "b.npy", SENSOR, columns=RATE)


def test_sensor_and_number_of_taxels_are_checked(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", VALUES)
    with pytest.raises(SensorNeeded):
        read(tmp_path / "a.npy", columns=RATE)
    with pytest.raises(TaxelCountWrong, match="has 6 taxels per scan"):
        read(tmp_path / "a.npy", grid_sensor(2, 2), columns=RATE)
