from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigged import rigged
from taxelflow.errors import NameUnknown, ParameterInvalid
from taxelflow.evaluation import bound as bounds
from taxelflow.evaluation.bound import Bound, bound_of
from taxelflow.messages import Floats
from taxelflow.numerics.geometry import rotation
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.simulation.scenario import Scenario
from taxelflow.simulation.simulate import pressures, simulate


def times(scenario: Scenario) -> Floats:
    return simulate(scenario).known_truth.t_s


def bounded(scenario: Scenario) -> Bound:
    return bound_of(scenario, times(scenario))


def still(**changes: object) -> Scenario:
    """An elongated object at rest on the palm, well inside."""
    contact = {"shape": "elongated", "radius_m": 0.009, "aspect": 1.7}
    return rigged("stroke", contact=contact, motion={"travel_m": 0.0, "turn_s": 1.0, "middle_m": (0.0, 0.0)}, **changes)


def readings(scenario: Scenario, **motion: object) -> Floats:
    """Noise-free pressures (taxels,) of the first scan of a still object, moved through the scenario's own fields."""
    layout = load_sensor(scenario.sensor).layout
    pad = layout.pads.index(scenario.pad)
    moved = replace(scenario, motion=replace(scenario.motion, **motion))
    return pressures(moved, layout, [pad], np.zeros(1))[0, layout.of_pad(pad)]


def test_the_known_bound_is_what_least_squares_reaches_on_drawn_noise() -> None:
    scenario = still()
    step = 1e-5
    base = readings(scenario)
    columns = [
        (readings(scenario, middle_m=(step, 0.0)) - readings(scenario, middle_m=(-step, 0.0))) / (2 * step),
        (readings(scenario, middle_m=(0.0, step)) - readings(scenario, middle_m=(0.0, -step))) / (2 * step),
        (readings(scenario, angle_rad=step) - readings(scenario, angle_rad=-step)) / (2 * step),
        base,
        np.ones_like(base),
    ]
    sigma = np.hypot(scenario.sensing.noise_pa, scenario.sensing.full_scale_pa / 1023 / np.sqrt(12))
    noise = sigma * np.random.default_rng(0).standard_normal((len(base), 4000))
    found = np.linalg.lstsq(np.stack(columns, axis=1), noise, rcond=None)[0][:3]
    assert bounded(scenario).known[0] == pytest.approx(found.std(axis=1), rel=0.04)


def test_the_palms_bound_is_about_what_the_feasibility_study_found() -> None:
    bound = bounded(rigged("stroke"))
    inside = np.abs(bound.pose[:, 0]) < 0.02
    assert 1e3 * np.median(bound.known[inside, 0]) == pytest.approx(0.061, rel=0.05)


def test_a_round_contact_has_no_turn_and_a_long_one_has() -> None:
    assert np.isnan(bounded(rigged("stroke")).known[:, 2]).all()
    long = bounded(rigged("turn"))
    assert (np.degrees(long.known[long.scored, 2]) < 0.2).all()


def test_a_round_contact_whose_pressure_has_left_its_middle_still_has_a_place() -> None:
    bound = bounded(rigged("roll", sensing={"rate_hz": 5.0}))
    assert np.isnan(bound.known[:, 2]).all()
    assert bound.scored.sum() == 40  # all that is not lifted off


@pytest.mark.long
def test_a_round_contact_of_the_elastic_solver_has_no_turn_either() -> None:
    pytest.importorskip("tamaas")
    bound = bounded(rigged("stroke", solver="elastic"))
    assert np.isnan(bound.known[:, 2]).all()
    assert 0.03 < 1e3 * np.median(bound.known[np.abs(bound.pose[:, 0]) < 0.02, 0]) < 0.06  # its edges are sharper


def test_scans_with_a_large_position_variance_are_not_scored() -> None:
    bound = bounded(rigged("stroke"))
    assert not bound.scored[np.abs(bound.pose[:, 0]) > 0.06].any()
    assert bound.scored[np.abs(bound.pose[:, 0]) < 0.03].all()
    assert np.isnan(bound.unknown[~bound.scored]).all()


