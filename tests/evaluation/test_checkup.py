from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import dome, grid_sensor, raw_scans, recorded
from taxelflow.acquire.base import Recording
from taxelflow.errors import RecordingCorrupt, RecordingTruncated, TimesNotIncreasing
from taxelflow.evaluation.checkup import Checkup, check_up
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.messages import Floats, RawScans

TWO = grid_sensor(4, 7, pads=2, full_scale=60e3)


def grasp(scans: int = 300) -> Floats:
    random = np.random.default_rng(0)
    values: Floats = random.normal(0, 100, (scans, 56))
    values[scans // 2 :] += dome(TWO, radius_m=0.006)
    return values


def checked(values: Floats, t_s: Floats | None = None) -> Checkup:
    return check_up(recorded(values, TWO, t_s))


def test_it_counts_scans_pads_and_taxels() -> None:
    checkup = checked(grasp())
    assert (checkup.scans, checkup.scans_promised, checkup.sensor, checkup.unit) == (300, 300, "grid", "Pa")
    assert [(pad.name, pad.rows, pad.cols, pad.taxels) for pad in checkup.pads] == [
        ("pad0", 4, 7, 28),
        ("pad1", 4, 7, 28),
    ]


def test_it_reports_range_and_noise_in_the_sensors_unit() -> None:
    sensor = grid_sensor(4, 7, pads=2, unit="kPa")
    values = grasp() / 1e3
    pad = check_up(recorded(values, sensor)).pads[0]
    assert pad.lowest == values[:, :28].min()
    assert pad.highest == values[:, :28].max()
    assert pad.noise == pytest.approx(0.1, rel=0.15)


def test_it_counts_the_scans_in_contact_per_pad() -> None:
    assert [pad.contact_scans for pad in checked(grasp()).pads] == [150, 0]


def test_the_rate_and_its_jitter_leave_gaps_out() -> None:
    random = np.random.default_rng(0)
    steps = 0.1 + random.normal(0, 0.003, 299)
    steps[[100, 200]] = [1.5, 0.7]
    checkup = checked(grasp(), np.concatenate([[50.0], 50 + np.cumsum(steps)]))
    assert checkup.rate_hz == pytest.approx(10, rel=0.01)
    assert checkup.jitter_s == pytest.approx(0.003, rel=0.15)
    assert checkup.gaps == 2
    assert checkup.longest_gap_s == pytest.approx(1.5)
    assert checkup.duration_s == pytest.approx(float(steps.sum()))


def test_an_even_rate_has_no_jitter_and_no_gaps() -> None:
    checkup = checked(grasp())
    assert checkup.rate_hz == pytest.approx(10)
    assert checkup.jitter_s == pytest.approx(0, abs=1e-8)
    assert (checkup.gaps, checkup.longest_gap_s) == (0, 0.0)


def test_rate_and_gaps_do_not_depend_on_blocks() -> None:
    random = np.random.default_rng(0)
    t_s = np.cumsum(random.uniform(0.08, 0.12, 300))
    t_s[200:] += 2
    one, other = (check_up(recorded(grasp(), TWO, t_s, block=block)) for block in (300, 64))
    assert one.gaps == other.gaps == 1
    assert one.rate_hz == pytest.approx(other.rate_hz)
    assert one.jitter_s == pytest.approx(other.jitter_s)


def test_a_single_scan_has_no_rate() -> None:
    checkup = checked(grasp()[-1:])
    assert checkup.rate_hz is None
    assert checkup.jitter_s is None
    assert checkup.duration_s == 0


def test_idle_taxels_are_listed_by_number() -> None:
    checkup = checked(grasp())
    touched = np.flatnonzero(dome(TWO, radius_m=0.006) > 1500)
    assert not set(checkup.pads[0].idle_taxels) & set(touched.tolist())
    assert 0 in checkup.pads[0].idle_taxels
    assert checkup.pads[1].idle_taxels == list(range(28, 56))


def test_saturated_taxels_are_listed_by_number() -> None:
    values = grasp()
    values[250, [9, 37]] = 60e3
    checkup = checked(values)
    assert [pad.saturated_taxels for pad in checkup.pads] == [[9], [37]]


def test_without_a_full_scale_nothing_saturates() -> None:
    checkup = check_up(recorded(grasp(), grid_sensor(4, 7, pads=2)))
    assert not any(pad.saturated_taxels for pad in checkup.pads)


def test_missing_readings_are_counted_and_dead_taxels_masked() -> None:
    values = grasp()
    values[:, 30] = np.nan
    values[10:15, 2] = np.nan
    checkup = checked(values)
    assert [pad.missing_readings for pad in checkup.pads] == [5, 300]
    assert [pad.masked for pad in checkup.pads] == [0, 1]
    assert 30 not in checkup.pads[1].idle_taxels


def test_a_pad_that_is_dead_has_no_range() -> None:
    values = grasp()
    values[:, 28:] = np.nan
    pad = checked(values).pads[1]
    assert (pad.lowest, pad.highest, pad.noise, pad.masked, pad.contact_scans) == (None, None, None, 28, 0)


def test_repeated_stamps_are_counted() -> None:
    t_s = np.arange(300) / 10
    t_s[5] = t_s[4]
    checkup = checked(grasp(), t_s)
    assert (checkup.scans, checkup.repeated_scans) == (299, 1)


def test_a_loss_is_reported() -> None:
    def broken_off() -> Iterator[RawScans]:
        yield raw_scans(grasp(40))
        raise RecordingTruncated("memory", 40, 300, "cable pulled")  # type: ignore[arg-type]

    checkup = check_up(Recording("memory", "memory", TWO, broken_off, scans=300))
    assert checkup.scans == 40
    assert "40 of 300" in str(checkup.loss)


def test_times_that_run_backwards_are_an_error() -> None:
    with pytest.raises(TimesNotIncreasing):
        checked(grasp(), -np.arange(300.0))


def test_it_reads_the_recording_once() -> None:
    read_times = 0

    def counted() -> Iterator[RawScans]:
        nonlocal read_times
        read_times += 1
        yield raw_scans(grasp())

    check_up(Recording("memory", "memory", TWO, counted))
    assert read_times == 1


def test_damage_in_the_middle_is_an_error_as_for_every_reader() -> None:
    def broken() -> Iterator[RawScans]:
        yield raw_scans(grasp(40))
        raise RecordingCorrupt("memory", "half a scan", "record it again")

    with pytest.raises(RecordingCorrupt, match="half a scan"):
        check_up(Recording("memory", "memory", TWO, broken))


@pytest.mark.parametrize("scans", [5, 12, 100, 1003])
def test_contact_is_counted_exactly_where_the_sample_holds_every_scan(scans: int) -> None:
    small = grid_sensor(4, 7, full_scale=60e3)
    values = np.random.default_rng(0).normal(0, 100, (scans, 28))
    values[scans // 3 :] += dome(small)
    assert check_up(recorded(values, small)).pads[0].contact_scans == scans - scans // 3


@pytest.mark.long
def test_contact_in_a_long_recording_is_scaled_up_from_the_sample() -> None:
    small = grid_sensor(4, 7, full_scale=60e3)
    values = np.random.default_rng(0).normal(0, 100, (20_000, 28))
    values[5000:10_000] += dome(small)
    assert check_up(recorded(values, small)).pads[0].contact_scans == pytest.approx(5000, rel=0.15)


def test_repeated_scans_are_counted_and_the_true_rate_is_reported() -> None:
    values = np.repeat(grasp(), 3, axis=0)
    checkup = checked(values, np.arange(900) / 90)
    assert checkup.rate_hz == pytest.approx(90)
    assert checkup.new_rate_hz == pytest.approx(30, rel=0.02)
    assert 560 < checkup.repeated_values <= 600


def test_the_idle_drift_is_that_of_the_idle_scans() -> None:
    values = grasp(600) + np.linspace(0, 300, 600)[:, np.newaxis]
    pads = checked(values).pads
    assert pads[1].idle_drift == pytest.approx(300, rel=0.1)
    assert pads[0].idle_drift == pytest.approx(300, rel=0.25)
    assert pads[1].idle_drift_std is not None
    assert 0 < pads[1].idle_drift_std < 30


def test_a_steady_sensor_has_no_drift_beyond_its_error() -> None:
    pad = checked(grasp()).pads[1]
    assert pad.idle_drift is not None
    assert pad.idle_drift_std is not None
    assert abs(pad.idle_drift) < 4 * pad.idle_drift_std


def test_what_is_clipped_while_idle_shows_no_drift() -> None:
    values = np.zeros((300, 56))
    values[150:] += dome(TWO)
    assert [pad.idle_drift for pad in checked(values).pads] == [None, None]


def test_the_largest_load_is_a_force() -> None:
    values = grasp()
    pads = checked(values).pads
    assert pads[0].load_n == pytest.approx(float(dome(TWO, radius_m=0.006).sum()) * 1e-4, rel=0.1)
    assert pads[1].load_n is None
    counting = grid_sensor(4, 7, pads=2, unit="count")
    assert check_up(recorded(values, counting)).pads[0].load_n is None


def test_the_picture_is_of_the_highest_readings_and_marks_name_faults() -> None:
    sensor = grid_sensor(4, 7, missing=((0, 0),), full_scale=60e3)
    values = np.random.default_rng(0).normal(0, 100, (300, 27))
    values[150:] += dome(sensor, radius_m=0.006)
    values[:, 20] = np.nan
    values[:, 2] = 0.0
    values[200, 10] = 60e3
    pad = check_up(recorded(values, sensor)).pads[0]
    assert [len(row) for row in pad.picture] == [7] * 4
    assert (pad.picture[0][0], pad.marks[0][0]) == (None, " ")
    place = sensor.layout.row, sensor.layout.col
    marks = "".join(pad.marks[row][col] for row, col in zip(*place, strict=True))
    assert (marks[2], marks[10], marks[20], marks[0]) == ("!", "F", "!", ".")
    assert "o" in marks
    assert pad.picture[int(place[0][10])][int(place[1][10])] == pytest.approx(60e3, rel=0.02)
    assert [(found.taxel, found.fault) for found in pad.findings] == [(2, "stuck"), (20, "silent")]


def test_a_finding_is_in_the_sensors_unit_and_words() -> None:
    sensor = grid_sensor(4, 7, unit="kPa", full_scale=60.0)
    values = np.random.default_rng(0).normal(0, 0.1, (300, 28))
    values[:, 9] = 20.0
    found = check_up(recorded(values, sensor)).pads[0].findings[0]
    assert (found.taxel, found.row, found.col, found.fault, found.value, found.scans) == (9, 1, 2, "stuck", 20.0, 300)
    assert found.words == "taxel 9 (pad0, row 1, col 2) stuck at 20 kPa in 300 scans"


def test_a_pad_that_is_silent_as_a_whole_has_one_line() -> None:
    sensor = grid_sensor(4, 7)
    values = np.full((300, 28), np.nan)
    values[::3, 3] = 0.0
    pad = check_up(recorded(values, sensor)).pads[0]
    assert len(pad.findings) == 28
    assert pad.faults == ["all 28 taxels of pad0 silent in 67 % or more of 300 scans"]


@pytest.mark.long
def test_a_real_recording_is_well(recordings: Path) -> None:
    checkup = check_up(read(recordings / "sdh-dsa" / "slip_examples_pen_and_wooden_block.dsa"))
    assert checkup.scans == 6893
    assert checkup.rate_hz == pytest.approx(31.7, abs=0.5)
    assert not any(pad.saturated_taxels for pad in checkup.pads)
    assert sum(pad.contact_scans > 0 for pad in checkup.pads) == 2
    assert not any(pad.missing_readings or pad.masked or pad.findings for pad in checkup.pads)
    assert (checkup.gaps, checkup.repeated_values) == (0, 0)
