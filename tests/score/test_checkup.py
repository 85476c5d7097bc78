from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import dome, grid_sensor, raw_scans, recorded
from taxelflow.acquire.base import Recording
from taxelflow.api import read
from taxelflow.errors import RecordingTruncated, TimesNotIncreasing
from taxelflow.score.checkup import Checkup, check_up

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


def test_it_tells_the_range_and_noise_in_the_sensors_unit() -> None:
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


def test_a_loss_is_said() -> None:
    def broken_off() -> Iterator[RawScans]:
        yield raw_scans(grasp(40))
        raise RecordingTruncated("memory", 40, 300, "cable pulled")  # type: ignore[arg-type]

    checkup = check_up(Recording("memory", "memory", TWO, broken_off, scans=300))
    assert checkup.scans == 40
    assert "40 of 300" in str(checkup.loss)


def test_times_that_run_backwards_are_an_error() -> None:
    with pytest.raises(TimesNotIncreasing):
        checked(grasp(), -np.arange(300.0))


def test_a_real_recording_is_well(recordings: Path) -> None:
    checkup = check_up(read(recordings / "sdh-dsa" / "slip_examples_pen_and_wooden_block.dsa"))
    assert checkup.scans == 6893
    assert checkup.rate_hz == pytest.approx(31.7, abs=0.5)
    assert not any(pad.saturated_taxels for pad in checkup.pads)
    assert sum(pad.contact_scans > 0 for pad in checkup.pads) == 2
    assert not any(pad.missing_readings or pad.masked for pad in checkup.pads)
