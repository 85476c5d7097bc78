from __future__ import annotations

import numpy as np
import pytest

from taxelflow.fusion.hand_frame import Carried
from taxelflow.fusion.twist import Equations, Row, fuse_twists, information_on_turn, spans_a_plane, turn_is_observable
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.geometry import turned
from taxelflow.numerics.records import Records, records, unknown

PLACES = np.array([[-0.08, 0.01], [0.07, 0.02], [0.0, -0.06], [0.02, 0.05]])
SPAN_S = 0.02


def carried(places: Floats, moved: Floats, turn: Floats, known: Bools) -> Carried:
    """Motion alone: what is not of it is not read."""
    return Carried(places, moved, turn, np.full_like(turn, np.nan), known, known, known)


def fused(
    moved: Floats,
    *,
    places: Floats = PLACES,
    variance: Floats | float = 1e-10,
    turn: tuple[float, float] = (np.nan, np.nan),
    known: list[bool] | None = None,
    turns: bool = True,
) -> Records:
    """The row of one scan in which pads have moved (pads, 2) with independent noise.

    places: (pads, 2), the middles of their ways.
    """
    pads = len(places)
    covariance = np.zeros((1, pads, 2, 2))
    covariance[0, :, [0, 1], [0, 1]] = np.broadcast_to(variance, (pads, 2)).T
    rows = unknown(Row, 1)
    flags = np.array([known or [True] * pads])
    own_turn = np.full((1, pads, 2), np.nan)
    own_turn[0, 0] = turn
    spans = np.full((1, pads), SPAN_S)
    here = carried((places + 0.5 * moved)[np.newaxis], moved[np.newaxis], own_turn, flags)
    fuse_twists(here, covariance, spans, turns, records(Equations, 1), rows)
    return rows[0]


def rigid(vx: float, vy: float, omega: float, places: Floats = PLACES) -> Floats:
    """What a rigid motion displaces in the time SPAN_S."""
    return SPAN_S * np.stack([vx - omega * places[:, 1], vy + omega * places[:, 0]], axis=1)


def least_squares(moved: Floats, std: Floats, places: Floats = PLACES) -> tuple[Floats, Floats]:
    """Twist (3,) and its covariance by NumPy. std: (pads, 2) of the displacements."""
    J = np.concatenate([np.array([[1.0, 0.0, -y], [0.0, 1.0, x]]) for x, y in places]) * SPAN_S / std.reshape(-1, 1)
    covariance = np.linalg.inv(J.T @ J)
    return covariance @ J.T @ (moved / std).ravel(), covariance


def test_an_object_that_turns_about_a_far_point_leaves_that_point_at_rest() -> None:
    centre, turn = np.array([0.5, -0.3]), 0.1
    before = turned(PLACES - centre, -turn) + centre
    row = fused(PLACES - before, places=0.5 * (PLACES + before))
    vx, vy, omega = row["velocity"]
    assert omega == pytest.approx(turn / SPAN_S, rel=1e-3)
    np.testing.assert_allclose([vx - omega * centre[1], vy + omega * centre[0]], 0.0, atol=1e-9)
    np.testing.assert_allclose(row["centre"], centre, atol=1e-9)


def test_the_twist_is_the_weighted_least_squares_fit_and_its_covariance() -> None:
    random = np.random.default_rng(0)
    std = random.uniform(1e-6, 1e-4, (4, 2))
    moved = random.normal(0, 1e-3, (4, 2))
    row = fused(moved, variance=std**2)
    twist, covariance = least_squares(moved, std)
    np.testing.assert_allclose(row["velocity"], twist, rtol=1e-5)
    np.testing.assert_allclose(row["velocity_covariance"], covariance, rtol=1e-5)
    assert row["pads"] == 4


