from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.scan_matching.interpolant import SPLINE_NOISE, Interpolant, interpolate
from taxelflow.estimation.scan_matching.matching import (
    DOF,
    Fit,
    Guess,
    Points,
    Surface,
    find,
    linearize,
    surroundings,
    take,
)
from taxelflow.messages import Floats

SIDE, CENTRE, NOISE = 12, 5.5, 1.0
X, Y = (axis.ravel().astype(np.float64) for axis in np.meshgrid(np.arange(SIDE), np.arange(SIDE)))
PLACES = np.stack([X, Y])
ORIGIN = np.array([CENTRE, CENTRE, 0.0])


def textured(x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> Floats:
    """A scan (taxels,) of an oblong bump with a side lobe, moved about the pad's middle."""
    dx, dy = X - CENTRE - x, Y - CENTRE - y
    u, v = np.cos(theta) * dx + np.sin(theta) * dy, np.cos(theta) * dy - np.sin(theta) * dx
    pressure: Floats = 500.0 * np.exp(-(u**2 / 9.0 + v**2 / 3.0)) + 300.0 * np.exp(
        -((u - 2.0) ** 2 + (v - 2.0) ** 2) / 2
    )
    return pressure


def problem(later: Floats, **more: Floats) -> tuple[Surface, Points]:
    """The scan at rest as a surface, and a later one as points."""
    spline = Interpolant.of("pad", PLACES, np.full(SIDE**2, NOISE**2))
    c = np.empty(spline.shape)
    interpolate(spline, textured(), c)
    lattice = spline.lattice - [0.0, CENTRE, CENTRE]
    surface = Surface(c, spline.variance, spline.variance, spline.unobserved, lattice, spline.unobservable)
    variance = np.full(SIDE**2, NOISE**2)
    ceiling = more.get("ceiling", np.full(SIDE**2, np.inf))
    chosen = surroundings(textured(), later, variance, variance, PLACES)
    return surface, take(chosen, later, variance, ceiling, PLACES, ORIGIN)


def fit_of(points: Points, state: Floats) -> Fit:
    count = len(points.taxel)
    return Fit(state, np.zeros((count, DOF)), np.empty(count), np.empty((DOF, DOF)), np.empty((DOF, DOF)))


def found(later: Floats, guess: Guess, *, turns: bool = True, **more: Floats) -> Floats:
    surface, points = problem(later, **more)
    state = np.zeros(5)
    find(surface, points, guess, False, turns, state)
    return state


def test_the_motion_and_the_gain_between_two_scans_are_found() -> None:
    state = found(1.3 * textured(0.4, -0.3, 0.08), Guess(0.4, -0.3, 1.3))
    np.testing.assert_allclose(state[:4], [0.4, -0.3, 0.08, 1.3], atol=0.02)
    assert state[4] == 0.0


def test_a_motion_of_pitches_is_found_from_that_of_the_centroid() -> None:
    for shift in ((2.5, 1.5), (4.0, -3.0)):
        np.testing.assert_allclose(found(textured(*shift), Guess(*shift, 1.0))[:2], shift, atol=0.03)
    alone = found(textured(4.0, -3.0), Guess(0.0, 0.0, 1.0))[:2]
    assert np.hypot(*(alone - [4.0, -3.0])) > 1.0  # from no motion alone it is not


def test_a_turn_that_may_not_be_is_0() -> None:
    assert found(textured(0.4, -0.3, 0.08), Guess(0.4, -0.3, 1.0), turns=False)[2] == 0.0


def test_saturated_readings_are_lower_bounds() -> None:
    ceiling = np.full(SIDE**2, 350.0)
    state = found(np.minimum(textured(0.4, -0.3), ceiling), Guess(0.4, -0.3, 1.0), ceiling=ceiling)
    np.testing.assert_allclose(state[:2], [0.4, -0.3], atol=0.02)


def test_taxels_within_a_pitch_and_a_half_of_the_loaded_ones_take_part() -> None:
    last, now = np.zeros(SIDE**2), np.zeros(SIDE**2)
    variance = np.ones(SIDE**2)
    last[3 * SIDE + 4], now[5 * SIDE + 6], now[11 * SIDE + 11] = 4.1, 4.1, 3.9
    variance[4 * SIDE + 5] = 0.0
    chosen = surroundings(last, now, variance, variance, PLACES)
    inside = (X >= 3) & (X <= 7) & (Y >= 2) & (Y <= 6)
    inside[4 * SIDE + 5] = False  # masked
    np.testing.assert_array_equal(chosen, np.flatnonzero(inside))


def test_the_normal_equations_are_those_of_the_jacobian_and_both_scans_noise() -> None:
    surface, points = problem(textured(0.1, 0.0))
    fit = fit_of(points, np.array([0.1, 0.0, 0.0, 1.0, 0.0]))
    chi, misfit, freedom = linearize(surface, points, fit)
    taking_part = fit.weight > 0
    np.testing.assert_allclose(fit.weight[taking_part], 1.0 / (NOISE**2 * (1.0 + SPLINE_NOISE.value)))
    np.testing.assert_allclose(fit.normal, (fit.jacobian * fit.weight[:, np.newaxis]).T @ fit.jacobian)
    assert freedom == taking_part.sum() - DOF
    assert misfit < chi < 0.5 * freedom
    np.testing.assert_array_equal(fit.noise_normal, fit.noise_normal.T)
    assert (np.diagonal(fit.noise_normal) < np.diagonal(fit.normal)).all()


def test_noise_of_the_surface_grows_with_the_gain_and_its_slopes_turn_with_the_lever() -> None:
    gain = 1.6
    surface, points = problem(gain * textured())
    fit = fit_of(points, np.array([0.0, 0.0, 0.0, gain, 0.0]))
    linearize(surface, points, fit)
    used = fit.weight > 0
    w, dx, dy = fit.weight[used], *points.places[:, used]
    np.testing.assert_allclose(w, 1.0 / (NOISE**2 * (1.0 + gain**2 * SPLINE_NOISE.value)))
    ones, none = np.ones_like(dx), np.zeros_like(dx)
    slopes = np.array([[ones, none], [none, ones], [-dy, dx]])  # what the slopes along x and y move
    share = w * SPLINE_NOISE.value * NOISE**2
    expected = np.zeros((DOF, DOF))
    expected[:3, :3] = np.einsum(
        "aik,bik,k->ab", slopes, slopes, share * gain**2 * SPLINE_NOISE.slope / SPLINE_NOISE.value
    )
    expected[3, 3] = share.sum()
    np.testing.assert_allclose(fit.noise_normal, expected, rtol=1e-9, atol=1e-9)


def test_a_reading_five_percent_off_the_surface_is_an_error_of_one_standard_deviation() -> None:
    later, peak = textured(), 5 * SIDE + 5
    later[peak] *= 1.05
    state = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    misfits = [linearize(*one, fit_of(one[1], state))[1] for one in (problem(later), problem(textured()))]
    assert misfits[0] - misfits[1] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("reading", "ceiling", "gain", "used"), [
    (0.0, np.inf, -0.1, False), (1.0, np.inf, -0.1, True), (0.0, np.inf, 0.1, True),
    (350.0, 350.0, 1.0, False), (349.0, 350.0, 1.0, True), (350.0, 350.0, 0.5, True),
])  # fmt: skip
def test_readings_at_their_limits_count_where_the_model_lies_within(
    reading: float, ceiling: float, gain: float, used: bool
) -> None:
    later, peak = textured(), 5 * SIDE + 5
    later[peak] = reading
    surface, points = problem(later, ceiling=np.full(SIDE**2, ceiling))
    fit = fit_of(points, np.array([0.0, 0.0, 0.0, gain, 0.0]))
    linearize(surface, points, fit)
    assert (fit.weight[int(np.flatnonzero(points.taxel == peak)[0])] > 0) == used


def test_an_outlier_is_held_down_and_counts_as_25() -> None:
    later = textured()
    later[5 * SIDE + 5] += 100.0
    surface, points = problem(later)
    clean = problem(textured())[1]
    state = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    one, other = fit_of(points, state), fit_of(clean, state)
    assert linearize(surface, points, one)[0] == pytest.approx(25.0 + linearize(surface, clean, other)[0], abs=0.1)
    outlier = int(np.flatnonzero(points.taxel == 5 * SIDE + 5)[0])
    z = 100.0 / np.sqrt(NOISE**2 * (1.0 + SPLINE_NOISE.value))
    assert one.weight[outlier] == pytest.approx(other.weight[outlier] * 5.0 / z, rel=0.02)


def test_knots_that_are_not_observed_and_clipped_readings_take_no_part() -> None:
    later = textured()
    later[0] = 0.0
    surface, points = problem(later)
    surface.unobserved[:] = True
    fit = fit_of(points, np.array([0.0, 0.0, 0.0, 1.0, 0.0]))
    assert linearize(surface, points, fit) == (0.0, 0.0, 1.0)
    assert not fit.weight.any()
