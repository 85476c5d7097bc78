"""Where taxels have looked at an object, and its pattern where none has."""

from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.extrapolation import coverage, extrapolate, near
from taxelflow.estimation.template.map import covering, fill
from taxelflow.estimation.template.observations import COARSE, Scanned
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import State


def scanned(*, slope: float = 0.0) -> Scanned:
    """A scan of 8 x 8 taxels, loaded along its left border, the more the farther up."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(8) - 3.5, np.arange(8) - 3.5))
    reading = np.where(x < -2.0, 50.0 + slope * y, 0.0)
    places, once = np.stack([x, y]), np.zeros(1)
    return Scanned.of(once, places, reading[None], np.ones((1, 64)), np.full(64, np.inf), np.zeros(64))


def at_rest() -> Floats:
    """(1, 5)."""
    return np.array([State(0.0, 0.0, 0.0, 1.0, 0.0)])


def levelled(scan: Scanned) -> tuple[tuple[Floats, Floats], Floats, Floats]:
    """Knots of the scan's pattern, and its coefficients before and after its margin was made level."""
    pattern = covering(scan, at_rest())
    fill(pattern, scan.with_error(COARSE), at_rest())
    steep = pattern.coefficients
    extrapolate(pattern, scan, at_rest())
    return pattern.knots, steep, pattern.coefficients


def test_taxels_observe_their_place_in_the_objects_frame() -> None:
    scan, state = scanned(), at_rest()
    scan.variance[0, 5] = 0.0
    state[0] = State(1.0, -2.0, np.pi / 2, 1.0, np.log(2.0))
    looked = coverage(scan, state)
    assert len(looked) == 63
    x, y = scan.places[:, 0]
    np.testing.assert_allclose(looked[0], [0.5 * (y + 2.0), -0.5 * (x - 1.0)])


def test_a_taxel_that_is_read_later_looks_from_where_the_object_was() -> None:
    scan = scanned()
    scan.bends = np.zeros((1, 3, 64))
    scan.bends[0, 0] = 0.25
    np.testing.assert_allclose(coverage(scan, at_rest()), scan.places.T - [0.25, 0.0])


def test_near_is_within_reach() -> None:
    x, y = np.arange(0.0, 5.0, 0.5), np.arange(0.0, 4.0, 0.5)
    close = near(np.array([[2.0, 1.0], [50.0, 1.0]]), x, y, 0.75)
    away = np.hypot(x - 2.0, y[:, np.newaxis] - 1.0)
    np.testing.assert_array_equal(close, away <= 0.75)


def test_a_margin_goes_on_level_where_no_taxel_looked_unless_it_is_loaded() -> None:
    scan = scanned(slope=10.0)
    (x, y), steep, level = levelled(scan)
    seen = np.ix_((y > -3.6) & (y < 3.6), (x > -3.6) & (x < 3.6))
    np.testing.assert_array_equal(level[seen], steep[seen])
    loaded, empty = int(np.argmin(np.abs(x + 3.5))), int(np.argmin(np.abs(x + 0.5)))
    np.testing.assert_array_equal(level[y > 3.6, loaded], steep[y > 3.6, loaded])
    beyond = level[y > 4.1, empty]
    assert np.ptp(steep[y > 4.1, empty]) > 0.0
    assert np.ptp(beyond) == 0.0


def test_between_far_taxels_a_pattern_is_as_it_was() -> None:
    scan = scanned()
    scan.places[0] *= 3.0
    (x, y), steep, level = levelled(scan)
    between = np.ix_(np.abs(y) < 3.6, np.abs(x) < 10.6)
    np.testing.assert_array_equal(level[between], steep[between])
