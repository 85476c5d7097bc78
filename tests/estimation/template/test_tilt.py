"""Poses of contacts whose load may tilt."""

import numpy as np
import pytest

from taxelflow.estimation.template.bundle_adjustment import linearised
from taxelflow.estimation.template.levenberg_marquardt import HELD, Prior, register
from taxelflow.estimation.template.linearization import pack_scan
from taxelflow.estimation.template.map import Pattern, covering, fill
from taxelflow.estimation.template.normal_equations import FIT_HUBER
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.tilt import shift_by_tilt, without_tilt
from taxelflow.messages import Floats

PEAK, NOISE = 40e3, 400.0
STILL = np.tile([0.0, 0.0, 0.0, 1.0, 0.0], (3, 1))
PRECISION = np.array([1e-6, 1e-6, np.inf, 1e-2, np.inf])
"""Prior of a state: angle and size are held."""


Bumps = tuple[tuple[float, float, float], ...]
"""x, y and height of each."""


def learned(bumps: Bumps, radius: float) -> tuple[Scanned, Pattern]:
    """Three scans of bumps at rest, in pitches, and their pattern."""
    axis = np.arange(14) - 6.5
    places = np.stack([part.ravel() for part in np.meshgrid(axis, -axis)])
    pressure = sum(
        height * np.maximum(1.0 - ((places[0] - x) ** 2 + (places[1] - y) ** 2) / radius**2, 0.0)
        for x, y, height in bumps
    )
    readings = np.repeat(PEAK * np.asarray(pressure)[np.newaxis], 3, axis=0)
    count = places.shape[1]
    variance = np.full(readings.shape, NOISE**2)
    scanned = Scanned.of(0.02 * np.arange(3), places, readings, variance, np.full(count, np.inf), np.zeros(count))
    pattern = covering(scanned, STILL)
    fill(pattern, scanned.with_error(0.01), STILL)
    return scanned, pattern


def informed(bumps: Bumps, radius: float, tilt_std: float, spikes: tuple[int, ...] = ()) -> tuple[Floats, Floats]:
    """Information (5, 5) on the state of bumps in one scan, in pitches, without and with a tilt of their load.

    spikes: taxels that read three times as much, once the pattern is known.
    """
    scanned, pattern = learned(bumps, radius)
    scanned.readings[:, list(spikes)] *= 3.0
    information = linearised(pattern, scanned, STILL, 0.01, PRECISION).normal.blocks
    own, _, _ = without_tilt(information, pattern, scanned, STILL, 0.01, tilt_std)
    return information[0], own[0]


def tilted(bumps: Bumps, radius: float, share: float) -> tuple[float, float]:
    """Along x, in pitches: where bumps at rest are found when their pressure changes by a share at a pitch from the
    centre, and where with a tilt.
    """
    scanned, pattern = learned(bumps, radius)
    scanned.readings[:] *= 1.0 + share * scanned.places[0]
    states = refined_places(pattern, scanned)
    information = linearised(pattern, scanned, states, 0.05, PRECISION).normal.blocks
    _, step, _ = without_tilt(information, pattern, scanned, states, 0.05, 0.05)
    return float(states[0, 0]), float(states[0, 0] + step[0, 0])


def refined_places(pattern: Pattern, scanned: Scanned) -> Floats:
    """States (scans, 5) that explain the scans best on a pattern that is known."""
    states, prior = STILL.copy(), Prior(STILL[0], np.where(np.isinf(PRECISION), HELD, PRECISION))
    variance = scanned.with_error(0.05).variance
    for k, state in enumerate(states):
        taxels = pack_scan(scanned.places, np.zeros((3, 0)), scanned.readings[k], variance[k], scanned.ceiling, 0.0)
        register(pattern.surface, taxels, prior, FIT_HUBER, 30, state, np.zeros((5, 5)))
    return states


def stds(bumps: Bumps, radius: float, tilt_std: float) -> Floats:
    """Standard deviations (2,) of x and y, in pitches, with a tilt."""
    _, own = informed(bumps, radius, tilt_std)
    deviations: Floats = np.sqrt(np.diagonal(np.linalg.inv(own))[:2])
    return deviations


DOME = ((0.0, 0.0, 1.0),)
FEET = ((-3.0, -3.0, 1.0), (3.0, -3.0, 0.9), (-3.0, 3.0, 0.8), (3.0, 3.0, 1.0))


