"""What the pattern leaves unexplained, from scan to scan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from taxelflow.estimation.template.linearization import Packed, frame_of, look_up, pack_scan
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.hand import PadScan
from taxelflow.estimation.template.online.residual_process import decay, predict, update
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.numerics.bspline import STATE, evaluate
from taxelflow.numerics.records import Records, records

if TYPE_CHECKING:
    from taxelflow.messages import Floats

LATTICE = np.array([0.5, -6.0, -6.0])
PLACES = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(-3.0, 4.0), np.arange(-3.0, 4.0))])
TAXELS = PLACES.shape[1]
STATE_0 = np.array([0.2, -0.1, 0.0, 1.0, 0.0])
VARIANCE, NEVER = np.full(TAXELS, 0.25), np.full(TAXELS, np.inf)
WHOLE = np.zeros((3, 0))
SPAN_S = 0.01
ERROR = 0.4
"""Of the pattern."""


def pattern() -> Floats:
    """Coefficients of a bump."""
    knots = LATTICE[1] + LATTICE[0] * np.arange(25)
    x, y = np.meshgrid(knots, knots)
    bump: Floats = 100.0 * np.exp(-(x**2 + y**2) / 4)
    return bump


def values(coefficients: Floats | None = None) -> Floats:
    """(taxels,), what it reads."""
    out = np.empty((TAXELS, STATE))
    evaluate(pattern() if coefficients is None else coefficients, LATTICE, PLACES, STATE_0, WHOLE, out)
    return out[:, 0]


def part(reading: Floats, variance: Floats = VARIANCE, ceiling: Floats = NEVER) -> PadScan:
    return PadScan(reading, variance, ceiling, reading, PLACES, np.zeros(TAXELS, np.bool_), np.zeros((4, TAXELS)))


def track() -> Records:
    """One pad's memory, the object at STATE_0."""
    tracks = records(Track, 1)
    tracks["state"], tracks["usual"] = STATE_0, 1.0
    return tracks


@njit
def kept(
    surface: Surface,
    taxels: Packed,
    error: float,
    registered: float,
    still: bool,
    brought: Floats,
    rest: Floats,
    tracks: Records,
) -> float:
    frame, right = frame_of(surface.lattice, tracks[0].state), np.empty(STATE)
    look_up(surface, frame, taxels)
    return update(frame, taxels, error, registered, still, brought, rest, np.zeros(STATE), right, tracks[0])


def carried(readings: Floats, *, still: bool = False, ceiling: Floats = NEVER) -> tuple[Floats, Floats, list[float]]:
    """Rest (3, taxels), what was expected of the last reading, and chi-square on the pattern alone of all (scans,)."""
    rest, brought = np.zeros((3, TAXELS)), np.zeros((3, 0))
    surface, tracks = Surface(pattern(), np.zeros((25, 25)), LATTICE), track()
    expected, chis = values(), []
    for reading in readings:
        if chis:
            brought = np.empty((3, TAXELS))
            predict(SPAN_S, 0.0, rest, part(reading, ceiling=ceiling), brought)
            expected = values() + reading - brought[0]
        left = reading - expected
        registered = float(np.mean(left**2 / VARIANCE))
        taxels = pack_scan(PLACES, WHOLE, reading, VARIANCE, ceiling, ERROR)
        chi = kept(surface, taxels, ERROR, registered, still, brought, rest, tracks)
        chis.append(chi)
    return rest, expected, chis


def noisy(scans: int, deformed: Floats | float = 0.0) -> Floats:
    noise = np.random.default_rng(0).normal(0.0, 0.5, (scans, TAXELS))
    readings: Floats = values() + deformed + noise
    return readings


@pytest.mark.long
def test_nothing_is_carried_where_the_pattern_explains_the_scans() -> None:
    rest, _, chis = carried(noisy(10))
    assert (rest[0] == 0.0).all()
    assert np.mean(chis) < 1.5


