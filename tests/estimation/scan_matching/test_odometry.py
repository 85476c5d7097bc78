from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from costly import mostly_long
from synthetic import assert_same, dome, grid_sensor, pieces, scans_of, slips_by
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.scan_matching.uncertainty import is_anywhere
from taxelflow.messages import AMBIGUOUS, OK, UNRESOLVED
from taxelflow.numerics.geometry import rotation
from taxelflow.pipeline.api import estimate
from taxelflow.sensors.pads import Group, Pad, Patch
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.messages import Floats, Slips

PITCH = 0.002
SIDE = 16
PAD = grid_sensor(SIDE, SIDE, pitch_m=(PITCH, PITCH))
PEAK, NOISE = 80e3, 750.0


def textured(
    seed: int, poses: Any, *, sensor: Sensor = PAD, radius_m: float = 0.009, gains: Any = 1.0, waves: Any = (4, 8)
) -> Floats:
    """Scans (poses, taxels) of a soft disc with random waves of so many pitches, at poses (n, 3)."""
    random = np.random.default_rng(seed)
    length, way = random.uniform(*waves, 8) * sensor.layout.pitch_m[0, 0], random.uniform(0, np.pi, 8)
    wave = 2 * np.pi / length * np.array([np.cos(way), np.sin(way)])
    phase = random.uniform(0, 2 * np.pi, 8)
    scans = []
    for x, y, theta in np.atleast_2d(poses):
        places = np.stack([sensor.layout.x_m - x, sensor.layout.y_m - y])
        u = rotation(np.array(-theta)) @ places
        disc = np.exp(-((np.hypot(*u) / radius_m) ** 4))
        scans.append(PEAK * disc * (1.0 + 0.15 * np.cos(u.T @ wave + phase).sum(axis=1)).clip(0.0))
    pressure: Floats = np.array(scans) * np.reshape(gains, (-1, 1))
    return pressure


def seen(values: Any, *, sensor: Sensor = PAD, **more: Any) -> Slips:
    return slips_by("registration", sensor, scans_of(sensor, values, **{"noise": NOISE, **more}))


def moved(slips: Slips, poses: Floats, scan: int = 1) -> Floats:
    """What the point of the body that the pose follows did from the scan before, in truth (3,)."""
    before, after = poses[scan - 1], poses[scan]
    arm = slips.pose[scan - 1, 0, :2] - before[:2]
    turn = after[2] - before[2]
    shift: Floats = np.array([*(after[:2] + rotation(np.array(turn)) @ arm - before[:2] - arm), turn])
    return shift


def pairs(count: int, *, shift: float = 1.0, turn_deg: float = 3.0) -> Floats:
    """(count, 2, 3): poses before and after a random motion of up to so many pitches and degrees."""
    random = np.random.default_rng(1)
    first = np.concatenate([random.uniform(-1, 1, (count, 2)) * PITCH, random.uniform(-3, 3, (count, 1))], axis=1)
    limits = np.array([shift * PITCH, shift * PITCH, np.radians(turn_deg)])
    return np.stack([first, first + random.uniform(-1, 1, (count, 3)) * limits], axis=1)


def bound(seed: int, pose: Floats, about: Floats) -> Floats:
    """(3,) Cramér-Rao bound of the motion between two scans: twice one scan's variance, gain unknown."""
    steps = np.array([1e-5, 1e-5, 3e-3])
    arm = pose[:2] - about
    by = []
    for axis, step in enumerate(np.diag(steps)):
        both = [
            [*(about + rotation(np.array(sign * step[2])) @ arm + sign * step[:2]), pose[2] + sign * step[2]]
            for sign in (1.0, -1.0)
        ]
        there, back = textured(seed, both)
        by.append((there - back) / (2 * steps[axis]))
    J = np.stack([*by, textured(seed, pose)[0]], axis=1) / NOISE
    variance: Floats = 2.0 * np.diag(np.linalg.inv(J.T @ J))[:3]
    return variance


