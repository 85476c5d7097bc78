from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import msgspec
import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.acquire import hdf5, hdf5_text
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.hdf5 import open_hdf5
from taxelflow.errors import ExtraMissing, RecordingCorrupt, RecordingTooLarge, SensorNeeded
from taxelflow.pipeline.api import read

SENSOR = grid_sensor(2, 3)
VALUES = np.random.default_rng(0).integers(0, 4096, (2500, 2, 3))
T_S = np.arange(2500) / 100


def write(path: Path, **datasets: Any) -> Path:
    with h5py.File(path, "w") as file:
        for name, array in datasets.items():
            file.create_dataset(name.replace("__", "/"), data=array)
    return path


@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
@pytest.mark.parametrize("time", ["t", "t_s"])
def test_times_and_scans_are_read(tmp_path: Path, suffix: str, time: str) -> None:
    recording = read(write(tmp_path / f"a{suffix}", **{time: T_S, "pressure": VALUES}), SENSOR)
    scans = recording.load()
    assert (recording.scans, recording.format) == (2500, "h5")
    np.testing.assert_array_equal(scans.values, VALUES.reshape(2500, 6))
    np.testing.assert_array_equal(scans.t_s, T_S)


def test_datasets_may_have_other_names_and_units(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", log__stamp=T_S * 1e9, log__taxels=VALUES.reshape(2500, 6), t=np.zeros(3))
    asked = Columns(time="log/stamp", time_unit="ns", taxels=("log/taxels",))
    scans = read(path, SENSOR, columns=asked).load()
    np.testing.assert_allclose(scans.t_s, T_S)
    np.testing.assert_array_equal(scans.values, VALUES.reshape(2500, 6))


def test_its_sensor_may_be_inside(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", t=T_S, pressure=VALUES)
    with pytest.raises(SensorNeeded):
        read(path)
    with h5py.File(path, "a") as file:
        file.attrs["sensor"] = msgspec.json.encode(SENSOR).decode()
    assert read(path).sensor == SENSOR


def test_packed_data_of_a_rate(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("pressure", data=VALUES, compression="gzip", chunks=(100, 2, 3))
    scans = read(tmp_path / "a.h5", SENSOR, columns=Columns(rate_hz=50.0)).load()
    np.testing.assert_array_equal(scans.values, VALUES.reshape(2500, 6))
    with pytest.raises(RecordingCorrupt, match="it holds no times"):
        read(tmp_path / "a.h5", SENSOR)


def test_what_is_missing_or_wrong_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingCorrupt, match="no dataset pressure in it: it holds t; store datasets t"):
        read(write(tmp_path / "a.h5", t=T_S), SENSOR)
    with pytest.raises(RecordingCorrupt, match=r"dataset t has shape \(3,\) and pressure \(2500, 2, 3\)"):
        read(write(tmp_path / "b.h5", t=np.zeros(3), pressure=VALUES), SENSOR)
    (tmp_path / "c.h5").write_bytes(b"not an HDF5 file")
    with pytest.raises(RecordingCorrupt, match="file signature not found"):
        open_hdf5(tmp_path / "c.h5", SENSOR)


def test_data_in_other_files_are_not_read(tmp_path: Path) -> None:
    write(tmp_path / "other.h5", pressure=VALUES)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["pressure"] = h5py.ExternalLink("other.h5", "/pressure")
        file["t"] = T_S
    with pytest.raises(RecordingCorrupt, match="no dataset pressure"):
        read(tmp_path / "a.h5", SENSOR)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_dataset("pressure", (100, 6), "f8", external=[(str(tmp_path / "other.h5"), 0, 4800)])
        file["t"] = T_S[:100]
    with pytest.raises(RecordingCorrupt, match="stored in other files"):
        read(tmp_path / "b.h5", SENSOR)


def test_sizes_are_checked_before_memory_is_taken(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("pressure", (10**9, 6), "f8", chunks=(1024, 6), compression="gzip")
    with pytest.raises(RecordingTooLarge, match=r"unpack to more than 48\.0 GB"):
        read(tmp_path / "a.h5", SENSOR)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_dataset("pressure", (10**7, 6), "f8", chunks=(10**7, 6), compression="gzip")
    with pytest.raises(RecordingTooLarge, match="has chunks of 480000000 bytes"):
        read(tmp_path / "b.h5", SENSOR)


def test_a_file_cut_anywhere_is_an_error_of_one_line(tmp_path: Path) -> None:
    content = write(tmp_path / "a.h5", t=T_S[:20], pressure=VALUES[:20]).read_bytes()
    for length in range(0, len(content), 97):
        (tmp_path / "b.h5").write_bytes(content[:length])
        with pytest.raises(RecordingCorrupt) as caught:
            read(tmp_path / "b.h5", SENSOR).load()
        assert str(caught.value).isprintable()


def test_without_h5py_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ModuleNotFoundError(name)

    path = write(tmp_path / "a.h5", t=T_S, pressure=VALUES)
    monkeypatch.setattr(hdf5, "import_module", missing)
    with pytest.raises(ExtraMissing, match=r"taxelflow\[h5\]"):
        read(path, SENSOR)


@pytest.mark.parametrize("place", ["attribute", "dataset"])
@pytest.mark.parametrize("fixed", [True, False], ids=["fixed length", "variable length"])
def test_the_text_of_a_sensor_is_read_wherever_it_is(tmp_path: Path, place: str, fixed: bool) -> None:
    text: Any = msgspec.json.encode(SENSOR)
    text = np.bytes_(text) if fixed else text.decode()
    path = write(tmp_path / "a.h5", t=T_S, pressure=VALUES)
    with h5py.File(path, "a") as file:
        if place == "attribute":
            file.attrs["sensor"] = text
        else:
            file["sensor"] = text
    assert read(path).sensor.name == SENSOR.name


def test_a_damaged_text_is_an_error_unless_the_sensor_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path(__file__).parents[1] / "hostile" / "findings" / "heap-that-never-ends.h5"
    with pytest.raises(RecordingCorrupt, match=r"no scan is readable: Can't .*; record or copy it again$"):
        read(path, SENSOR).load()
    monkeypatch.setattr(hdf5_text, "_PROGRAM", "import sys; sys.exit('no such text')")
    with pytest.raises(
        RecordingCorrupt, match="its text sensor cannot be read: no such text; store it as text of fixed"
    ):
        read(path)
    monkeypatch.setattr(hdf5_text, "_MOST", replace(hdf5_text._MOST, wall_s=0.01))
    monkeypatch.setattr(hdf5_text, "_PROGRAM", "while True: pass")
    with pytest.raises(RecordingCorrupt, match=r"cannot be read in 0\.01 s"):
        read(path)


def test_a_table_of_texts_is_no_sensor(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", t=T_S, pressure=VALUES)
    with h5py.File(path, "a") as file:
        file.attrs["sensor"] = ["a", "b"]
    with pytest.raises(RecordingCorrupt, match="not one text"):
        read(path)
