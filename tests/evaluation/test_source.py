from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import estimated, rigged
from taxelflow.acquire.columns import Columns
from taxelflow.evaluation.source import images, source_of
from taxelflow.pipeline import api
from taxelflow.publish.results import read_summary
from taxelflow.simulation.simulate import save

if TYPE_CHECKING:
    from pathlib import Path

TAXELS = 4


def log(folder: Path) -> Path:
    """A log whose time is in ms, in a column of another name, beside a number that is no taxel."""
    path, scans = folder / "log.csv", np.arange(20.0)
    table = np.column_stack([100 * scans, scans, np.ones((20, TAXELS))])
    names = ",".join(["stamp", "count", *(f"taxel_{k}" for k in range(TAXELS))])
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%g")
    return path


@pytest.mark.parametrize("from_file", [False, True])
def test_a_recording_is_found_again_as_it_was_read(
    from_file: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = log(tmp_path)
    columns = Columns(time="stamp", time_unit="ms", taxels=("taxel_*",))
    if from_file:
        (tmp_path / "columns.toml").write_text('time = "stamp"\ntime_unit = "ms"\ntaxels = ["taxel_*"]\n')
        columns = Columns(file=tmp_path / "columns.toml")
    recording = api.read(path, "grid:2x2@4mm,kPa", columns=columns)
    api.estimate(recording).save(tmp_path / "result")
    monkeypatch.chdir(tmp_path / "result")
    found = source_of(read_summary(tmp_path / "result"))
    assert found is not None
    np.testing.assert_array_equal(found.load().values, recording.load().values)
    np.testing.assert_array_equal(found.load().t_s, recording.load().t_s)


def test_times_that_stand_apart_are_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = log(tmp_path)
    (tmp_path / "times.txt").write_text("\n".join(str(0.1 * k) for k in range(20)))
    monkeypatch.chdir(tmp_path)
    columns = Columns(times="times.txt", taxels=("taxel_*",))  # type: ignore[arg-type]  # as people write it
    api.estimate(api.read(path, "grid:2x2@4mm,kPa", columns=columns)).save(tmp_path / "result")
    monkeypatch.chdir(tmp_path / "result")
    summary = read_summary(tmp_path / "result")
    assert source_of(summary) is not None
    (tmp_path / "times.txt").unlink()
    assert source_of(summary) is None


def test_the_image_of_a_separate_contact_has_its_own_load_only(tmp_path: Path) -> None:
    save(rigged("two-contacts", motion={"strokes": 1}), tmp_path / "two.npz")
    ran = read_summary(estimated(tmp_path / "two.npz", tmp_path / "result", "--contacts", "2"))
    recording = source_of(ran)
    assert recording is not None
    whole, *parts = (np.stack([image for _, image in images(ran, recording, pad)]) for pad in range(3))
    contacts = np.array([part[150].sum() for part in parts]) / whole[150].sum()
    np.testing.assert_allclose(contacts, 0.5, atol=0.05)
    assert not (np.minimum(parts[0], parts[1])[150] > 1e4).any()