@pytest.mark.long
def test_two_scans_come_near_the_bound_with_a_consistent_covariance() -> None:
    trials = pairs(40)
    random = np.random.default_rng(2)
    error, least, nees = [], [], []
    for seed, poses in enumerate(trials):
        gains = [1.0, random.uniform(0.7, 1.4)]
        slips = seen(textured(seed, poses, gains=gains) + random.normal(0, NOISE, (2, SIDE**2)))
        off = slips.displacement[1, 0] - moved(slips, poses)
        error.append(off)
        least.append(bound(seed, poses[0], slips.pose[0, 0, :2]))
        nees.append(off @ np.linalg.solve(slips.displacement_covariance[1, 0], off) / 3)
    rmse, known = np.sqrt(np.mean(np.square(error), axis=0)), np.sqrt(np.mean(least, axis=0))
    assert (rmse < 1.4 * known).all()
    assert (rmse > 0.7 * known).all()  # the bound is one
    assert 0.6 < np.mean(nees) < 1.6


def face(y_m: Floats) -> Floats:
    """Scans of a flat face of 31 x 41 mm, a pad's width, that tilts a little, with its middle at these heights."""

    def inside(place_m: Floats, half_m: float) -> Floats:
        return np.asarray(1.0 / (1.0 + np.exp((np.abs(place_m) - half_m) / 6e-4)))

    x, y = PAD.layout.x_m, PAD.layout.y_m
    clean = [0.25 * PEAK * inside(x, 0.0155) * inside(y - at, 0.0205) * (1.0 + 12.5 * y) for at in y_m]
    return np.maximum(np.array(clean) + np.random.default_rng(0).normal(0, NOISE, (len(y_m), SIDE**2)), 0.0)


@pytest.mark.parametrize("step_pitches", [0.2, 0.5, 1.0, 1.5])
def test_a_face_as_large_as_the_pad_is_misread_and_never_ok(step_pitches: float) -> None:
    """Of some 10 mm it reads 3 to 5."""
    y_m = 0.003 - step_pitches * PITCH * np.arange(1 + int(0.0107 / (step_pitches * PITCH)))
    slips = seen(face(y_m))
    assert abs(slips.pose[-1, 0, 1] - slips.pose[0, 0, 1]) < 0.6 * (y_m[0] - y_m[-1])
    assert (slips.quality[:, 0] == AMBIGUOUS).all()


@pytest.mark.parametrize("shift_pitches", mostly_long([0.4, 0.7, 1.2, 1.8, 2.5, 4.0], 0.7, 2.5))
def test_a_jump_between_two_scans_is_right_or_not_ok(shift_pitches: float) -> None:
    """Up to a pitch and a half it is found; beyond, another fit may look better, but none looks good."""
    good, wrong = 0, 0
    for seed in range(12):
        random = np.random.default_rng(seed)
        poses = np.zeros((2, 3))
        poses[1, :2] = shift_pitches * PITCH * rotation(random.uniform(0, 2 * np.pi)) @ [1.0, 0.0]
        slips = seen(np.maximum(textured(seed, poses, waves=(2.5, 8)) + random.normal(0, NOISE, (2, SIDE**2)), 0.0))
        off_m = float(np.hypot(*(slips.displacement[1, 0, :2] - poses[1, :2])))
        good += slips.quality[1, 0] == OK
        wrong += slips.quality[1, 0] == OK and off_m > 1.5e-4
    assert wrong == 0
    assert good >= 10 or shift_pitches > 1.5