def test_a_round_contact_is_known_less_well_the_more_its_load_may_tilt() -> None:
    level, some, more = (stds(DOME, 4.0, tilt_std) for tilt_std in (0.0, 0.05, 0.1))
    assert (some > 4.0 * level).all()  # by a tilt in proportion to the pressure alone, 2.1 times
    assert (more > some).all()


def test_what_stands_on_feet_is_where_its_edges_are() -> None:
    dome = stds(DOME, 4.0, 0.05) / stds(DOME, 4.0, 0.0)
    feet = stds(FEET, 1.6, 0.05) / stds(FEET, 1.6, 0.0)
    assert (feet < 1.5).all()
    assert (feet < dome).all()


def test_what_stands_on_feet_stays_when_its_load_tilts() -> None:
    found, with_tilt = tilted(FEET, 1.6, 0.03)
    assert abs(found) > 0.01
    assert abs(with_tilt) < 0.2 * abs(found)


def test_no_more_is_eliminated_than_outliers_have_shown() -> None:
    middle = tuple(14 * row + column for row in (5, 6, 7, 8) for column in (5, 6, 7, 8))
    held, own = informed(DOME, 4.0, 0.05, spikes=middle)
    assert np.linalg.eigvalsh(own).min() > -1e-6 * own.max()
    assert np.linalg.eigvalsh(held - own).max() > 0.0


def test_without_tilt_nothing_changes() -> None:
    information = np.eye(5)[np.newaxis]
    own, step, shift = without_tilt(information, None, None, np.ones((1, 5)), 0.05, 0.0)  # type: ignore[arg-type]
    np.testing.assert_array_equal(own, information)
    assert not step.any()
    assert not shift.any()


BAR = tuple((x, 0.0, 1.0) for x in np.linspace(-4.0, 4.0, 17))


def shifts_of(bumps: Bumps, radius: float) -> tuple[Floats, Pattern, Scanned]:
    """Covariance (2, 2) of a place that knows no tilt; the pattern, and the scans that it explains."""
    scanned, pattern = learned(bumps, radius)
    information = linearised(pattern, scanned, STILL, 0.05, PRECISION).normal.blocks
    return shift_by_tilt(information, pattern, scanned, STILL, 0.05, 0.05)[0], pattern, scanned


@pytest.mark.parametrize(("bumps", "radius"), [(DOME, 4.0), (FEET, 1.6), (BAR, 1.6)])
def test_a_place_that_knows_no_tilt_is_off_by_what_its_covariance_holds(bumps: Bumps, radius: float) -> None:
    found, pattern, scanned = shifts_of(bumps, radius)
    before, places = scanned.readings[0].copy(), scanned.places
    even = np.where(before > 0.03 * before.max(), 1.0, 0.0)
    squares, size = np.zeros(2), 0.0
    for weight in (before, even * before.sum() / even.sum()):
        share = weight / weight.sum()
        off = places - (places @ share)[:, np.newaxis]
        moment = off * share @ off.T
        size = size or float(np.sqrt(np.trace(moment) / 2))
        for axis in range(2):
            load = 0.02 * size * np.linalg.inv(moment)[axis]  # small enough that no pressure ends
            scanned.readings[:] = before + weight * (load @ off)
            squares[axis] += 0.5 * (refined_places(pattern, scanned)[0, axis] / 0.02) ** 2
    np.testing.assert_allclose(np.diagonal(found), 0.1**2 * squares, rtol=0.3)


def test_a_narrow_contact_rolls_and_what_has_edges_stays() -> None:
    """Across a bar its middle is where the load acts: the eccentricity is a share of its length, not of its width."""
    bar, _, scanned = shifts_of(BAR, 1.6)
    share = scanned.readings[0] / scanned.readings[0].sum()
    size = np.sqrt(share @ (scanned.places**2).sum(axis=0) / 2)  # its middle is that of the places
    assert np.sqrt(bar[1, 1]) == pytest.approx(0.1 * size, rel=0.2)
    feet, _, scanned = shifts_of(FEET, 1.6)
    share = scanned.readings[0] / scanned.readings[0].sum()
    assert np.sqrt(feet[1, 1]) < 0.02 * np.sqrt(share @ (scanned.places**2).sum(axis=0) / 2)