def test_correlated_noise_counts_as_such() -> None:
    places, rows = PLACES[:2], unknown(Row, 1)
    covariance = np.array([[[[2e-10, 1e-10], [1e-10, 3e-10]]] * 2])
    moved, nothing = np.array([[[1e-4, 0.0], [0.0, 1e-4]]]), np.full((1, 2, 2), np.nan)
    flags, spans = np.ones((1, 2), np.bool_), np.full((1, 2), SPAN_S)
    here = carried(places + 0.5 * moved, moved, nothing, flags)
    fuse_twists(here, covariance, spans, True, records(Equations, 1), rows)
    J = np.array([[[1.0, 0.0, -y], [0.0, 1.0, x]] for x, y in places])
    W = SPAN_S**2 * np.linalg.inv(covariance[0])
    expected = np.linalg.inv(np.einsum("pai,pab,pbj->ij", J, W, J))
    np.testing.assert_allclose(rows[0]["velocity_covariance"], expected, rtol=1e-5)


def test_the_rotor_of_a_rigid_motion_is_twice_its_rate_of_turn_with_two_pads_or_more() -> None:
    for pads in (2, 3, 4):
        row = fused(rigid(0.01, -0.02, 0.7)[:pads], places=PLACES[:pads])
        assert row["rotor"] == pytest.approx(1.4)
        assert row["velocity"][2] == pytest.approx(0.7)


def test_the_rotor_is_the_curl_of_the_affine_field_if_it_is_not_rigid() -> None:
    field = np.array([[0.3, -0.4], [0.9, -0.2]])  # rows: gradients of v_x and v_y
    row = fused(SPAN_S * (PLACES @ field.T + [0.01, 0.02]))
    assert row["rotor"] == pytest.approx(0.9 + 0.4)
    design = np.column_stack([np.ones(4), PLACES]) * SPAN_S / 1e-5
    variance = np.linalg.inv(design.T @ design)
    assert row["rotor_std"] == pytest.approx(np.sqrt(variance[1, 1] + variance[2, 2]), rel=1e-6)


def test_the_deviation_of_the_rotor_is_that_of_draws_with_unequal_and_correlated_axes() -> None:
    random, draws, spans = np.random.default_rng(2), 4000, np.full((1, 4), SPAN_S)
    root = 1e-5 * np.array([[[3.0, 0.0], [2.0, 0.5]], [[0.3, 0.0], [0.0, 2.0]], [[1.0, 0.0], [-1.0, 0.2]], np.eye(2)])
    moved = np.einsum("pij,npj->npi", root, random.normal(size=(draws, 4, 2)))
    nothing, flags, rows = np.full((draws, 4, 2), np.nan), np.ones((draws, 4), np.bool_), unknown(Row, draws)
    covariance = np.tile(root @ root.transpose(0, 2, 1), (draws, 1, 1, 1))
    here = carried(PLACES + 0.5 * moved, moved, nothing, flags)
    fuse_twists(here, covariance, np.tile(spans, (draws, 1)), True, records(Equations, 1), rows)
    assert np.mean((rows["rotor"] / rows["rotor_std"]) ** 2) == pytest.approx(1.0, abs=0.07)


def test_three_pads_are_enough_for_the_curl() -> None:
    field = np.array([[0.3, -0.4], [0.9, -0.2]])
    row = fused(SPAN_S * (PLACES[:3] @ field.T), places=PLACES[:3])
    assert row["rotor"] == pytest.approx(0.9 + 0.4)


def test_a_pad_that_knows_one_direction_only_has_no_weight_in_the_curl() -> None:
    field = np.array([[0.3, -0.4], [0.9, -0.2]])
    moved, variance = SPAN_S * (PLACES @ field.T), np.full((4, 2), 1e-10)
    moved[3, 1], variance[3, 1] = 1.0, 1.0
    assert fused(moved, variance=variance)["rotor"] == pytest.approx(0.9 + 0.4, rel=1e-3)


def test_pads_in_one_line_have_the_rotor_of_the_rigid_fit() -> None:
    line = np.array([[-0.05, 0.01], [0.0, 0.01], [0.05, 0.01]])
    row = fused(rigid(0.0, 0.0, 0.5, line), places=line)
    assert row["rotor"] == pytest.approx(1.0)
    assert row["rotor_std"] == pytest.approx(2.0 * np.sqrt(row["velocity_covariance"][2, 2]))


def test_the_centre_is_where_nothing_moves() -> None:
    centre = np.array([0.03, -0.02])
    row = fused(rigid(0.5 * centre[1], -0.5 * centre[0], 0.5))
    np.testing.assert_allclose(row["centre"], centre, atol=1e-9)