@settings(max_examples=5)
@given(seed=st.integers(0, 1000), quarters=st.integers(1, 3))
def test_a_quarter_turn_of_the_scans_turns_the_answer(seed: int, quarters: int) -> None:
    noise = np.random.default_rng(seed).normal(0, NOISE, (3, SIDE**2))
    values = textured(seed, [[0, 0, 0], [0.001, -0.0007, 0.02], [0.0015, 0.0004, 0.05]]) + noise
    turned = np.rot90(values.reshape(3, SIDE, SIDE), quarters, axes=(1, 2)).reshape(3, -1)
    one, other = seen(values), seen(turned)
    R = np.eye(3)
    R[:2, :2] = rotation(np.array(quarters * np.pi / 2))
    np.testing.assert_allclose(other.displacement[1:, 0], one.displacement[1:, 0] @ R.T, atol=1e-5)
    expected = R @ one.displacement_covariance[1:, 0] @ R.T
    np.testing.assert_allclose(other.displacement_covariance[1:, 0], expected, rtol=0.05, atol=1e-9)


@settings(max_examples=5)
@given(seed=st.integers(0, 1000), load=st.floats(0.3, 3.0))
def test_a_still_object_does_not_move_whatever_the_load(seed: int, load: float) -> None:
    still = textured(seed, [0.001, -0.002, 0.3])[0]
    slips = seen(np.array([1.0, 1.0, load, 1.0])[:, np.newaxis] * still)
    assert not (np.abs(slips.displacement[1:, 0, 2]) > 1e-6).any()
    np.testing.assert_allclose(slips.displacement[1:, 0, :2], 0, atol=1e-9)


@settings(max_examples=5)
@given(seed=st.integers(0, 1000), scale=st.floats(1e-3, 1e3))
def test_the_scale_of_pressure_changes_nothing(seed: int, scale: float) -> None:
    poses = [[0, 0, 0], [0.0012, -0.0004, 0.03]]
    values = textured(seed, poses) + np.random.default_rng(seed).normal(0, NOISE, (2, SIDE**2))
    one, other = seen(values), seen(scale * values, noise=scale * NOISE)
    for part in ("pose", "displacement", "covariance", "displacement_covariance"):
        np.testing.assert_allclose(getattr(other, part), getattr(one, part), rtol=1e-4, atol=1e-9)


@settings(max_examples=6)
@given(
    seed=st.integers(0, 2**32 - 1),
    cuts=st.lists(st.integers(0, 20), max_size=8),
    modes=st.tuples(*[st.sampled_from(["batch", "stream"])] * 2),
)
def test_modes_and_blocks_give_the_same_bits(seed: int, cuts: list[int], modes: tuple[str, str]) -> None:
    random = np.random.default_rng(seed)
    two = grid_sensor(6, 7, pads=2)
    x = np.cumsum(random.normal(0, 0.003, 20))
    values = [dome(two, at, radius_m=0.015) + dome(two, -at, pad=1) for at in x] + random.normal(0, 300, (20, 84))
    scans = scans_of(
        two,
        values,
        noise=random.choice([0.0, 300.0], 84, p=[0.1, 0.9]),
        contact=random.random((20, 2)) < 0.9,
        complete=random.random((20, 2)) < 0.9,
    )
    whole = slips_by("registration", two, scans, mode=modes[0])
    assert_same(slips_by("registration", two, *pieces(scans, cuts), mode=modes[1]), whole)


def walk(count: int, step: float = 0.4) -> Floats:
    """Poses of an object that wanders about the pad's middle."""
    angle = np.linspace(0, 2 * np.pi, count)
    return np.stack([step * 4 * PITCH * np.sin(angle), step * 4 * PITCH * np.cos(angle), 0.5 * angle], axis=1)


def drift(slips: Slips, poses: Floats) -> Floats:
    """Errors (scans, 3) of poses: the body's point of the first scan, followed in truth."""
    arm = rotation(np.array(-poses[0, 2])) @ (slips.pose[0, 0, :2] - poses[0, :2])
    truth = np.concatenate([poses[:, :2] + rotation(poses[:, 2]) @ arm, poses[:, 2:] - poses[0, 2]], axis=1)
    off: Floats = slips.pose[:, 0] - truth
    return off


