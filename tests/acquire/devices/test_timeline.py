"""One increasing clock out of a device's stamps: what is late, where it jumps, and where a gap begins."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.acquire.devices.base import Arrival, Faults
from taxelflow.acquire.devices.timeline import Timeline

VALUES = np.zeros(1)


class Clocked:
    """A timeline that is given stamps which come at once, or s after one another."""

    def __init__(self, *, paced: bool = True) -> None:
        self.faults = Faults()
        self.line = Timeline(self.faults, paced=paced)
        self._now_s = 0.0

    def place(self, *stamps_s: float, every_s: float = 0.0) -> list[float | None]:
        placed = []
        for stamp_s in stamps_s:
            self._now_s += every_s
            placed.append(self.line.place(Arrival(self._now_s, stamp_s, VALUES)))
        return placed


def steady(first_s: float, scans: int, step_s: float = 0.01) -> list[float]:
    return (first_s + step_s * np.arange(scans)).tolist()


def test_a_clock_set_back_begins_a_gap_though_the_scan_comes_at_once() -> None:
    clock = Clocked()
    clock.place(*steady(100.0, 20))
    times = clock.place(*steady(0.0, 5))
    assert times == pytest.approx([100.19 + 0.04 + 0.01 * k for k in range(5)])
    assert clock.line.gaps == 1
    assert clock.faults.counts == {"clock jumped": 1}


def test_after_a_clock_set_back_time_goes_on_by_the_computers_clock() -> None:
    clock = Clocked()
    clock.place(*steady(100.0, 20), every_s=0.01)
    assert clock.place(0.0, every_s=2.5) == pytest.approx([100.19 + 2.5])
    assert clock.line.gaps == 1


def test_a_clock_set_back_before_a_step_is_known_is_a_gap() -> None:
    clock = Clocked()
    assert clock.place(100.0, 0.0) == [100.0, 101.0]
    assert clock.line.gaps == 1


def test_a_clock_set_forward_keeps_its_stamps_and_begins_a_gap() -> None:
    clock = Clocked()
    clock.place(*steady(0.0, 20), every_s=0.01)
    assert clock.place(50.0, 50.01, every_s=0.01) == [50.0, 50.01]
    assert clock.line.gaps == 1
    assert clock.faults.counts == {"clock jumped": 1}


def test_one_wrong_stamp_costs_the_scans_that_it_overtakes() -> None:
    clock = Clocked()
    clock.place(*steady(100.0, 20), every_s=0.01)
    stamps = [3.0, *steady(100.21, 6)]
    assert clock.place(*stamps, every_s=0.01) == pytest.approx([100.23, None, None, None, 100.24, 100.25, 100.26])
    assert clock.line.dropped == 3
    assert clock.faults.counts["clock jumped"] == 1


def test_a_recording_of_a_slow_sensor_that_is_replayed_quickly_does_not_jump_at_each_scan() -> None:
    clock = Clocked()
    stamps = steady(10.0, 30, 1.5)
    assert clock.place(*stamps, every_s=1e-5) == stamps
    assert clock.faults.counts["clock jumped"] == 3  # until a usual step is known
    assert clock.line.notes == []


def test_times_in_ms_are_reported_once_and_noted(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clocked()
    clock.place(*steady(0.0, 50, 10.0), every_s=0.01)
    assert clock.faults.counts["time unit doubted"] == 1
    (note,) = clock.line.notes
    assert "the times are likely in ms (?time-unit=ms for lines; else convert them to s)" in note
    assert "unless a recording is sent faster than it was made" in note  # 0.1 Hz in s looks the same
    assert sum(note in record.message for record in caplog.records) == 1


@pytest.mark.parametrize(("stamp", "unit"), [(1.7e12, "ms"), (1.7e15, "us"), (1.7e18, "ns")])
def test_times_since_1970_in_another_unit_are_named(stamp: float, unit: str, caplog: pytest.LogCaptureFixture) -> None:
    clock = Clocked()
    assert clock.place(stamp, stamp * (1 + 1e-9)) == [None, None]
    (record,) = caplog.records
    assert record.message.endswith(f"likely in {unit} (?time-unit={unit} for lines; else convert them to s)")


@pytest.mark.parametrize("step_s", [1.0, 10.0, 100.0])
def test_times_of_a_replay_are_not_compared_with_its_pace(step_s: float) -> None:
    clock = Clocked(paced=False)
    stamps = [*steady(0.0, 20, step_s), *steady(100 * step_s, 20, step_s)]
    assert clock.place(*stamps, every_s=1e-3 * step_s) == stamps
    assert clock.line.gaps == 1
    assert clock.line.notes == []
    assert clock.faults.counts == {}
