from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Floats
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.relief.faults import dead_taxels, delays, readings
from taxelflow.simulation.relief.parameters import SensorFaults

LAYOUT = load_sensor("grid:5x6@4mm,kPa").layout
TAXEL = 14  # row 2, column 2
RATE_HZ = 50.0


def read(pressure: Floats, seed: int = 0, **faults: Any) -> Floats:
    """Readings without noise and resolution unless asked for."""
    return readings(SensorFaults(**({"noise_pa": 0.0, "bits": 0} | faults)), LAYOUT, 0, pressure, RATE_HZ, seed)


def steps(*levels: tuple[int, float]) -> Floats:
    """The same pressure on every taxel: so many scans at each level."""
    return np.concatenate([np.full((scans, 30), level) for scans, level in levels])


def test_without_faults_readings_are_pressures() -> None:
    pressure = np.random.default_rng(0).uniform(0, 1e5, (7, 30))
    assert np.array_equal(read(pressure), pressure)


def test_cross_talk_adds_a_share_to_each_neighbour() -> None:
    pressure = np.zeros((1, 30))
    pressure[0, TAXEL] = 1e4
    found = read(pressure, cross_talk=0.05)[0].reshape(5, 6)
    expected = np.zeros((5, 6))
    expected[2, 2] = 1e4
    for row, col in ((1, 2), (3, 2), (2, 1), (2, 3)):
        expected[row, col] = 500.0
    assert found == pytest.approx(expected)


def test_relaxation_and_creep_approach_their_shares_with_their_time_constants() -> None:
    pressure = steps((10, 0.0), (2000, 1e4))
    slow = read(pressure, relaxation=0.3, relaxation_s=1.0)[10:, 0]
    assert slow[0] == pytest.approx(1e4, rel=0.01)
    assert slow[50] == pytest.approx(1e4 * (1 - 0.3 * (1 - np.exp(-1.0))), rel=0.01)
    assert slow[-1] == pytest.approx(0.7e4)
    rising = read(pressure, creep=0.1, creep_s=0.5)[10:, 0]
    assert rising[25] == pytest.approx(1e4 * (1 + 0.1 * (1 - np.exp(-1.0))), rel=0.01)
    assert rising[-1] == pytest.approx(1.1e4)


def test_hysteresis_reads_more_on_the_way_down_than_on_the_way_up() -> None:
    way = np.concatenate([np.linspace(0, 1e5, 101), np.linspace(1e5, 0, 101)])
    found = read(np.repeat(way[:, np.newaxis], 30, axis=1), hysteresis=0.2)[:, 0]
    up, down = found[50], found[151]
    assert up < 0.5e5 < down
    assert down - up == pytest.approx(0.2 * np.mean([min(0.25 * k, 0.5) for k in range(1, 5)]) * 1e5, rel=0.05)
    assert up == pytest.approx(0.5e5 - 0.2 * 0.3125e5)


def test_hysteresis_does_nothing_without_a_change() -> None:
    held = read(steps((5, 0.0), (40, 5e4)), hysteresis=0.2)
    assert (held[5:] == held[5]).all()


def test_gains_scatter_and_stay() -> None:
    found = read(np.full((50, 30), 1e4), gain_spread=0.1)
    assert (found == found[0]).all()
    assert 0.06 < (found[0] / 1e4).std() < 0.14
    assert not np.array_equal(found, read(np.full((50, 30), 1e4), seed=1, gain_spread=0.1))


def test_offsets_scatter_about_their_mean_and_are_clipped_at_0() -> None:
    found = read(np.zeros((3, 30)), offset_spread_pa=2e3, offset_pa=1e4)
    assert (found == found[0]).all()
    assert found[0].mean() == pytest.approx(1e4, abs=1.5e3)
    assert 1.2e3 < found[0].std() < 2.8e3
    clipped = read(np.zeros((3, 30)), offset_spread_pa=2e3)
    assert (clipped >= 0).all()
    assert 5 < (clipped[0] == 0).sum() < 25


def test_readings_end_at_full_scale_and_have_its_resolution() -> None:
    pressure = np.random.default_rng(1).uniform(0, 3e5, (20, 30))
    found = read(pressure, full_scale_pa=1.4e5, bits=6)
    assert found.max() == 1.4e5
    levels = found / (1.4e5 / 63)
    assert np.abs(levels - np.round(levels)).max() < 1e-9
    assert np.abs(found - np.minimum(pressure, 1.4e5)).max() <= 1.4e5 / 63 / 2 + 1e-6


def test_noise_is_as_large_as_asked_for_and_changes_nothing_else() -> None:
    pressure = np.full((400, 30), 5e4)
    noisy = read(pressure, noise_pa=300.0, gain_spread=0.1)
    assert noisy.std(axis=0).mean() == pytest.approx(300.0, rel=0.05)
    assert noisy.mean(axis=0) == pytest.approx(read(pressure, gain_spread=0.1)[0], abs=100.0)


def test_dead_taxels_read_no_pressure() -> None:
    pressure = np.full((4, 30), 1e4)
    pressure[:, :20] = 1e3
    found = read(pressure, dead=3, seed=5)
    assert np.array_equal(found[0] == 0, dead_taxels(SensorFaults(dead=3), pressure, 5))
    assert found[:, :20].all()
    assert (found == 0).sum() == 4 * 3


def test_taxels_are_read_row_by_row_where_asked_for() -> None:
    assert (delays(SensorFaults(), LAYOUT, 0, RATE_HZ) == 0).all()
    late_s = delays(SensorFaults(scan_share=0.5), LAYOUT, 0, RATE_HZ)
    assert late_s.reshape(5, 6) == pytest.approx(np.repeat(0.5 / RATE_HZ * np.arange(5)[:, np.newaxis] / 5, 6, axis=1))


@pytest.mark.parametrize("fault", [{"cross_talk": 1.5}, {"gain_spread": -0.1}, {"bits": 40}, {"creep_s": 0.0}])
def test_faults_out_of_range_are_refused(fault: dict[str, Any]) -> None:
    with pytest.raises(ParameterInvalid, match=r"faults\.\w+ must be"):
        SensorFaults(**fault)