def test_a_pose_is_the_sum_of_the_steps() -> None:
    random = np.random.default_rng(4)
    poses = walk(30)
    slips = seen(textured(1, poses) + random.normal(0, NOISE, (30, SIDE**2)))
    total = np.nancumsum(slips.displacement[:, 0], axis=0) + slips.pose[0, 0]
    np.testing.assert_allclose(slips.pose[:, 0], total, atol=1e-12)
    assert (np.abs(drift(slips, poses)[:, :2]) < 0.15 * PITCH).all()


def test_the_covariance_knows_how_a_still_objects_pose_drifts() -> None:
    random = np.random.default_rng(4)
    runs = [seen(textured(seed, np.zeros((40, 3))) + random.normal(0, NOISE, (40, SIDE**2))) for seed in range(12)]
    nees = []
    for slips in runs:
        error, covariance = slips.pose[-1, 0] - slips.pose[0, 0], slips.covariance[-1, 0] + slips.covariance[0, 0]
        nees.append(error @ np.linalg.solve(covariance, error) / 3)
        assert covariance[2, 2] > 3 * slips.covariance[0, 0, 2, 2]  # it does drift
    assert 0.3 < np.mean(nees) < 2.0


def test_a_still_objects_pose_hardly_drifts() -> None:
    random = np.random.default_rng(5)
    slips = seen(textured(3, np.zeros((200, 3))) + random.normal(0, NOISE, (200, SIDE**2)))
    std = np.sqrt(slips.covariance[:, 0].diagonal(axis1=1, axis2=2))
    assert (std[-1] < 8 * std[0]).all()
    assert (np.abs(slips.pose[-1, 0] - slips.pose[0, 0]) < 5 * std[-1]).all()


def test_noise_of_unloaded_taxels_does_not_make_a_still_object_drift() -> None:
    random = np.random.default_rng(0)
    small = np.tile(dome(PAD, radius_m=0.004, peak=PEAK) + dome(PAD, 0.005, radius_m=0.003, peak=PEAK), (600, 1))
    slips = seen(small + random.normal(0, NOISE, small.shape))
    error = slips.pose[-1, 0, :2] - slips.pose[0, 0, :2]
    variance = (slips.covariance[-1, 0] + slips.covariance[0, 0]).diagonal()[:2]
    assert (np.abs(error) < 2 * np.sqrt(variance)).all()


def faulty(fault: str, values: Floats, random: Any) -> dict[str, Any]:
    """Scans with a fault, as conditioning hands them on."""
    taxels = values.shape[1]
    some = random.choice(taxels, 10, replace=False)
    if fault == "masked":
        values[:, some] = 0.0
        noise = np.full(taxels, NOISE)
        noise[some] = 0.0
        return {"noise": noise}
    if fault == "missing":
        values[1, some] = 0.0
        return {"complete": [True, False, True]}
    if fault == "saturated":
        np.minimum(values, 0.8 * PEAK, out=values)
        return {"ceiling": 0.8 * PEAK}
    np.maximum(values, 0.0, out=values)  # clipped
    return {}


@pytest.mark.parametrize("fault", ["masked", "missing", "saturated", "clipped"])
def test_a_fault_of_the_sensor_costs_little(fault: str) -> None:
    random = np.random.default_rng(6)
    nees = []
    for seed in range(15):
        poses = np.array([[0, 0, 0], [0.0011, -0.0007, 0.03], [0.0019, 0.0006, 0.05]])
        values = textured(seed, poses) + random.normal(0, NOISE, (3, SIDE**2))
        slips = seen(values, **faulty(fault, values, random))
        for scan in (1, 2):
            off = slips.displacement[scan, 0] - moved(slips, poses, scan)
            assert (np.abs(off[:2]) < 0.1 * PITCH).all()
            assert not abs(off[2]) > np.radians(2.0)
            nees.append(off[:2] @ np.linalg.solve(slips.displacement_covariance[scan, 0, :2, :2], off[:2]) / 2)
    assert np.mean(nees) < 4


