from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from synthetic import dome, grid_sensor
from taxelflow import estimate, read
from taxelflow.cli import main
from taxelflow.condition.converter import are_whole

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7, unit="count")


UNEVEN = np.repeat(np.linspace(0.8, 1.2, 4), 7)
"""Idle numbers with a structure, as a contact has: they are not tared."""


def grasp(peak: float, noise: float, idle: float | Floats = 0.0) -> Floats:
    """40 idle scans, 40 with a dome that moves, in counts."""
    random = np.random.default_rng(1)
    touched = [dome(PALM, 0.0004 * k - 0.008, peak=peak) for k in range(40)]
    return idle + np.concatenate([np.zeros((40, 28)), touched]) + random.normal(0, noise, (80, 28))


def save(path: Path, values: Any) -> Path:
    np.savez(path, t=np.arange(len(values)) / 50, pressure=values)
    return path


def notes_of(path: Path, sensor: Any = PALM) -> list[str]:
    return estimate(read(path, sensor)).summary.notes


def test_readings_from_0_to_1_are_no_counts(tmp_path: Path) -> None:
    path = save(tmp_path / "a.npz", grasp(0.8, 0.004))
    found = estimate(read(path, PALM)).summary
    assert found.pads["pad0"].contact_scans >= 38
    assert found.pads["pad0"].noise == pytest.approx(0.004, rel=0.3)


@pytest.mark.parametrize(
    ("numbers", "whole"),
    [([0.0, 3.0, 4095.0], True), ([0.0, np.nan], True), ([0.5, 1.0], False), ([1e-3 * 7 / 1e-3], True), ([], True)],
)
def test_whole_numbers_are_those_to_rounding(numbers: list[float], whole: bool) -> None:
    assert are_whole(np.array(numbers)) == whole