def test_more_noise_is_a_larger_bound_in_proportion() -> None:
    fine = {"bits": 24}
    quiet, loud = (bounded(still(sensing={**fine, "noise_pa": noise})) for noise in (100.0, 200.0))
    np.testing.assert_allclose(loud.known, 2 * quiet.known, rtol=1e-6)


def test_quantisation_alone_bounds_too() -> None:
    coarse = bounded(still(sensing={"noise_pa": 0.0, "bits": 8}))
    noise = 140e3 / 255 / np.sqrt(12)
    same = bounded(still(sensing={"noise_pa": noise, "bits": 24}))
    np.testing.assert_allclose(coarse.known, same.known, rtol=1e-6)


def test_dead_and_saturated_taxels_add_no_information() -> None:
    whole = bounded(still()).known[0]
    assert (bounded(still(sensing={"dead": (146, 152)})).known[0] > 1.01 * whole).all()
    assert (bounded(still(sensing={"full_scale_pa": 60e3})).known[0, :2] > 1.01 * whole[:2]).any()


def dense(scenario: Scenario, t_s: Floats, contact: Floats) -> tuple[Floats, Floats]:
    """The joint bounds, of poses and of motions since the first, by one dense matrix over poses, gains, baselines and
    coefficients.
    """
    layout = load_sensor(scenario.sensor).layout
    pad = layout.pads.index(scenario.pad)
    own = layout.of_pad(pad)
    model = bounds.modelled(scenario, layout, pad, t_s)
    knot_m = float(layout.pitch_m[pad].min()) / 2
    scans, taxels = len(contact), model.pressure.shape[1]
    pose = bound_of(scenario, t_s).pose[contact]
    jacobian = np.zeros((scans, taxels, 5 * scans))
    for k, scan in enumerate(contact):
        base = pressures(scenario, layout, [pad], t_s[scan : scan + 1])[0, own]
        for axis, step in enumerate((1e-6, 1e-6, 1e-4)):
            moved = pressures(scenario, layout, [pad], t_s[scan : scan + 1], step * np.eye(3)[axis])[0, own]
            jacobian[k, :, 5 * k + axis] = (moved - base) / step * model.weight[scan]
        jacobian[k, :, 5 * k + 3] = base * model.weight[scan] / 1e3
        jacobian[k, :, 5 * k + 4] = model.weight[scan] * 1e3
    whole = np.concatenate(
        [jacobian.reshape(scans * taxels, -1), bounds._pattern(model, contact, knot_m).toarray()], axis=1
    )
    information = whole.T @ whole
    information[5 * scans :, 5 * scans :] += np.eye(len(information) - 5 * scans) / bounds._FREE**2
    poses = np.concatenate([5 * k + np.arange(3) for k in range(scans)])
    rest = np.setdiff1d(np.arange(len(information)), poses)
    cross = information[np.ix_(poses, rest)]
    schur = information[np.ix_(poses, poses)] - cross @ np.linalg.solve(information[np.ix_(rest, rest)], cross.T)
    gauge = np.zeros((scans, 3, 3))
    gauge[:, :2, :2], gauge[:, 2, 2] = rotation(pose[:, 2]), 1.0
    gauge = gauge.reshape(-1, 3)
    known = bound_of(scenario, t_s).known[contact]
    place = 1 / (known[:, 0] ** 2 + known[:, 1] ** 2)
    weight = np.stack([place, place, 1 / known[:, 2] ** 2], axis=1).reshape(-1, 1)
    left = np.eye(3 * scans) - gauge @ np.linalg.solve(gauge.T @ (weight * gauge), (weight * gauge).T)
    scale = known.reshape(-1, 1)
    covariance = np.linalg.pinv(schur * scale * scale.T, rcond=1e-12, hermitian=True) * scale * scale.T
    since = np.eye(3 * scans)
    turned = np.zeros((scans, 3, 3))
    turned[:, :2, :2], turned[:, 2, 2] = rotation(pose[:, 2] - pose[0, 2]), 1.0
    since[:, :3] -= turned.reshape(-1, 3)
    two = [np.sqrt(np.diag(way @ covariance @ way.T)).reshape(-1, 3) for way in (left, since)]
    return two[0], two[1]