def test_a_round_contact_has_no_theta() -> None:
    random = np.random.default_rng(7)
    values = [dome(PAD, x, radius_m=0.004) for x in (0.0, 0.001, 0.002)] + random.normal(0, 500, (3, SIDE**2))
    slips = seen(values, noise=500.0)
    assert np.isnan(slips.pose[:, 0, 2]).all()
    assert np.isnan(slips.displacement_covariance[1:, 0, 2]).all()
    np.testing.assert_allclose(slips.displacement[1:, 0, :2], [[0.001, 0]] * 2, atol=1e-4)


def test_theta_counts_from_where_it_is_first_observed_and_ends_where_it_is_lost() -> None:
    round_ = [dome(PAD, radius_m=0.004)] * 2
    long = textured(1, [[0, 0, 0.1 * k] for k in range(4)])
    random = np.random.default_rng(8)
    values = np.array([*round_, *long, *round_, *long]) + random.normal(0, 100, (12, SIDE**2))
    theta = seen(values, noise=100.0).pose[:, 0, 2]
    assert np.isnan(theta[:2]).all()
    known = np.flatnonzero(np.isfinite(theta))
    assert len(known) >= 3
    assert (np.diff(known) == 1).all()
    assert known[-1] < 8
    np.testing.assert_allclose(np.diff(theta[3:6]), 0.1, atol=0.01)


def test_a_contact_that_is_cut_is_ambiguous_and_another_object_unresolved() -> None:
    inside, cut_off = (dome(PAD, x, radius_m=0.003) for x in (0.0, 0.014))
    random = np.random.default_rng(9)
    noise = random.normal(0, 50, (3, SIDE**2))
    slips = seen(np.array([inside, inside, inside]) + noise, noise=50.0)
    assert slips.quality[:, 0].tolist() == [AMBIGUOUS, OK, OK]  # the contact forms
    slips = seen(np.array([cut_off, cut_off, cut_off]) + noise, noise=50.0)
    assert slips.quality[:, 0].tolist() == [AMBIGUOUS] * 3
    changed = textured(1, [[0, 0, 0]])[0]
    slips = seen(np.array([inside, changed, changed]) + noise, noise=50.0)
    assert slips.quality[1, 0] == UNRESOLVED
    assert slips.quality[2, 0] != UNRESOLVED


def test_a_contact_begins_at_its_centroid_and_anew_after_lift_off() -> None:
    contact = np.array([False, True, True, False, True, True])
    x = [0.0, 0.0, 0.001, 0.0, -0.004, -0.003]
    slips = seen([dome(PAD, at, radius_m=0.004) for at in x], contact=contact)
    assert np.isnan(slips.pose[~contact]).all()
    np.testing.assert_allclose(slips.pose[contact, 0, 0], np.array(x)[contact], atol=2e-4)
    assert slips.valid[:, 0].tolist() == [False, False, True, False, False, True]
    assert (slips.lag_s[contact] == 0).all()
    np.testing.assert_allclose(slips.span_s[[2, 5], 0], 0.1)


def test_a_contact_that_begins_with_a_missing_taxel_waits() -> None:
    slips = seen([dome(PAD, radius_m=0.004)] * 3, complete=[False, True, True])
    assert np.isnan(slips.pose[0]).all()
    assert slips.valid[:, 0].tolist() == [False, False, True]


def test_one_loaded_taxel_moves_by_no_more_than_is_known() -> None:
    values = np.zeros((3, SIDE**2))
    values[:, 100] = PEAK
    slips = seen(values)
    np.testing.assert_allclose(slips.displacement[1:, 0, :2], 0, atol=1e-9)
    assert np.isfinite(slips.covariance[:, 0, :2, :2]).all()


@pytest.mark.parametrize(("std", "anywhere"), [(SIDE - 1.1, False), (SIDE - 0.9, True)])
def test_steps_whose_errors_add_up_to_the_pads_length_leave_the_object_anywhere(std: float, anywhere: bool) -> None:
    places = np.stack([PAD.layout.x_m, PAD.layout.y_m]) / PITCH
    assert is_anywhere(np.diag([std**2, 0.01, 0.01]), places) == anywhere