def test_the_deviation_of_the_centre_is_that_of_many_draws() -> None:
    random, std, places = np.random.default_rng(3), 2e-6, PLACES + np.array([0.1, 0.15])
    truth = rigid(0.1, -0.06, 0.5, places)
    rows = [fused(truth + random.normal(0, std, (4, 2)), places=places, variance=std**2) for _ in range(2000)]
    drawn = np.std([row["centre"] for row in rows], axis=0)
    np.testing.assert_allclose(fused(truth, places=places, variance=std**2)["centre_std"], drawn, rtol=0.06)


@pytest.mark.parametrize(("sigmas", "given"), [(2.9, False), (3.1, True)])
def test_a_centre_is_given_from_3_standard_deviations_of_the_turn_on(sigmas: float, given: bool) -> None:
    still = fused(rigid(0.0, 0.0, 0.0))
    omega = sigmas * np.sqrt(still["velocity_covariance"][2, 2])
    assert np.isfinite(fused(rigid(0.01, 0.0, -omega))["centre"]).all() == given


def test_unknown_pads_do_not_count_and_none_leaves_all_unknown() -> None:
    moved = rigid(0.01, 0.02, 0.3)
    moved[3] = np.nan
    row = fused(moved, known=[True, True, True, False])
    np.testing.assert_allclose(row["velocity"], [0.01, 0.02, 0.3])
    assert row["pads"] == 3
    none = fused(moved, known=[False] * 4)
    assert none["pads"] == 0
    assert np.isnan(none["velocity"]).all()


@pytest.mark.parametrize("places", [np.zeros((2, 2)), PLACES[:2]], ids=["at the origin", "apart"])
def test_without_places_the_motion_is_the_mean_translation(places: Floats) -> None:
    row = fused(np.array([[1e-4, 0.0], [3e-4, 2e-4]]), places=places, turns=False)
    np.testing.assert_allclose(row["velocity"][:2], [0.01, 0.005])
    np.testing.assert_allclose(row["velocity_covariance"][:2, :2], np.eye(2) * 1e-10 / SPAN_S**2 / 2, rtol=1e-6)
    assert np.isnan(row["velocity"][2])
    assert np.isnan(row["rotor"])


def test_a_mean_translation_weighs_correlated_noise() -> None:
    rows, spans = unknown(Row, 1), np.full((1, 2), SPAN_S)
    covariance = np.array([[[[2e-10, 1e-10], [1e-10, 3e-10]], [[4e-10, -3e-10], [-3e-10, 5e-10]]]])
    moved, nothing = np.array([[[1e-4, 0.0], [3e-4, 2e-4]]]), np.full((1, 2, 2), np.nan)
    here = carried(np.zeros((1, 2, 2)), moved, nothing, np.ones((1, 2), np.bool_))
    fuse_twists(here, covariance, spans, False, records(Equations, 1), rows)
    W = SPAN_S**2 * np.linalg.inv(covariance[0])
    expected = np.linalg.inv(W.sum(axis=0))
    np.testing.assert_allclose(rows[0]["velocity_covariance"][:2, :2], expected, rtol=1e-6)
    mean = expected @ np.einsum("pab,pb->a", W, moved[0] / SPAN_S)
    np.testing.assert_allclose(rows[0]["velocity"][:2], mean, rtol=1e-6)


def test_each_scan_is_fitted_by_its_own_vectors() -> None:
    """Twists, a field that is not rigid, one pad alone: none finds anything of the scans before."""
    field = np.array([[0.3, -0.4], [0.9, -0.2]])
    moved = np.array([rigid(0.01, -0.02, 0.7), SPAN_S * (PLACES @ field.T + [0.01, 0.02]), rigid(0.02, 0.01, -0.3)])
    known = np.array([[True] * 4, [True] * 4, [True] + [False] * 3])
    covariance = np.broadcast_to(1e-10 * np.eye(2), (3, 4, 2, 2)).copy()
    rows, spans = unknown(Row, 3), np.full((3, 4), SPAN_S)
    here = carried(PLACES + 0.5 * moved, moved, np.full((3, 4, 2), np.nan), known)
    fuse_twists(here, covariance, spans, True, records(Equations, 1), rows)
    for scan in range(3):
        assert_records_equal(rows[scan], fused(moved[scan], known=known[scan].tolist()))


