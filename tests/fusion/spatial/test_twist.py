"""The parts of a twist in space, against the definitions written out with NumPy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from taxelflow.fusion.spatial.robust import Verdict
from taxelflow.fusion.spatial.solve import Contacts, room
from taxelflow.fusion.spatial.twist import (
    centre_of,
    doubt_all,
    fill_information,
    fill_joints,
    fill_rows,
    unscale,
    usual_misfit,
    widen,
)
from taxelflow.numerics.geometry import se3_of

if TYPE_CHECKING:
    from taxelflow.messages import Floats

RANDOM = np.random.default_rng(0)
FRAMES = np.array([se3_of(RANDOM.normal(0, 0.05, 3), RANDOM.normal(0, 1, 4)) for _ in range(4)])
LENGTH_M = 0.04
CENTRE = FRAMES[:, :3, 3].mean(axis=0)
TWIST = np.array([0.01, -0.02, 0.03, 0.5, -0.4, 0.3])
SHIFT = np.eye(6)
"""From the twist at the centre to that at the hand's origin: v + centre x omega."""
SHIFT[:3, 3:] = np.cross(CENTRE, np.eye(3)).T
SCALE = np.diag([1.0] * 3 + [LENGTH_M] * 3)


def rows() -> Floats:
    found = np.zeros((4, 3, 6))
    fill_rows(FRAMES, CENTRE, LENGTH_M, found)
    return found


def seen(frame: Floats, twist: Floats) -> Floats:
    """(3,): velocity of a twist at the hand's origin where a contact is, along its x and y, and rate about its z."""
    velocity = twist[:3] + np.cross(twist[3:], frame[:3, 3])
    return np.array([frame[:3, 0] @ velocity, frame[:3, 1] @ velocity, frame[:3, 2] @ twist[3:]])


def sixfold() -> Any:
    return SimpleNamespace(value=np.zeros(6), covariance=np.zeros((6, 6)), blind=np.zeros((6, 6)), rank=0.0)


def test_the_centre_is_the_mean_of_known_contacts() -> None:
    known = np.array([True, False, True, True])
    np.testing.assert_allclose(centre_of(FRAMES, known), FRAMES[known, :3, 3].mean(axis=0))
    np.testing.assert_array_equal(centre_of(FRAMES, np.zeros(4, np.bool_)), 0.0)


def test_rows_and_joints_see_what_a_twist_moves_at_each_contact() -> None:
    scaled = SCALE @ np.linalg.solve(SHIFT, TWIST)
    J = np.stack([TWIST, 2.0 * TWIST], axis=1) * np.ones((4, 1, 1))
    contacts = Contacts(rows(), np.zeros((4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, 2)), np.zeros(2), np.ones(4))
    fill_joints(J, 0.1, CENTRE, LENGTH_M, contacts)
    for pad in range(4):
        np.testing.assert_allclose(contacts.rows[pad] @ scaled, seen(FRAMES[pad], TWIST), atol=1e-12)
        np.testing.assert_allclose(contacts.G[pad].T, np.outer([1.0, 2.0], seen(FRAMES[pad], TWIST)), atol=1e-12)
    np.testing.assert_allclose(contacts.sure, 100.0)


@pytest.mark.parametrize("turn_variance", [3.0, np.nan])
def test_information_is_the_inverse_of_what_is_known(turn_variance: float) -> None:
    covariance = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, turn_variance]])
    n = 3 if turn_variance > 0 else 2
    found, none = np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    fill_information(covariance, True, found)
    fill_information(covariance, False, none)
    expected = np.zeros((3, 3))
    expected[:n, :n] = np.linalg.inv(covariance[:n, :n])
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_array_equal(none, 0.0)


def test_a_velocity_without_noise_is_known_to_a_nanometre_per_second() -> None:
    found = np.zeros((3, 3))
    fill_information(np.diag([0.0, 1.0, np.nan]), True, found)
    assert found[0, 0] == pytest.approx(1e18)


def test_the_solution_is_moved_to_the_hands_origin_and_names_what_it_does_not_know() -> None:
    solution, out = room(4, 0), sixfold()
    to_origin = SHIFT @ np.linalg.inv(SCALE)
    root = RANDOM.normal(size=(6, 6))
    solution.xi[:], solution.covariance[:] = np.linalg.solve(to_origin, TWIST), root @ root.T
    limit = 0.1
    solution.values[:] = np.array([0.9, 1.1, 5.0, 0.0, 200.0, 1e6]) / limit**2  # inverse variances
    solution.vectors[:] = RANDOM.normal(size=(6, 6))
    unscale(solution, Verdict(4, 0.0, 0.0, False, 0), CENTRE, LENGTH_M, limit, out)
    np.testing.assert_allclose(out.value, TWIST)
    np.testing.assert_allclose(out.covariance, to_origin @ root @ root.T @ to_origin.T)
    np.testing.assert_allclose(out.blind[:2], (to_origin @ solution.vectors[:, [0, 3]]).T)
    np.testing.assert_array_equal(out.blind[2:], 0.0)
    assert out.rank == 4


def test_a_misfit_is_significant_from_20_degrees_of_freedom_on_and_reaches_back_50_scans() -> None:
    assert usual_misfit(SimpleNamespace(chi2=60.0, freedom=19.9)) == 1.0  # type: ignore[arg-type]
    assert usual_misfit(SimpleNamespace(chi2=60.3, freedom=20.1)) == pytest.approx(3.0)  # type: ignore[arg-type]
    assert usual_misfit(SimpleNamespace(chi2=20.0, freedom=40.0)) == 1.0  # type: ignore[arg-type]
    past: Any = SimpleNamespace(chi2=0.0, freedom=0.0)
    for _ in range(1000):
        widen(past, 2.0, Verdict(6, 3.0, 4.0, False, 0), sixfold())
    assert past.freedom == pytest.approx(50 * 4.0)
    assert past.chi2 == pytest.approx(50 * 2.0 * 3.0)  # as it was before the usual misfit was allowed for


@pytest.mark.parametrize(
    ("chi2", "contradicted", "factor"), [(4.0, False, 1.0), (40.0, False, 2.0), (40.0, True, 10.0)]
)
def test_a_covariance_is_widened_by_what_its_misfit_exceeds_the_usual_one(
    chi2: float, contradicted: bool, factor: float
) -> None:
    """The usual misfit of 3 stays as it is, or becomes 6 with this scan."""
    after = 6.0 if chi2 > 4.0 else 3.0
    past: Any = SimpleNamespace(chi2=(after * 44.0 - 3.0 * chi2) / 0.98, freedom=40.0 / 0.98)
    out = sixfold()
    out.covariance[:] = np.eye(6)
    widen(past, 3.0, Verdict(6, chi2, 4.0, contradicted, 0), out)
    np.testing.assert_allclose(out.covariance, factor * np.eye(6))


def test_the_information_of_all_contacts_is_divided_by_the_usual_misfit() -> None:
    contacts = Contacts(rows(), np.zeros((4, 3)), np.ones((4, 3, 3)), np.zeros((4, 3, 0)), np.zeros(0), np.ones(4))
    doubt_all(contacts, 4.0)
    np.testing.assert_array_equal(contacts.W, 0.25)