@pytest.mark.parametrize(("rows", "cols"), [(12, 1), (1, 12)])
def test_a_line_of_taxels_measures_along_it_and_not_across(rows: int, cols: int) -> None:
    line = grid_sensor(rows, cols, pitch_m=(0.004, 0.004))
    along, across = (0, 1) if rows == 1 else (1, 0)
    way_m = np.linspace(-0.008, 0.008, 40)
    place_m = np.stack([line.layout.x_m, line.layout.y_m])[along]
    values = 60e3 * np.exp(-((place_m - way_m[:, np.newaxis]) ** 2) / (2 * 0.006**2))
    values += np.random.default_rng(0).normal(0, 500.0, values.shape)
    slips = slips_by("registration", line, scans_of(line, values, noise=500.0))
    moved = slips.pose[:, 0, along] - slips.pose[0, 0, along]
    assert np.sqrt(np.mean((moved - (way_m - way_m[0])) ** 2)) < 0.3e-3
    assert not slips.displacement[1:, 0, across].any()
    assert (np.sqrt(slips.covariance[:, 0, across, across]) > 0.048).all()
    assert (slips.displacement_covariance[1:, 0, across, across] > 2 * 0.048**2).all()
    assert np.isnan(slips.displacement_covariance[0, 0]).all()
    assert np.isnan(slips.pose[:, 0, 2]).all()
    assert (slips.quality != OK).all()


def test_a_pitch_that_is_not_square_and_places_without_a_taxel_do_no_harm() -> None:
    sensor = grid_sensor(14, 10, pitch_m=(0.0034, 0.0035), missing=((0, 0), (5, 4), (13, 9)))
    poses = np.array([[0, 0, 0], [0.002, -0.0015, 0.02]])
    values = textured(2, poses, sensor=sensor, radius_m=0.012)
    random = np.random.default_rng(3)
    slips = seen(values + random.normal(0, NOISE, values.shape), sensor=sensor)
    assert (np.abs(slips.displacement[1, 0] - moved(slips, poses)) < [3e-4, 3e-4, 0.01]).all()


def test_taxels_spread_over_a_field_are_refused_with_a_word_of_advice() -> None:
    pads = tuple(Pad(f"pad{n}", 4, 4, (0.002, 0.002), origin_m=(n * 2.0, n * 2.0)) for n in range(2))
    group = Group("both", (Patch("pad0"), Patch("pad1")))
    with pytest.raises(ParameterInvalid, match=r"extent of both.*leave this group out"):
        slips_by("registration", Sensor("wide", "Pa", pads, groups=(group,)))


@pytest.mark.long
@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_the_teapots_handle_turns(recordings: Path, mode: str) -> None:
    result = estimate(recordings / "sdh-dsa" / "slip_and_rotation_teapot_handle.dsa", "registration", mode=mode)  # type: ignore[arg-type]
    pad = result.pads.index("finger2_distal")
    held = result.slips.load[:, pad] > 0.2 * result.slips.load[:, pad].max()
    theta = np.degrees(result.slips.pose[held, pad, 2])
    assert np.isfinite(theta).mean() > 0.9
    assert (
        75 < np.nanmedian(theta[-5:]) - np.nanmin(theta[:10]) < 125
    )  # the truth is 110 to 120; many small steps add up their errors


def test_readings_without_noise_have_poses_with_a_covariance() -> None:
    sensor = grid_sensor(5, 3)
    values = np.zeros((4, 15))
    values[:, 2] = 0.025
    slips = seen(values, sensor=sensor, noise=1e-150)
    assert np.isfinite(slips.pose[:, 0, :2]).all()
    assert np.isfinite(np.diagonal(slips.covariance[:, 0, :2, :2], axis1=1, axis2=2)).all()
