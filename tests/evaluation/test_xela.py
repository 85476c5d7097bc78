"""Recordings made up in the format of the XELA data set; the real ones where they are there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest

from rigged import refused
from synthetic import dome
from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.marker_recordings import marked_recordings, open_marked
from taxelflow.evaluation.xela import Xela, summed
from taxelflow.messages import OK
from taxelflow.pipeline import api
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from taxelflow.evaluation.marker_recordings import Marked
    from taxelflow.evaluation.xela import MarkedRow
    from taxelflow.messages import Floats

RATE_HZ = 10.0
SPEED_M_S = 0.01
IDLE, STILL, MOVING = 30, 40, 20
"""Scans: idle, then in contact at rest, moving, at rest, then idle."""


def path_m() -> Floats:
    """(scans,), where the object is while it is touched."""
    way = SPEED_M_S / RATE_HZ * np.arange(1, MOVING + 1)
    return np.concatenate([np.zeros(STILL), way, np.full(STILL, way[-1])])


def write_recording(folder: Path, *, lost: slice = slice(0)) -> Path:
    """A dome that lies still, slides 20 mm in 2 s and lies still, and its marker, frozen in `lost` scans."""
    folder.mkdir(parents=True)
    sensor = load_sensor("xela-4x4@4.7mm")
    random, x = np.random.default_rng(1), path_m()
    count = len(x) + 2 * IDLE
    normal = np.zeros((count, 16))
    normal[IDLE:-IDLE] = [dome(sensor, place - x[-1] / 2, peak=5000.0, radius_m=0.004) for place in x]
    readings = 37000.0 + np.round(np.repeat(normal, 3, axis=1) + random.normal(0, 5, (count, 48)))
    names = [f"txl{taxel}_{axis}" for taxel in range(1, 17) for axis in "xyz"]
    np.savetxt(folder / "xela_sensor1.csv", readings, "%.1f", ",", header=",".join(names), comments="")
    marker = np.full((count, 3), [0.0, 0.05, 0.2])
    marker[:, 0] = np.concatenate([np.full(IDLE, x[0]), x, np.full(IDLE, x[-1])])
    marker[:, 1] += np.where(np.arange(count) % 2, 1e-5, 0.0)  # a camera never repeats a number
    marker[lost] = marker[lost.start or 0]
    header = ",".join(f"marker1_position_{axis}" for axis in "xyz")
    np.savetxt(folder / "marker.csv", marker, "%.9f", ",", header=header, comments="")
    (folder / "meta_data.csv").write_text(f"object_name,frequency_hz\n7,{RATE_HZ}\n")
    return folder


def score_one(marked: Marked, method: str = "convolution", score: Xela | None = None) -> MarkedRow:
    """As if no pose were cut by the border."""
    result = api.estimate(marked.recording, method, condition=Conditioner(tare="start"))
    slips = replace(result.slips, quality=np.full_like(result.slips.quality, OK))
    result = replace(result, slips=slips)
    return (score or Xela(Path())).judged(marked, result, "test", method)


def test_the_marker_shows_the_speed(tmp_path: Path) -> None:
    marked = open_marked(write_recording(tmp_path / "a"))
    t_s = (IDLE + np.array([STILL // 2, STILL + MOVING // 2])) / RATE_HZ
    assert marked.speed_m_s(t_s) == pytest.approx([0.0, SPEED_M_S], abs=1e-4)
    assert np.isnan(marked.speed_m_s(np.array([-1.0, 0.0, 1e3]))).all()


def test_shear_is_read_unless_it_is_not_asked_for(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "a")
    for shear in (True, False):
        scans = next(open_marked(folder, shear=shear).recording.blocks())
        assert (scans.shear is not None) == shear


def test_a_frozen_marker_is_lost(tmp_path: Path) -> None:
    frozen = slice(IDLE + STILL, IDLE + STILL + MOVING)
    marked = open_marked(write_recording(tmp_path / "a", lost=frozen))
    assert np.isnan(marked.speed_m_s(np.arange(frozen.start + 4, frozen.stop - 4) / RATE_HZ)).all()


def test_begin_and_end_of_a_contact_are_not_judged(tmp_path: Path) -> None:
    row = score_one(open_marked(write_recording(tmp_path / "a")))
    assert row.moving == pytest.approx(MOVING, abs=2)
    assert row.still == pytest.approx(2 * STILL - (1.0 + 0.5) * RATE_HZ, abs=6)


def test_what_counts_as_begin_end_and_motion_is_asked_for(tmp_path: Path) -> None:
    marked = open_marked(write_recording(tmp_path / "a"))
    usual, whole = (score_one(marked, score=score) for score in (Xela(Path()), Xela(Path(), closing_s=0, opening_s=0)))
    assert whole.still - usual.still == pytest.approx((1.0 + 0.5) * RATE_HZ, abs=2)
    assert score_one(marked, score=Xela(Path(), moves_m_s=2 * SPEED_M_S)).moving == 0
    with pytest.raises(ParameterInvalid, match="still_m_s must be 0 or more"):
        Xela(Path(), still_m_s=-1.0)


def test_a_slide_is_found_and_a_still_object_stays_where_it_is(tmp_path: Path) -> None:
    row = score_one(open_marked(write_recording(tmp_path / "a")))
    assert row.found > 0.8 * row.moving
    assert row.false < 0.1 * row.still
    assert row.excursion_mm is not None
    assert row.excursion_mm < 1.0
    assert row.still_ok <= row.still


def test_a_still_pose_that_wanders_is_an_excursion(tmp_path: Path) -> None:
    marked = open_marked(write_recording(tmp_path / "a"))
    still = replace(marked, position=np.broadcast_to(marked.position[0], marked.position.shape))
    row = score_one(still)
    assert row.moving == 0
    assert row.excursion_mm is not None
    assert 8.0 < row.excursion_mm < 24.0  # centroids of a small pad see less, for it cuts the contact


def test_intervals_are_over_recordings(tmp_path: Path) -> None:
    row = score_one(open_marked(write_recording(tmp_path / "a")))
    (alike,) = summed([row] * 5)
    assert (alike.recordings, alike.f1_low, alike.f1_high) == (5, alike.f1, alike.f1)
    (mixed,) = summed([row, row, replace_found(row)])
    assert mixed.f1_low < mixed.f1 < mixed.f1_high


def replace_found(row: MarkedRow) -> MarkedRow:
    """The same recording, of which no slip was found."""
    from msgspec.structs import replace as replaced

    return replaced(row, found=0)


def test_halves_alternate_and_each_has_a_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b", "c"):
        write_recording(tmp_path / name)
    report = Xela(tmp_path, methods=("convolution",), mode="batch").run()
    assert [row.half for row in report.recordings] == ["tune", "test", "tune"]
    assert [(row.half, row.recordings) for row in report.rows] == [("tune", 2), ("test", 1)]
    report.show()
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
    assert [table.name for table in report.tables()] == ["xela", "recordings"]
    (own,) = Xela(tmp_path, methods=("convolution",), mode="batch", half="test").run().recordings
    assert own.recording == "b"


def test_the_command_needs_a_folder_of_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "folder" in refused(capsys, "score", "xela")
    assert "xela_sensor1.csv" in refused(capsys, "score", "xela", tmp_path)
    broken = write_recording(tmp_path / "a")
    (broken / "marker.csv").write_text("x,y\n1,2\n")
    assert "marker1_position_x" in refused(capsys, "score", "xela", tmp_path)


def test_the_real_recordings_open(recordings: Path) -> None:
    folder = recordings / "xela-flat"
    if not folder.is_dir():
        pytest.skip(f"the recordings with a marker are not in {recordings}")
    found = marked_recordings(folder)
    assert len(found) > 10
    marked = open_marked(found[0])
    assert np.nanmax(marked.speed_m_s(marked.t_s)) > 0.008


@pytest.mark.long
@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_real_objects_at_rest_do_not_slip_and_slides_are_found(
    recordings: Path, mode: Literal["batch", "stream"]
) -> None:
    folder = recordings / "xela-flat"
    if not folder.is_dir():
        pytest.skip(f"the recordings with a marker are not in {recordings}")
    (row,) = Xela(folder, methods=("convolution",), mode=mode, half="test").run().rows
    assert row.still_slipping_percent < 6.0
    assert row.f1 > 0.5
