"""What the map's own error adds to the poses of a contact."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.template import map_doubt
from taxelflow.estimation.template.bundle_adjustment import linearised
from taxelflow.estimation.template.hypotheses import coarse
from taxelflow.estimation.template.map import Pattern, covering, fill
from taxelflow.estimation.template.map_doubt import of_map
from taxelflow.estimation.template.normal_equations import Normal, assemble
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.pose_output import poses_of
from taxelflow.messages import Floats
from taxelflow.numerics.banded import add_diagonal, multiply, smoothness
from taxelflow.numerics.bspline import KNOTS, STATE

ERROR = 0.01


def sliding(scans: int) -> tuple[Pattern, Scanned, Floats, Floats]:
    """A pattern of two bumps, scans of it on its way over a small pad, their states, and the states' precision."""
    axis = np.arange(4) - 1.5
    places = np.stack([part.ravel() for part in np.meshgrid(axis, axis)])
    states = np.zeros((scans, STATE))
    states[:, 0], states[:, 2], states[:, 3] = np.linspace(-0.6, 0.6, scans), np.linspace(-0.1, 0.1, scans), 1.0
    x = places[0] - states[:, :1]
    readings = 1e3 * (np.exp(-((x - 0.7) ** 2) - places[1] ** 2) + 0.7 * np.exp(-((x + 0.9) ** 2)))
    count = places.shape[1]
    scanned = Scanned.of(
        np.arange(float(scans)), places, readings, np.full((scans, count), 9.0), np.full(count, np.inf), np.zeros(count)
    )
    pattern = covering(scanned, states)
    fill(pattern, scanned.with_error(ERROR), states)
    return pattern, scanned, states, scanned.precision(turns=True, gain_std=0.1)


def whole_covariance(pattern: Pattern, scanned: Scanned, states: Floats, precision: Floats) -> Floats:
    """(scans, 5, 5), of the states, by inversion of the whole problem, the mean of the poses held."""
    scans, knots = len(states), pattern.coefficients.size
    fixed = np.isinf(precision)
    normal = Normal.empty(scans, scanned.places.shape[1], knots)
    assemble(pattern.surface, scanned.with_error(ERROR), states, np.where(fixed, 0.0, 1.0), 0.0, normal)
    stencil = normal.stencil + pattern.smoothing * smoothness(pattern.shape)
    add_diagonal(stencil, pattern.prior)
    whole = np.zeros((scans * STATE + knots, scans * STATE + knots))
    for knot, unit in enumerate(np.eye(knots)):
        multiply(stencil, pattern.shape[1], unit, whole[scans * STATE + knot, scans * STATE :])
    for row, k in enumerate(np.nonzero(normal.w)[0]):
        knot = scans * STATE + normal.first[row] + np.arange(KNOTS) // 4 * pattern.shape[1] + np.arange(KNOTS) % 4
        own = slice(k * STATE, (k + 1) * STATE)
        mixed = np.outer(normal.pull[row], normal.weight[row])
        whole[own, knot] += mixed
        whole[knot, own] += mixed.T
    for k in range(scans):
        own = slice(k * STATE, (k + 1) * STATE)
        whole[own, own] = normal.blocks[k] + np.diag(np.where(fixed, 1.0, precision) + 1e-9)
    of_states = np.linalg.inv(whole)[: scans * STATE, : scans * STATE]
    mean = np.zeros((scans * STATE, 3))
    for part in range(3):
        mean[part::STATE, part] = 1.0
    along = of_states @ mean
    of_states -= along @ np.linalg.solve(mean.T @ along, along.T)
    return np.stack([of_states[k : k + STATE, k : k + STATE] for k in range(0, scans * STATE, STATE)])


@pytest.mark.parametrize(("scans", "more_knots"), [(12, True), (120, False)])
def test_it_is_what_the_whole_problem_has_beyond_a_known_map(scans: int, *, more_knots: bool) -> None:
    pattern, scanned, states, precision = sliding(scans)
    assert (pattern.coefficients.size > scans * STATE) == more_knots
    linear = linearised(pattern, scanned, states, ERROR, precision)
    held = np.linalg.inv(linear.normal.blocks)
    added = of_map(linear, precision)
    whole = whole_covariance(pattern, scanned, states, precision)[:, :4, :4]
    assert (held + added)[:, :4, :4] == pytest.approx(whole, rel=1e-4, abs=1e-9)
    assert (np.diagonal(added, axis1=1, axis2=2)[:, :2].mean(axis=0) > 0).all()


