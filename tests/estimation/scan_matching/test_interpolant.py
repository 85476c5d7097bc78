from __future__ import annotations

import numpy as np
import pytest

from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.scan_matching.interpolant import Interpolant, fill_missing, interpolate
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import evaluate

X, Y = (axis.ravel().astype(np.float64) for axis in np.meshgrid(np.arange(9), np.arange(7)))
PLACES = np.stack([X, Y])
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0])


def smooth(x: Floats, y: Floats) -> Floats:
    values: Floats = 100.0 * np.exp(-((x - 4.0) ** 2 + (y - 3.0) ** 2) / 8.0)
    return values


def through(spline: Interpolant, reading: Floats, places: Floats) -> Floats:
    """Values (n,) of the spline through a scan's readings at places (2, n)."""
    c, values = np.full(spline.shape, np.nan), np.empty((places.shape[1], 5))
    interpolate(spline, reading, c)
    evaluate(c, spline.lattice, places, STILL, np.zeros((3, 0)), values)
    return values[:, 0]


def test_the_spline_goes_through_the_readings_on_a_grid() -> None:
    spline = Interpolant.of("pad", PLACES, np.ones(63))
    np.testing.assert_allclose(through(spline, smooth(X, Y), PLACES), smooth(X, Y), atol=1e-2)


def test_it_bridges_a_masked_taxel() -> None:
    variance, reading = np.ones(63), smooth(X, Y)
    variance[30], reading[30] = 0.0, 0.0
    spline = Interpolant.of("pad", PLACES, variance)
    assert through(spline, reading, PLACES)[30] == pytest.approx(smooth(X, Y)[30], rel=0.05)
    assert spline.trust[30] == 0.0


def test_readings_count_by_their_noise() -> None:
    variance = np.where(X < 4, 4.0, 1.0)
    spline = Interpolant.of("pad", PLACES, variance)
    np.testing.assert_allclose(spline.trust, np.median(variance) / variance)


def test_knots_without_a_taxel_nearby_are_not_observed() -> None:
    spline = Interpolant.of("pad", PLACES, np.ones(63))
    assert not spline.unobserved[3:-3, 3:-3].any()
    assert spline.unobserved[0].all()
    assert spline.unobserved[:, 0].all()


def test_an_axis_across_a_line_of_taxels_is_not_observable() -> None:
    assert (Interpolant.of("pad", PLACES, np.ones(63)).unobservable == 0.0).all()
    line = Interpolant.of("pad", PLACES[:, :9], np.ones(9))
    assert line.unobservable[0] == 0.0
    assert line.unobservable[1] > 9.0  # anywhere on the pad


def test_missing_readings_are_filled_from_the_surface_that_has_moved() -> None:
    spline = Interpolant.of("pad", PLACES, np.ones(63))
    c, state = np.empty(spline.shape), np.array([0.5, -0.25, 0.1, 1.5, 0.0])
    interpolate(spline, smooth(X, Y), c)
    origin, noise, variance = np.array([4.0, 3.0, 0.0]), np.ones(63), np.ones(63)
    lattice = spline.lattice - [0.0, 4.0, 3.0]
    variance[[20, 30]] = noise[30] = 0.0  # one is missing, one masked
    reading = np.full(63, -1.0)
    fill_missing(c, lattice, PLACES, origin, noise, variance, state, reading)
    dx, dy = X[20] - 4.0 - state[0], Y[20] - 3.0 - state[1]
    cos, sin = np.cos(0.1), np.sin(0.1)
    expected = 1.5 * smooth(4.0 + cos * dx + sin * dy, 3.0 + cos * dy - sin * dx)
    assert reading[20] == pytest.approx(expected, rel=0.02)
    assert (np.delete(reading, 20) == -1.0).all()


def test_taxels_that_are_spread_too_thinly_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match="extent of palm"):
        Interpolant.of("palm", np.array([[0.0, 300.0], [0.0, 300.0]]), np.ones(2))