def assert_records_equal(one: Records, other: Records) -> None:
    for field in one.dtype.names:
        np.testing.assert_array_equal(one[field], other[field], err_msg=field)


def test_a_pads_own_turn_counts_by_its_variance() -> None:
    moved, own = rigid(0.0, 0.0, 0.5), (0.6 * SPAN_S, 1e-8)
    plain, both = fused(moved), fused(moved, turn=own)
    information = 1.0 / plain["velocity_covariance"][2, 2] - 0.0
    known = 1.0 / (1e-8 / SPAN_S**2)
    assert both["velocity"][2] == pytest.approx((0.5 * information + 0.6 * known) / (information + known), rel=1e-6)


def test_one_pad_alone_has_the_turn_that_it_measures_itself() -> None:
    moved, turn = rigid(0.01, 0.02, 0.5)[:1], (0.5 * SPAN_S, 1e-6)
    row = fused(moved, places=PLACES[:1], turn=turn)
    np.testing.assert_allclose(row["velocity"], [0.01, 0.02, 0.5])
    assert row["velocity_covariance"][2, 2] == pytest.approx(1e-6 / SPAN_S**2)
    without = fused(moved, places=PLACES[:1], turn=(0.5 * SPAN_S, 0.0))  # a turn without a variance is unknown
    np.testing.assert_allclose(without["velocity"], [*moved[0] / SPAN_S, np.nan])


def test_a_displacement_without_noise_is_known_to_a_nanometre() -> None:
    row = fused(np.array([[1e-4, 2e-4]]), places=PLACES[:1], variance=0.0)
    np.testing.assert_allclose(row["velocity"][:2], [0.005, 0.01])
    std = np.sqrt(np.diagonal(row["velocity_covariance"])[:2])
    np.testing.assert_allclose(std, 1e-9 / SPAN_S)


def test_one_pad_alone_has_no_turn_even_if_its_covariance_is_singular() -> None:
    random, draws = np.random.default_rng(4), 200
    places, rows = random.uniform(-0.1, 0.1, (draws, 1, 2)), unknown(Row, draws)
    tie = random.uniform(5e-6, 1e-5, (draws, 1, 1, 1)) * np.ones((2, 2))
    moved, nothing = np.full((draws, 1, 2), 1e-3), np.full((draws, 1, 2), np.nan)
    here = carried(places, moved, nothing, np.ones((draws, 1), np.bool_))
    fuse_twists(here, tie, np.full((draws, 1), SPAN_S), True, records(Equations, 1), rows)
    assert np.isnan(rows["velocity"][:, 2]).all()


@pytest.mark.parametrize(("apart_m", "expected"), [(0.9e-3, False), (1.1e-3, True)])
def test_places_a_millimetre_apart_determine_a_turn(apart_m: float, expected: bool) -> None:
    x = 0.04 + apart_m * np.array([-1.0, 1.0])
    normal = sum(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, a], [0.0, a, a * a]]) for a in x)
    assert turn_is_observable(np.asarray(normal)) == expected


@pytest.mark.parametrize(("information", "expected"), [(4.9e-6, False), (5.1e-6, True)])
def test_the_information_on_a_turn_is_compared_with_the_mean_of_both_axes(information: float, expected: bool) -> None:
    assert turn_is_observable(np.diag([9.0, 1.0, information])) == expected


def test_the_information_on_a_turn_is_what_a_translation_leaves_of_it() -> None:
    root = np.random.default_rng(5).normal(0, 1, (3, 3))
    normal = root @ root.T
    assert information_on_turn(normal) == pytest.approx(1.0 / np.linalg.inv(normal)[2, 2])


@pytest.mark.parametrize(("high_m", "expected"), [(0.9e-3, False), (1.1e-3, True)])
def test_places_a_millimetre_off_a_line_span_a_plane(high_m: float, expected: bool) -> None:
    x, y = np.array([-0.05, -0.05, 0.05, 0.05]), high_m * np.array([1.0, -1.0, 1.0, -1.0])
    basis = np.column_stack([np.ones(4), 0.02 + x, 0.03 + y])
    assert spans_a_plane(3.0 * basis.T @ basis) == expected