def test_a_turn_that_is_held_has_none() -> None:
    pattern, scanned, states, _ = sliding(6)
    held = scanned.precision(turns=False, gain_std=0.1)
    added = of_map(linearised(pattern, scanned, states, ERROR, held), held)
    assert (added[:, 2] == 0).all()
    assert (added[:, 0, 0] != 0).all()


def test_of_very_many_scans_and_knots_the_map_is_held_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_doubt, "_MOST", 100)
    pattern, scanned, states, precision = sliding(6)
    assert not of_map(linearised(pattern, scanned, states, ERROR, precision), precision).any()


def test_the_information_of_the_scans_stays_as_it_is() -> None:
    pattern, scanned, states, precision = sliding(6)
    linear = linearised(pattern, scanned, states, ERROR, precision)
    before = linear.normal.blocks.copy()
    of_map(linear, precision)
    np.testing.assert_array_equal(linear.normal.blocks, before)


def test_poses_have_it_and_steps_between_them_do_not() -> None:
    _, scanned, states, precision = sliding(12)
    solved = coarse(scanned, states, turns=True)
    information = linearised(solved.pattern, scanned, solved.states, ERROR, precision).normal.blocks
    poses = poses_of(solved, scanned, information, 2.0)
    error = np.tile(np.diag([0.01, 0.02, 0.03, 0.1, 0.1]) ** 2, (12, 1, 1))
    wide = poses.with_map(error, solved, scanned, 2.0)
    arm = solved.middle(scanned)
    place, far = 2.0**2 * (0.01**2 + 0.02**2), 2.0**2 * (arm @ arm) * 0.03**2
    added = np.diagonal(wide.covariance - poses.covariance, axis1=1, axis2=2)
    assert added[:, :2].sum(axis=1) == pytest.approx(place + far, rel=1e-6)
    assert added[:, 2] == pytest.approx(0.03**2, rel=1e-6)
    heard = np.ones(len(poses), np.bool_)
    assert wide.steps(scanned.t_s, heard)[1][1:] == pytest.approx(
        poses.steps(scanned.t_s, heard)[1][1:], rel=1e-6, abs=1e-9
    )


@pytest.mark.parametrize("turns", [True, False])
def test_what_takes_all_of_a_covariance_away_leaves_no_variance_below_0(*, turns: bool) -> None:
    _, scanned, states, precision = sliding(12)
    solved = coarse(scanned, states, turns=turns)
    information = linearised(solved.pattern, scanned, solved.states, ERROR, precision).normal.blocks
    poses = poses_of(solved, scanned, information, 2.0)
    taken = -np.linalg.inv(information) * (1.0 + 1e-11)  # as of a single scan, with an error of rounding
    left = np.diagonal(poses.with_map(taken, solved, scanned, 2.0).covariance, axis1=1, axis2=2)
    assert (left[:, : 3 if turns else 2] > 0.0).all()
    assert (left[:, :2] < 1e-8 * np.diagonal(poses.covariance, axis1=1, axis2=2)[:, :2]).all()


@pytest.mark.parametrize("turns", [True, False])
def test_what_takes_more_than_a_bridged_pose_has_left_takes_nothing(*, turns: bool) -> None:
    """The map's part is that of a scan by itself, of which the scans around it have taken most."""
    _, scanned, states, precision = sliding(12)
    solved = coarse(scanned, states, turns=turns)
    information = linearised(solved.pattern, scanned, solved.states, ERROR, precision).normal.blocks
    poses = poses_of(solved, scanned, information, 2.0)
    poses.covariance[4] *= 0.01
    taken = np.zeros((12, STATE, STATE))
    taken[4] = -0.1 * np.linalg.inv(information[4])
    wide = poses.with_map(taken, solved, scanned, 2.0)
    axes = 3 if turns else 2
    np.testing.assert_allclose(wide.covariance[:, :axes, :axes], poses.covariance[:, :axes, :axes], rtol=1e-9)
