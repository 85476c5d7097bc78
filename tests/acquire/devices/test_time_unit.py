from __future__ import annotations

import pytest

from taxelflow.acquire.devices.time_unit import TimeUnit


@pytest.mark.parametrize(
    ("rate_hz", "per_s", "unit"), [(100.0, 1e3, "ms"), (1000.0, 1e3, "ms"), (100.0, 1e6, "us"), (10.0, 1e9, "ns")]
)
@pytest.mark.parametrize("burst", [1, 5])
def test_times_in_another_unit_are_doubted_once(rate_hz: float, per_s: float, unit: str, burst: int) -> None:
    clock = TimeUnit()
    doubts = [clock.add(per_s / rate_hz, 0.0 if scan % burst else burst / rate_hz) for scan in range(60)]
    assert doubts.count(True) == 1
    assert f"likely in {unit} (?time-unit={unit}" in clock.doubt


@pytest.mark.parametrize(
    ("step_s", "passed_s"),
    [(0.01, 0.01), (2.0, 2.0), (1.0, 1e-4), (0.1, 1e-6), (300.0, 1.0)],
    ids=["live", "slow", "replayed", "replayed quickly", "no unit fits"],
)
def test_times_in_s_are_not_doubted(step_s: float, passed_s: float) -> None:
    clock = TimeUnit()
    assert not any(clock.add(step_s, passed_s) for _ in range(60))


def test_jumps_of_a_clock_are_no_unit() -> None:
    clock = TimeUnit()
    assert not any(clock.add(10.0 if scan % 4 else 0.01, 0.01) for scan in range(60))
    assert not any(clock.add(10.0 * 4.0**scan, 0.01) for scan in range(10))
