from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.padfiles import open_pads
from taxelflow.cli import main
from taxelflow.errors import NameUnknown, ParameterInvalid, RecordingCorrupt, RecordingMissing, SensorNeeded
from taxelflow.pipeline.api import read
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats
    from taxelflow.sensors.sensor import Sensor

HAND = load_sensor("inspire-rh56dftp@3mm")
SCANS = 50


def with_files(sensor: Sensor, glob: str = "*_{}.csv") -> Sensor:
    pads = tuple(msgspec.structs.replace(pad, files=glob.format(pad.name)) for pad in sensor.pads)
    return msgspec.structs.replace(sensor, pads=pads)


def write(folder: Path, sensor: Sensor, scans: int = SCANS, late_s: float = 0.002) -> Floats:
    """A file per pad, each a little later than the one before; gives the numbers of all pads side by side."""
    values = np.random.default_rng(0).integers(0, 4096, (scans, sensor.channel_map.columns)).astype(float)
    start = 0
    for number, pad in enumerate(sensor.pads):
        width = (pad.channels or pad.count) * sensor.axes
        table = np.column_stack(
            [np.arange(scans) / 30 + late_s * number / len(sensor.pads), values[:, start : start + width]]
        )
        head = ",".join(["t_s", *(f"v{k}" for k in range(width))])
        np.savetxt(folder / f"2025_{pad.name}.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")
        start += width
    return values


def test_the_17_files_of_a_hand_are_one_recording(tmp_path: Path) -> None:
    values = write(tmp_path, HAND)
    recording = read(tmp_path, with_files(HAND, "????_{}.csv"))
    scans = recording.load()
    assert recording.format == "17 files, one per pad"
    np.testing.assert_allclose(scans.t_s, np.arange(SCANS) / 30, atol=1e-8)
    np.testing.assert_array_equal(scans.values, HAND.channel_map.to_readings(values))


@pytest.mark.parametrize("axes", [1, 3])
def test_gains_offsets_and_axes_are_applied_once(tmp_path: Path, axes: int) -> None:
    sensor = grid_sensor(2, 3, pads=2, axes=axes, offset=tuple(map(float, range(12))), gain=(2.0,) * 12, polarity=-1)
    values = write(tmp_path, sensor)
    np.testing.assert_allclose(
        read(tmp_path, with_files(sensor)).load().values, sensor.channel_map.to_readings(values), rtol=1e-8
    )


def test_the_command_line_may_name_the_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, grid_sensor(2, 3, pads=2))
    sensor = tmp_path / "s.toml"
    pads = "".join(f'[[pads]]\nname = "pad{n}"\nrows = 2\ncols = 3\npitch_m = [0.01, 0.01]\n' for n in range(2))
    sensor.write_text(f'name = "s"\nunit = "Pa"\n{pads}')
    words = ["info", str(tmp_path), "--sensor", str(sensor), "--columns.pads", "pad0=*_pad0.csv", "pad1=*_pad1.csv"]
    assert main(words) == 0
    assert "2 files, one per pad" in capsys.readouterr().out


def test_a_folder_without_files_of_pads_is_no_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingMissing, match="no pad has `files` in it"):
        read(tmp_path, HAND)


@pytest.mark.parametrize(
    ("pads", "kind", "seen"),
    [
        (("pad0=*.csv",), RecordingCorrupt, r"2 files match '\*\.csv' of pad pad0: 2025_pad0\.csv, 2025_pad1\.csv"),
        (("pad0=x*.csv",), RecordingCorrupt, "0 files match .* of pad pad0: none"),
        (("pad0=../*.csv",), RecordingCorrupt, "leads out of the folder"),
        (("pad1=*_pad1.csv",), RecordingCorrupt, "no file is named for pad pad0"),
        (("pad0=*_pad0.csv", "pad1=*.toml"), RecordingCorrupt, r"a\.toml of pad pad1 is none of \.csv"),
        (("thumb=*.csv",), NameUnknown, "unknown pad 'thumb'"),
        (("pad0",), ParameterInvalid, "must be PAD=GLOB"),
    ],
)
def test_what_does_not_name_one_file_is_refused(
    tmp_path: Path, pads: tuple[str, ...], kind: type[Exception], seen: str
) -> None:
    sensor = grid_sensor(2, 3, pads=2)
    write(tmp_path, sensor)
    (tmp_path / "a.toml").touch()
    with pytest.raises(kind, match=seen):
        read(tmp_path, sensor, columns=Columns(pads=pads))


def test_files_of_other_times_are_refused(tmp_path: Path) -> None:
    sensor = grid_sensor(2, 3, pads=2)
    write(tmp_path, sensor, late_s=0.05)
    with pytest.raises(RecordingCorrupt, match=r"scan 0 is at .* s for pad pad0 and at .* s for pad1"):
        read(tmp_path, with_files(sensor)).load()


def test_a_shorter_file_ends_the_recording(tmp_path: Path) -> None:
    sensor = grid_sensor(2, 3, pads=2)
    write(tmp_path, sensor)
    file = tmp_path / "2025_pad1.csv"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:31]))
    reading = read(tmp_path, with_files(sensor)).blocks()
    assert sum(map(len, reading)) == 30
    assert "the file of pad pad1 ends before others" in str(reading.loss)


def test_times_by_a_rate(tmp_path: Path) -> None:
    sensor = grid_sensor(2, 3, pads=2)
    for number in range(2):
        np.save(tmp_path / f"pad{number}.npy", np.full((20, 2, 3), number))
    scans = read(tmp_path, with_files(sensor, "{}.npy"), columns=replace(Columns(), rate_hz=10.0)).load()
    np.testing.assert_array_equal(scans.values, [[0.0] * 6 + [1.0] * 6] * 20)
    with pytest.raises(SensorNeeded):
        open_pads(tmp_path, None)
    np.testing.assert_allclose(scans.t_s, np.arange(20) / 10)
