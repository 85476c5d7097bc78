"""Gains of the taxels, estimated with the map."""

import numpy as np

from taxelflow.estimation.template.hypotheses import solve
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.taxel_gains import with_gains

NOISE, PEAK = 150.0, 40e3
BUMPS = ((0.0, 0.0, 1.0), (1.6, 0.9, 0.7), (-1.1, 1.4, 0.8), (0.6, -1.7, 0.6))


def sliding(spread: float, seed: int = 0) -> tuple[Scanned, np.ndarray, np.ndarray]:
    """Four bumps that slide by 3 pitches over 12 x 12 taxels whose gains scatter; their places, and the gains."""
    random = np.random.default_rng(seed)
    axis = np.arange(12) - 5.5
    places = np.stack([part.ravel() for part in np.meshgrid(axis, -axis)])
    at = np.stack([np.linspace(-1.5, 1.5, 40), np.linspace(-0.4, 0.4, 40)], axis=1)
    gains = 1.0 + spread * random.normal(size=places.shape[1])
    true = sum(
        height * np.exp(-0.5 * ((places[0] - at[:, :1] - x) ** 2 + (places[1] - at[:, 1:] - y) ** 2))
        for x, y, height in BUMPS
    )
    readings = np.maximum(PEAK * true * gains + random.normal(0, NOISE, true.shape), 0.0)
    variance = np.full(readings.shape, NOISE**2)
    full = np.full(places.shape[1], np.inf)
    scanned = Scanned.of(0.02 * np.arange(40), places, readings, variance, full, np.zeros(places.shape[1]))
    return scanned, at, gains


def error(states: np.ndarray, at: np.ndarray) -> float:
    off = states[:, :2] - at
    return float(np.sqrt(np.mean((off - off.mean(axis=0)) ** 2)))


def test_gains_that_scatter_are_found_and_poses_are_better() -> None:
    scanned, at, gains = sliding(0.1)
    raw = scanned.readings
    before = solve(scanned)
    after = with_gains(scanned, before)
    assert error(after.states, at) < 0.85 * error(before.states, at)
    found = raw.sum(axis=0) / scanned.readings.sum(axis=0)
    loaded = raw.max(axis=0) > 0.3 * PEAK
    assert np.corrcoef(found[loaded], gains[loaded])[0, 1] > 0.7
    assert after.error < 0.5 * before.error


def test_equal_gains_change_nothing() -> None:
    scanned, _, _ = sliding(0.0)
    readings, before = scanned.readings, solve(scanned)
    assert with_gains(scanned, before) is before
    assert scanned.readings is readings