@pytest.mark.long
def test_a_contact_that_is_deformed_is_expected_to_stay_so() -> None:
    dent = np.where(np.hypot(*(PLACES - 1.0)) < 1.5, -20.0, 0.0)
    readings = noisy(20, dent)
    rest, expected, chis = carried(readings)
    assert chis[-1] > 5.0  # the pattern is as wrong as ever, and that is not hidden
    np.testing.assert_allclose(rest[0][dent < 0], -20.0, atol=2.0)
    assert np.std(expected - readings[-1]) < 0.2 * np.std(values() - readings[-1])


@pytest.mark.long
def test_of_a_still_object_the_patterns_own_error_stays_too() -> None:
    moving, still = (carried(noisy(1), still=still)[0] for still in (False, True))
    assert (moving[2] == 0.0).all()
    np.testing.assert_allclose(np.sqrt(still[2]), ERROR)


@given(span=st.floats(0.0, 10.0), more=st.floats(0.01, 10.0), moved=st.floats(0.0, 5.0), further=st.floats(0.01, 5.0))
def test_a_rest_dies_away_with_time_and_motion(span: float, more: float, moved: float, further: float) -> None:
    assert decay(0.0, 0.0) == 1.0
    left = decay(span, moved)
    assert decay(span + more, moved) < left
    assert decay(span, moved + further) < left


def test_a_reading_of_nothing_leaves_nothing_where_the_pattern_is_below_zero() -> None:
    """The sensor clips at zero: how far below it the pattern lies is no error of the pattern."""
    readings = np.maximum(noisy(5, np.where(PLACES[0] > 0, -500.0, 300.0)), 0.0)
    rest, *_ = carried(readings)
    assert np.isfinite(rest).all()
    clipped = (readings[-1] == 0.0) & (values() <= 0.0)
    assert (rest[0][clipped] == 0.0).all()


def test_a_saturated_reading_has_no_residual_to_a_pattern_above_it() -> None:
    ceiling = np.full(TAXELS, 60.0)
    readings = np.minimum(noisy(5), ceiling)
    rest, _, chis = carried(readings, ceiling=ceiling)
    assert max(chis) < 1.5
    assert (rest[0][readings[-1] >= 60.0] == 0.0).all()


def test_the_residual_of_a_masked_taxel_dies_away() -> None:
    masked, tracks = VARIANCE.copy(), track()
    masked[7] = 0.0
    rest, brought, reading = np.ones((3, TAXELS)), np.empty((3, TAXELS)), noisy(1)[0]
    scan = pack_scan(PLACES, WHOLE, reading, masked, NEVER, ERROR)
    arguments = (Surface(pattern(), np.zeros((25, 25)), LATTICE), scan, ERROR)
    for _ in range(3):
        before = rest[0, 7]
        predict(SPAN_S, 0.0, rest, part(reading, masked), brought)
        kept(*arguments, 1.0, False, brought, rest, tracks)
        assert rest[0, 7] == pytest.approx(decay(SPAN_S, 0.0) * before)
    rest[0, 7] = 1.0  # of an earlier contact
    kept(*arguments, 1.0, False, np.zeros((3, 0)), rest, tracks)
    assert rest[0, 7] == 0.0


@pytest.mark.parametrize("reading", [0.0, 0.3, 200.0])
def test_a_taxel_off_the_lattice_has_no_rest_but_may_read_anything_next(reading: float) -> None:
    places, readings = PLACES.copy(), noisy(1)[0]
    places[0, 7], readings[7] = 50.0, reading
    rest, tracks = np.ones((3, TAXELS)), track()
    scan = pack_scan(places, WHOLE, readings, VARIANCE, NEVER, ERROR)
    arguments = (Surface(pattern(), np.zeros((25, 25)), LATTICE), scan, ERROR)
    kept(*arguments, 1.0, False, np.zeros((3, 0)), rest, tracks)
    assert rest[0, 7] == 0.0
    assert rest[1, 7] == max(reading**2, (0.1 * readings.max()) ** 2)


def test_a_masked_taxel_has_no_part_in_it() -> None:
    masked = VARIANCE.copy()
    masked[7] = 0.0
    rest, out = np.ones((3, TAXELS)), np.empty((3, TAXELS))
    predict(SPAN_S, 0.0, rest, part(noisy(1)[0], masked), out)
    assert out[1, 7] == 0.0
    assert out[1, 8] == pytest.approx(VARIANCE[8] + 1.0, rel=0.05)