def test_without_contact_the_note_gives_range_noise_and_threshold(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(0, 2.0, (200, 28))
    (note,) = [one for one in notes_of(save(tmp_path / "a.npz", values)) if one.startswith("no contact")]
    assert "readings range from -" in note
    assert "contact begins at 6 times the noise of" in note
    assert note.endswith("count")


def test_idle_numbers_far_below_0_are_noted_where_they_hide_the_contact(tmp_path: Path) -> None:
    path = save(tmp_path / "a.npz", grasp(200.0, 1.0, idle=-150.0 * UNEVEN))
    (note,) = [one for one in notes_of(path) if one.startswith("no contact")]
    assert "most are near -13" in note
    assert "above idle" not in note
    assert note.endswith("to the sensor file, or --condition.tare start")
    assert not any(one.startswith("no contact") for one in notes_of(path, grid_sensor(4, 7, unit="count", offset=-150)))


@pytest.mark.parametrize(("spread", "noted"), [(0.0, False), (100.0, True)])
@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_load_that_offsets_may_hold_is_noted(spread: float, noted: bool, mode: Any, tmp_path: Path) -> None:
    random = np.random.default_rng(4)
    values = spread * random.uniform(0, 1, 28) + random.normal(0, 2, (200, 28))
    notes = estimate(read(save(tmp_path / "a.npz", values), PALM), mode=mode).summary.notes
    (note,) = [one for one in notes if one.startswith("no contact")]
    assert ("a load at rest from first to last scan would be part of the offsets" in note) == noted


def test_readings_as_far_below_idle_as_above_are_noted(tmp_path: Path) -> None:
    values = 20 + np.random.default_rng(2).normal(0, 2, (120, 28))
    values[60:, 3] += 40.0
    values[60:, 17] -= 60.0
    notes = estimate(read(save(tmp_path / "a.npz", values), PALM), mode="stream").summary.notes
    (note,) = [one for one in notes if one.startswith("no contact")]
    assert "if an object lay on the pad at the start, its load is missing" in note
    assert note.endswith("declare full_scale in the sensor file")


def test_idle_numbers_far_above_0_are_noted_with_what_to_do(tmp_path: Path) -> None:
    values = grasp(200.0, 1.0, idle=50.0 * UNEVEN)
    (note,) = [one for one in notes_of(save(tmp_path / "a.npz", values)) if "not tared" in one]
    assert note.endswith("pad0; if nothing touched the sensor at the start, add --condition.tare start")


@pytest.mark.parametrize("mode", ["batch", "stream"])
@pytest.mark.parametrize("idle", [-150.0, 50.0, 800.0])
def test_idle_numbers_far_from_0_are_offsets_without_a_full_scale(tmp_path: Path, idle: float, mode: Any) -> None:
    found = estimate(read(save(tmp_path / "a.npz", grasp(200.0, 1.0, idle=idle)), PALM), mode=mode)
    assert not found.slips.contact[:40].any()
    assert found.slips.contact[45:, 0].all()
    assert found.slips.load[60, 0] == pytest.approx(dome(PALM, 0.0, peak=200.0).sum(), rel=0.05)
    assert not any("not tared" in note for note in found.summary.notes)


def test_numbers_that_fall_under_load_are_noted(tmp_path: Path) -> None:
    falling = save(tmp_path / "a.npz", 1000.0 - grasp(800.0, 2.0))
    assert any("add polarity = -1" in note for note in notes_of(falling))
    sensor = grid_sensor(4, 7, unit="count", polarity=-1, offset=1000.0)
    assert not any("polarity" in note for note in notes_of(falling, sensor))
    rising = save(tmp_path / "b.npz", grasp(800.0, 2.0))
    assert not any("polarity" in note for note in notes_of(rising))
    assert any("leave polarity = -1 out" in note for note in notes_of(rising, sensor))


def test_info_takes_the_options_of_conditioning_and_gives_the_notes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(save(tmp_path / "a.npz", 1000.0 - grasp(800.0, 2.0)))
    assert main(["info", path, "--sensor", "grid:4x7@10mm", "--condition.tare", "start"]) == 0
    said = capsys.readouterr()
    assert "add polarity = -1" in said.err
    assert "no contact" in said.err
    assert main(["info", path, "--sensor", "grid:4x7@10mm", "--condition.contact-on", "-1"]) == 2


def test_one_scan_is_not_called_silent(tmp_path: Path) -> None:
    path = save(tmp_path / "a.npz", np.full((1, 28), 5.0))
    notes = notes_of(path)
    assert not any("silent" in note for note in notes)
    assert any("the recording holds 1 scan" in note for note in notes)


def test_from_a_few_scans_no_level_of_contact_is_named(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(0, 100, (60, 28))
    short, long = (
        next(
            note for note in notes_of(save(tmp_path / f"{scans}.npz", values[:scans])) if note.startswith("no contact")
        )
        for scans in (1, 60)
    )
    assert "is unknown from so short a recording" in short
    assert "contact begins at" not in short
    assert "contact begins at" in long


def test_zeros_are_shown_without_a_sign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = save(tmp_path / "a.npz", np.full((60, 28), -0.0))
    assert main(["info", str(path), "--sensor", "grid:4x7@10mm"]) == 0
    said = capsys.readouterr()
    assert "0..0" in said.out
    assert "-0" not in said.out.replace(str(path), "")
    assert "all readings are 0 count" in said.err


def test_numbers_that_no_sensor_sends_are_noted_once(tmp_path: Path) -> None:
    notes = notes_of(save(tmp_path / "a.npz", np.full((6000, 28), 1e300)))
    says = "numbers beyond 1e+30 are taken as missing readings, such as 1e+300: check how the recording was written"
    assert notes.count(says) == 1
    assert any(note.endswith("no taxel has readings") for note in notes)


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_what_usually_stands_for_a_missing_reading_is_not_doubted(tmp_path: Path, missing: float) -> None:
    values = grasp(3000.0, 2.0)
    values[30:40, 3] = missing
    assert not any("beyond" in note for note in notes_of(save(tmp_path / "a.npz", values)))


def test_the_largest_numbers_that_are_taken_overflow_nothing(tmp_path: Path) -> None:
    notes_of(save(tmp_path / "a.npz", np.full((60, 28), 1e30)))  # warnings are errors