@pytest.mark.long
def test_the_joint_bounds_are_those_of_one_dense_matrix() -> None:
    scenario = rigged("slide-and-turn", sensing={"rate_hz": 8.0})
    t_s = times(scenario)
    bound = bound_of(scenario, t_s)
    contact = np.flatnonzero(bound.scored)
    assert len(contact) == len(t_s)
    unknown, since = dense(scenario, t_s, contact)
    np.testing.assert_allclose(bound.unknown[contact], unknown, rtol=0.01)
    np.testing.assert_allclose(bound.since_unknown[contact[1:]], since[1:], rtol=0.01)
    assert np.isnan(bound.since_unknown[contact[0]]).all()


def test_with_a_known_pattern_a_motion_errs_by_its_two_ends() -> None:
    bound = bounded(still())
    np.testing.assert_allclose(bound.since_known[1:], np.sqrt(2) * bound.known[1:], rtol=1e-9)
    turning = bounded(rigged("turn", motion={"turn_rad_s": np.pi / 4}))
    known, since = (array[turning.scored] for array in (turning.known, turning.since_known))
    quarter = np.argmin(np.abs(turning.pose[turning.scored, 2] - turning.pose[turning.scored, 2][0] - np.pi / 2))
    both = np.hypot(known[quarter], known[0, [1, 0, 2]])  # turned by a right angle, x of the first scan is y
    np.testing.assert_allclose(since[quarter], both, rtol=0.02)


def test_each_contact_has_a_first_scan_of_its_own() -> None:
    bound = bounded(rigged("stroke"))
    without = bound.scored & np.isnan(bound.since_known[:, 0])
    assert without.sum() == 2  # two strokes


@pytest.mark.long
def test_the_price_of_an_unknown_pattern_falls_with_the_scans_that_share_it() -> None:
    few, many = (bounded(rigged("slide-and-turn", sensing={"rate_hz": rate})) for rate in (8.0, 60.0))
    prices = [np.nanmedian(bound.unknown / bound.known, axis=0) for bound in (few, many)]
    assert (prices[0] > prices[1]).all()
    assert (prices[1] > 0.99).all()


def test_without_the_joint_bound_the_known_one_is_the_same() -> None:
    scenario = rigged("stroke")
    both, one = bound_of(scenario, times(scenario)), bound_of(scenario, times(scenario), jointly=False)
    np.testing.assert_array_equal(both.known, one.known)
    assert np.isnan(one.unknown).all()
    assert np.isfinite(both.unknown[both.scored, :2]).all()


@pytest.mark.parametrize(
    "changed",
    [
        rigged("press"),
        rigged("roll"),
        rigged("tilt"),
        rigged("stroke", contact={"deform_1_m": 1.0}),
    ],
    ids=["growth", "roll", "tilt", "deforming"],
)
def test_a_pattern_that_changes_has_no_joint_bound(changed: Scenario) -> None:
    bound = bounded(changed)
    assert np.isnan(bound.unknown).all()
    assert np.isfinite(bound.known[bound.scored, :2]).all()


def test_a_load_that_only_scales_the_pattern_is_a_gain() -> None:
    scenario = rigged("stroke", load={"kind": "cycles", "multiples": (0.5, 1.0)})
    bound = bounded(scenario)
    assert np.isfinite(bound.unknown[bound.scored, :2]).all()


def test_a_rolling_scan_is_bounded_where_its_taxels_are_read() -> None:
    at_once, late = (bounded(rigged("turn", sensing={"scan_share": share})) for share in (0.0, 0.9))
    np.testing.assert_allclose(late.known[late.scored], at_once.known[late.scored], rtol=0.2)
    assert (late.known != at_once.known).any()
    assert np.isfinite(late.unknown[late.scored]).all()


def test_the_hand_and_a_pad_that_is_not_there_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match="pad must be one pad"):
        bound_of(rigged("turn-over-hand"), np.zeros(1))
    with pytest.raises(NameUnknown, match="unknown pad 'plam'"):
        bound_of(rigged("stroke", pad="plam"), np.zeros(1))
