from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest

from costly import mostly_long
from rigged import rigged
from synthetic import assert_same, grid_sensor, pieces, scans_of, slips_by
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.hard_cases import CASES
from taxelflow.evaluation.nees import consistency
from taxelflow.evaluation.strokes import cut, trial, ungrouped
from taxelflow.messages import LOST, OK
from taxelflow.messages import cut as cut_scans
from taxelflow.pipeline import api
from taxelflow.sensors.pads import Pad
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.pipeline.result import Result

MODES = ("batch", "stream")
both_modes = pytest.mark.parametrize("mode", MODES)

SIDE, PITCH = 10, 0.004
PAD = grid_sensor(SIDE, SIDE, pitch_m=(PITCH, PITCH))
NOISE = 500.0
AT = (PAD.layout.x_m.tolist(), PAD.layout.y_m.tolist())
BESIDE_THE_MIDDLE, ON_THE_LINE = 139, 146
"""Taxels of the palm: of its outer row, and of the row over which the airbag goes."""


@cache
def airbag(dead: tuple[int, ...] = ()) -> tuple[Recording, Result]:
    recording = simulate(rigged("stroke", sensing={"dead": dead}))
    recording = ungrouped(recording) if dead else recording
    return recording, api.estimate(recording, "template")


@cache
def rolling(share: float, mode: Mode) -> tuple[Recording, Result]:
    """The faster stroke, its taxels read one after the other within this share of a scan's time."""
    recording = ungrouped(simulate(rigged("fast-stroke", sensing={"scan_share": share})))
    return recording, api.estimate(recording, "template", mode=mode)


@cache
def three_feet() -> Recording:
    """Three unequal feet that turn by 41 degrees, to and fro, as they slide over a grid; 85 scans in contact."""
    motion = {"kind": "strokes", "speed_m_s": 0.01, "travel_m": 0.012, "turn_rad_s": 0.6, "direction_rad": 0.5}
    contact = {"shape": "feet", "radius_m": 0.007}
    return simulate(rigged("stick-slip", contact=contact, motion=motion, sensing={"rate_hz": 25.0}))


@cache
def followed() -> Result:
    return api.estimate(three_feet(), "template")


def path(recording: Recording, result: Result) -> tuple[Bools, Floats, Floats]:
    """Scans with a pose (scans,), their poses and truths (n, 3), on the pad that is touched."""
    truth = recording.known_truth
    pose = result.slips.pose[:, result.pads.index(truth.pad)]
    known = np.isfinite(pose[:, 0])
    return known, pose[known], truth.pose[known]


def off_body(pose: Floats, truth: Floats) -> Floats:
    """(n, 3) errors in m and rad; which point of the body the pose follows, and its angle, are fitted."""
    off = pose[:, :2] - truth[:, :2]
    cos, sin = np.cos(truth[:, 2]), np.sin(truth[:, 2])
    arm = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    point, *_ = np.linalg.lstsq(arm.reshape(-1, 2), off.ravel(), rcond=None)
    turn = pose[:, 2] - truth[:, 2]
    return np.column_stack([off - arm @ point, turn - turn.mean()])


def speeds(recording: Recording, result: Result) -> tuple[float, float]:
    """Of both strokes, mm/s, each position weighed by 1 / variance."""
    truth = recording.known_truth
    pad = result.pads.index(truth.pad)
    x_m, variance = result.slips.pose[:, pad, 0], result.slips.covariance[:, pad, 0, 0]
    weight = 1 / np.where(np.isfinite(x_m), variance, np.inf)
    backward, forward = cut(truth, x_m, weight)
    return backward.all, forward.all


def feet_at(poses: Any, seed: int = 0) -> Floats:
    """Scans (poses, taxels) of two unequal bumps at poses (n, 3), with noise."""
    x_m, y_m, theta = np.asarray(poses, dtype=np.float64).T[:, :, np.newaxis]
    dx, dy = PAD.layout.x_m - x_m, PAD.layout.y_m - y_m
    u, v = np.cos(theta) * dx + np.sin(theta) * dy, np.cos(theta) * dy - np.sin(theta) * dx
    one = 60e3 * np.exp(-((u - 0.006) ** 2 + v**2) / (2 * 0.004**2))
    other = 40e3 * np.exp(-((u + 0.006) ** 2 + (v - 0.002) ** 2) / (2 * 0.0035**2))
    scans: Floats = one + other + np.random.default_rng(seed).normal(0, NOISE, (len(poses), PAD.layout.taxels))
    return scans


def way(scans: int) -> Floats:
    share = np.linspace(0.0, 1.0, scans)
    return np.stack([0.004 * np.sin(5 * share), 0.012 * share - 0.006, 0.4 * share], axis=1)


# A batch


@pytest.mark.long
def test_a_stroke_over_the_palm_has_its_speed() -> None:
    assert speeds(*airbag()) == pytest.approx((-25.0, 25.0), rel=0.006)


@pytest.mark.long
def test_a_column_of_taxels_shows_no_turn() -> None:
    _, result = airbag()
    own = result.pads.index("palm_centre")
    assert np.isfinite(result.slips.pose[:, own, 0]).any()
    assert np.isnan(result.slips.pose[:, own, 2]).all()


@pytest.mark.long
def test_a_round_object_has_no_angle() -> None:
    recording = simulate(rigged("stroke", motion={"strokes": 1}))
    _, pose, _ = path(recording, api.estimate(recording, "template"))
    assert np.isnan(pose[:, 2]).all()


@pytest.mark.long
def test_an_object_that_turns_as_it_slides_is_followed() -> None:
    recording = three_feet()
    known, pose, truth = path(recording, followed())
    assert known.sum() == 85
    assert np.ptp(truth[:, 2]) > np.radians(35)
    rms = np.sqrt(np.mean(off_body(pose, truth) ** 2, axis=0))
    assert (rms[:2] < 0.05e-3).all()
    assert rms[2] < np.radians(0.3)


@pytest.mark.long
def test_errors_of_poses_fit_their_covariances() -> None:
    recording = three_feet()
    result = followed()
    known, pose, truth = path(recording, result)
    covariance = result.slips.covariance[known, result.pads.index("grid")]
    # the pose follows a point of the body that only it knows: its error is what the fit leaves
    contact = [(off_body(pose, truth), covariance)]
    for over in (1, 20):
        nees = consistency(contact, over).nees
        assert nees is not None
        assert 0.5 < nees < 2.0


@pytest.mark.long
@pytest.mark.parametrize("dead", [BESIDE_THE_MIDDLE, ON_THE_LINE])
def test_a_dead_taxel_is_named_and_costs_no_accuracy(dead: int) -> None:
    recording, result = airbag((dead,))
    assert f"masked, because they do not answer to the pattern: taxels {dead} of palm" in result.summary.notes
    assert speeds(recording, result) == pytest.approx((-25.0, 25.0), rel=0.01)
    assert not any("do not answer" in note for note in airbag()[1].summary.notes)


@pytest.mark.long
def test_a_contact_longer_than_the_window_goes_on_without_a_jump() -> None:
    recording = three_feet()
    windows = api.estimate(recording, "template", window_scans=40)
    assert (len(followed().patterns), len(windows.patterns)) == (1, 3)
    known, pose, truth = path(recording, windows)
    assert known.sum() == 85
    error = off_body(pose, truth)
    assert np.hypot(*np.diff(error[:, :2], axis=0).T).max() < 0.2e-3
    assert np.hypot(*error[:, :2].T).max() < 0.3e-3


@pytest.mark.long
@pytest.mark.parametrize(("share", "mode"), [(24 / 162, "batch"), (1.0, "batch"), (1.0, "stream")])
def test_taxels_read_one_after_the_other_are_put_where_they_were_read(share: float, mode: Mode) -> None:
    recording, result = rolling(share, mode)
    # the first stroke of a stream begins on a pattern of a few taxels at the border
    assert speeds(recording, result) == pytest.approx((-50.0, 50.0), rel=0.01)
    pad, truth = recording.layout.pads.index("palm"), recording.known_truth
    lag_s = result.slips.lag_s[:, pad]
    taxels = recording.layout.of_pad(pad)
    np.testing.assert_allclose(lag_s[np.isfinite(lag_s)], -recording.layout.delay_s[taxels].mean())
    known = np.isfinite(lag_s) & (np.abs(truth.pose[:, 0]) < 0.03)
    off = result.slips.pose[known, pad, 0] - np.interp(truth.t_s[known] - lag_s[known], truth.t_s, truth.pose[:, 0])
    back = truth.t_s[known] < truth.t_s.mean()
    most = 0.5e-3 if mode == "batch" else 1.0e-3  # the first stroke of a stream begins at the border
    assert max(np.std(off[back]), np.std(off[~back])) < most


@pytest.mark.long
def test_with_a_rolling_scan_positions_within_a_stroke_are_steady() -> None:
    recording, result = rolling(24 / 162, "batch")
    slips, pad, truth = result.slips, recording.layout.pads.index("palm"), recording.known_truth
    known = slips.quality[:, pad] == OK
    true = np.interp(truth.t_s[known] - slips.lag_s[known, pad], truth.t_s, truth.pose[:, 0])
    off, back = slips.pose[known, pad, 0] - true, truth.t_s[known] < truth.t_s.mean()
    assert max(np.std(off[back]), np.std(off[~back])) < 0.4e-3  # each stroke has a pattern, and a frame, of its own


# A stream


def test_delays_on_one_pad_of_a_hand_change_nothing_on_another() -> None:
    plain = ungrouped(simulate(rigged("fast-stroke")))
    layout, pad = plain.layout, plain.layout.pads.index("palm")
    delay_s = np.linspace(0.0, 0.05, layout.taxels)
    delay_s[layout.of_pad(pad)] = 0.0
    late = replace(plain, sensor=msgspec.structs.replace(plain.sensor, delay_s=tuple(delay_s.tolist())))
    one, other = (api.estimate(recording, "template", mode="stream").slips for recording in (plain, late))
    assert np.isfinite(one.pose[:, pad, 0]).sum() > 20
    np.testing.assert_array_equal(other.pose[:, pad], one.pose[:, pad])


@pytest.mark.long
def test_stick_and_slip_do_not_drift() -> None:
    motion = {"stick_slip_s": 3.0, "rest_s": 0.5}
    scenario = rigged("stick-slip", motion=motion, load={"lift_s": 0.5}, sensing={"rate_hz": 50.0})
    drift, summed = [], []
    for seed in range(3):  # the choice of the first keyframes is a matter of luck
        recording = simulate(replace(scenario, seed=seed))
        result = api.estimate(recording, "template", mode="stream")
        known, _, truth = path(recording, result)
        pose = result.slips.pose[known, 0, :2]
        moved = result.slips.displacement[known, 0, :2][1:].sum(axis=0)
        assert np.hypot(*np.diff(truth[:, :2], axis=0).T).sum() > 10e-3
        way = (truth[-1] - truth[0])[:2]
        drift.append(np.hypot(*(pose[-1] - pose[0] - way)))
        summed.append(np.hypot(*(moved - way)))
    assert np.median(drift) < 0.1e-3
    assert np.median(summed) < 0.15e-3  # displacements are not corrected when the pattern is


@pytest.mark.long
def test_the_step_of_a_pose_that_growth_explains_from_then_on_is_no_motion() -> None:
    recording = simulate(rigged("hold-at-edge", motion={"turn_s": 4.0}, load={"cycles": 2}))
    slips = api.estimate(recording, "template", mode="stream").slips
    known = np.isfinite(slips.displacement[:, 0, 0])
    assert 1 <= np.count_nonzero(slips.contact[:, 0] & ~known) < 6  # touched, and seen to grow
    moved = slips.displacement[known, 0, 0] / np.sqrt(slips.displacement_covariance[known, 0, 0, 0])
    assert np.abs(moved).max() < 4.0
    assert np.ptp(slips.pose[known, 0, 0]) > 2e-4


@pytest.mark.long
def test_an_object_that_comes_back_is_recognised() -> None:
    motion = {"kind": "strokes", "travel_m": 0.14, "speed_m_s": 0.04}
    recording = simulate(rigged("stick-slip", motion=motion, load={"lift_s": 0.0}, sensing={"rate_hz": 30.0}))
    result = api.estimate(recording, "template", mode="stream")
    known, pose, truth = path(recording, result)
    first = np.flatnonzero(np.diff(known.astype(int), prepend=0) == 1)
    assert len(first) == 2
    std = np.sqrt(result.slips.covariance[:, 0, [0, 1], [0, 1]])
    before, after = (std[start : start + 5].max(axis=1) for start in first)
    assert after.max() < 0.3 * before.max()
    again = np.cumsum(known)[first[1]] - 1
    error = (pose - truth)[:, :2]
    off = error[again + 1 : again + 6] - np.median(error[again - 36 : again - 12], axis=0)  # one scan: a few taxels
    assert np.abs(off).max() < 1.0e-3  # a tenth of a pitch, of a contact that the border cuts
    assert (np.abs(off) < 3.0 * std[first[1] : first[1] + 5]).all()


@pytest.mark.long
def test_an_object_that_turns_while_it_slides_is_followed_in_a_stream() -> None:
    """Two taxels wide, it could as well be round until it has turned by some degrees."""
    recording = simulate(rigged("slide-and-turn", motion={"strokes": 1}))
    result = api.estimate(recording, "template", mode="stream")
    pad = recording.layout.pads.index("finger2_proximal")
    slips, truth = result.slips, recording.truth
    assert truth is not None
    reported = np.flatnonzero(np.isfinite(slips.pose[:, pad, 2]))
    assert reported[0] < 55  # it moves from 31 on; a turn is reported once three fits agree
    turned = truth.pose[reported[-1], 2] - truth.pose[0, 2]
    assert slips.pose[reported[-1], pad, 2] == pytest.approx(turned, abs=np.radians(1.0))  # since it was touched
    moved = np.diff(np.stack([slips.pose[reported, pad], truth.pose[reported]])[:, [10, -1]], axis=1)[:, 0]
    assert np.abs(moved[1, 2]) > np.radians(60)
    assert np.abs(moved[0] - moved[1])[:2] == pytest.approx(0.0, abs=0.1e-3)
    assert moved[0, 2] == pytest.approx(moved[1, 2], abs=np.radians(1.5))


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_a_textured_object_that_turns_is_followed_in_a_stream(seed: int) -> None:
    """Poses without a turn fit its first scans so well that they must not be where a turn is looked for."""
    contact = {"shape": "textured", "radius_m": 0.02, "wavelength_m": 0.012}
    motion = {"turn_rad_s": 1.4, "travel_m": 0.015, "speed_m_s": 0.01, "turn_s": 1.5}
    recording = simulate(replace(rigged("bar-on-grid", contact=contact, motion=motion), seed=seed))
    slips, truth = api.estimate(recording, "template", mode="stream").slips, recording.known_truth
    told = np.flatnonzero(np.isfinite(slips.pose[:, 0, 2]))
    off = (slips.pose[:, 0, 2] - truth.pose[:, 2])[told]
    assert len(told) > 100
    assert np.abs(off - np.median(off)).max() < np.radians(1.5)
    assert not (slips.quality[:, 0] == LOST).any()


@pytest.mark.long
@pytest.mark.parametrize("seed", [7008, 7010])
def test_an_object_that_comes_back_over_the_border_is_found_where_it_is(seed: int) -> None:
    """A few taxels at the border fit many a place along it."""
    scenario = trial(seed, 50)
    recording = simulate(replace(scenario, motion=replace(scenario.motion, strokes=3)))
    slips = api.estimate(recording, "template", mode="stream").slips
    pad, truth = recording.layout.pads.index(scenario.pad), recording.truth
    assert truth is not None
    back = slips.t_s > truth.t_s[70]  # the third stroke
    off = (slips.pose[:, pad] - truth.pose)[back, :2]
    std = np.sqrt(slips.covariance[back, pad, [[0], [1]], [[0], [1]]].max(axis=0))
    known = std < 0.2e-3
    assert known.sum() > 3
    assert np.abs(off[known] - np.median(off[known], axis=0)).max() < 1e-3


# Laws


@pytest.mark.long
@both_modes
def test_results_do_not_depend_on_how_the_stream_is_cut(mode: str) -> None:
    contact = np.ones(34, dtype=np.bool_)
    contact[24:27] = False
    scans = scans_of(PAD, np.where(contact[:, np.newaxis], feet_at(way(50)[:34]), 0.0), noise=NOISE, contact=contact)
    parameters = {"window_scans": 20} if mode == "batch" else {}  # the first contact is longer
    whole = slips_by("template", PAD, scans, mode=mode, **parameters)
    np.testing.assert_array_equal(np.isfinite(whole.pose[:, 0, 0]), contact)
    blocks = pieces(scans, [*range(1, 9), 15, 22, 25, 26, 33])
    assert_same(slips_by("template", PAD, *blocks, mode=mode, **parameters), whole)


@pytest.mark.long
@both_modes
def test_the_scale_of_pressure_changes_no_pose(mode: str) -> None:
    values = feet_at(way(40)[:16])
    one = slips_by("template", PAD, scans_of(PAD, values, noise=NOISE), mode=mode)
    other = slips_by("template", PAD, scans_of(PAD, 1e-3 * values, noise=1e-3 * NOISE), mode=mode)
    np.testing.assert_allclose(other.pose, one.pose, atol=2e-6)
    np.testing.assert_array_equal(other.quality, one.quality)


# Bad input


@pytest.mark.parametrize("scans", [19, 100_001])
def test_a_window_out_of_range_is_refused(scans: int) -> None:
    with pytest.raises(ParameterInvalid, match=rf"window_scans must be between 20 and 100000 scans \(got {scans}\)"):
        api.estimator("template", window_scans=scans)


@pytest.mark.parametrize("latency_s", [-0.1, float("nan"), float("inf")])
def test_a_latency_that_cannot_be_is_refused(latency_s: float) -> None:
    with pytest.raises(ParameterInvalid, match="latency_s must be a finite time, 0 s or more"):
        api.estimator("template", latency_s=latency_s)


def shaped(slips: Slips, scans: int) -> Slips:
    assert slips.pose.shape == slips.displacement.shape == (scans, 1, 3)
    assert slips.covariance.shape == slips.displacement_covariance.shape == (scans, 1, 3, 3)
    assert slips.span_s.shape == slips.lag_s.shape == slips.quality.shape == (scans, 1)
    return slips


@both_modes
@pytest.mark.parametrize("scans", [1, 2])
def test_a_contact_of_one_or_two_scans_has_poses(mode: str, scans: int) -> None:
    contact = np.arange(7) < scans
    values = np.where(contact[:, np.newaxis], feet_at(way(7)), 0.0)
    slips = shaped(slips_by("template", PAD, scans_of(PAD, values, noise=NOISE, contact=contact), mode=mode), 7)
    np.testing.assert_array_equal(np.isfinite(slips.pose[:, 0, :2]).all(axis=1), contact)
    assert np.isfinite(slips.displacement[:, 0, 0]).tolist() == [0 < scan < scans for scan in range(7)]


@both_modes
def test_a_pad_that_is_saturated_everywhere_has_no_certain_pose(mode: str) -> None:
    scans = scans_of(PAD, np.full((30, PAD.layout.taxels), 100e3), noise=NOISE, ceiling=100e3)
    slips = shaped(slips_by("template", PAD, scans, mode=mode), 30)
    assert (slips.quality != OK).all()
    moved, noise = slips.displacement[1:, 0, :2], slips.displacement_covariance[1:, 0, :2, :2]
    assert (np.einsum("ka,kab,kb->k", moved, np.linalg.inv(noise), moved) < 1.0).all()


@pytest.mark.parametrize("window", mostly_long([1000, 20], 1000))
def test_a_pad_that_is_read_every_other_time_moves_as_it_is_read(window: int) -> None:
    poses = way(60)
    values, t_s = feet_at(poses), 0.02 * np.arange(60)
    heard = np.arange(60) % 2 == 0
    values[~heard] = 0.0
    slips = slips_by(
        "template", PAD, scans_of(PAD, values, t_s=t_s, noise=NOISE, complete=heard), mode="batch", window_scans=window
    )
    assert np.isnan(slips.pose[~heard, 0]).all()
    assert np.isnan(slips.displacement[~heard, 0]).all()
    known = np.flatnonzero(heard)[1:]
    np.testing.assert_allclose(slips.span_s[known, 0], 0.04)
    shown = slips_by("template", PAD, scans_of(PAD, values[heard], t_s=t_s[heard], noise=NOISE), mode="batch")
    if window == 1000:
        np.testing.assert_array_equal(slips.pose[heard], shown.pose)
        np.testing.assert_array_equal(slips.displacement[heard], shown.displacement)
    error = np.diff(slips.pose[heard, 0, :2] - shown.pose[:, 0, :2], axis=0)
    assert np.abs(error).max() < 3e-4


def test_a_pad_that_is_silent_for_a_window_has_no_pose_in_it() -> None:
    values, silent = feet_at(way(80)), (np.arange(80) >= 20) & (np.arange(80) < 60)
    values[silent] = 0.0
    scans = scans_of(PAD, values, noise=NOISE, complete=~silent)
    slips = shaped(slips_by("template", PAD, scans, mode="batch", window_scans=20), 80)
    assert np.isnan(slips.pose[silent, 0]).all()
    assert np.isfinite(slips.pose[~silent, 0, :2]).all()


@both_modes
@pytest.mark.parametrize("contact", [True, False])
def test_scans_of_zeros_do_no_harm(mode: str, contact: bool) -> None:
    scans = scans_of(PAD, np.zeros((30, PAD.layout.taxels)), noise=NOISE, contact=contact)
    slips = shaped(slips_by("template", PAD, scans, mode=mode), 30)
    assert not np.nan_to_num(slips.displacement).any()
    assert contact or np.isnan(slips.pose).all()


@both_modes
@pytest.mark.parametrize(("rows", "cols", "masked"), mostly_long([(12, 1, 0), (1, 12, 0), (12, 2, 1)], (12, 1, 0)))
def test_a_line_of_taxels_measures_along_it_and_not_across(mode: str, rows: int, cols: int, masked: int) -> None:
    line = grid_sensor(rows, cols, pitch_m=(PITCH, PITCH))
    along, across = (0, 1) if rows == 1 else (1, 0)
    way_m = np.linspace(-0.008, 0.008, 40)
    place_m = np.stack([line.layout.x_m, line.layout.y_m])
    values = 60e3 * np.exp(-((place_m[along] - way_m[:, np.newaxis]) ** 2) / (2 * 0.006**2))
    values += np.random.default_rng(0).normal(0, NOISE, values.shape)
    noise = np.full(values.shape[1], NOISE)
    dead = place_m[across] > 0 if masked else np.zeros(len(noise), dtype=np.bool_)
    values[:, dead], noise[dead] = 0.0, 0.0
    slips = shaped(slips_by("template", line, scans_of(line, values, noise=noise), mode=mode), 40)
    moved = slips.pose[:, 0, along] - slips.pose[0, 0, along]
    assert np.sqrt(np.mean((moved - (way_m - way_m[0])) ** 2)) < 0.3e-3
    assert np.ptp(slips.pose[:, 0, across]) == 0.0
    assert (np.sqrt(slips.covariance[:, 0, across, across]) > 12 * PITCH).all()
    assert np.median(np.sqrt(slips.covariance[:, 0, along, along])) < 0.5 * PITCH
    assert np.isnan(slips.pose[:, 0, 2]).all()
    assert (slips.quality != OK).all()


@pytest.mark.long
def test_a_pad_of_which_a_line_is_left_does_not_measure_across() -> None:
    scans = scans_of(PAD, feet_at(way(60)), noise=NOISE)
    left = PAD.layout.col == SIDE // 2
    first, last = cut_scans(scans, 0, 30), cut_scans(scans, 30, 60)
    last = replace(last, noise=np.where(left, NOISE, 0.0), pressure=np.where(left, last.pressure, 0.0))
    slips = slips_by("template", PAD, first, last, mode="stream")
    assert (slips.quality[5:30] == OK).mean() > 0.8
    assert (slips.quality[30:] != OK).all()
    np.testing.assert_allclose(slips.displacement[31:, 0, 0], 0.0, atol=1e-15)
    assert (slips.covariance[30:, 0, 0, 0] > (SIDE * PITCH) ** 2).all()


@pytest.mark.long
def test_one_wrong_reading_does_not_drop_a_young_pattern() -> None:
    poses = way(40)[:16]
    values, sound = feet_at(poses), feet_at(poses)
    values[8, 33] = 600e3
    wrong, right = (
        slips_by("template", PAD, scans_of(PAD, one, noise=NOISE), mode="stream") for one in (values, sound)
    )
    assert np.isfinite(wrong.displacement[1:, 0, 0]).sum() >= 14
    off = np.delete(wrong.pose[:, 0, :2] - right.pose[:, 0, :2], 8, axis=0)
    assert np.abs(off).max() < 1e-3


@pytest.mark.long
@both_modes
def test_where_a_table_has_its_origin_shifts_poses_and_no_more(mode: str) -> None:
    far = msgspec.structs.replace(
        PAD, pads=(Pad(name="pad0", taxels=tuple((x + 0.3, y - 0.2) for x, y in zip(*AT, strict=True))),)
    )
    near = msgspec.structs.replace(PAD, pads=(Pad(name="pad0", taxels=tuple(zip(*AT, strict=True))),))
    values = feet_at(way(40)[:16])
    one, other = (slips_by("template", at, scans_of(at, values, noise=NOISE), mode=mode) for at in (near, far))
    np.testing.assert_allclose(other.pose[:, 0, :2] - one.pose[:, 0, :2], np.full((16, 2), [0.3, -0.2]), atol=1e-5)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-2)


@pytest.mark.long
def test_a_pattern_of_noise_is_dropped_when_the_object_comes() -> None:
    noise = np.random.default_rng(0).normal(0, NOISE, (8, PAD.layout.taxels))
    values = np.concatenate([noise, feet_at(way(40)[:20])])
    slips = slips_by("template", PAD, scans_of(PAD, values, noise=NOISE), mode="stream")
    centre = (values[8:] @ np.stack([PAD.layout.x_m, PAD.layout.y_m]).T) / values[8:].sum(axis=1, keepdims=True)
    assert np.isnan(slips.displacement[8, 0]).all()
    assert np.hypot(*(slips.pose[8:, 0, :2] - centre).T).max() < 0.5 * PITCH


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 9])
def test_a_round_object_that_slides_over_the_pad_four_times_does_not_turn(seed: int) -> None:
    (case,) = (one for one in CASES if one.mode == "stream")
    recording = ungrouped(simulate(case.change(trial(seed, 25))))
    palm = api.estimate(recording, "template", mode="stream")[recording.known_truth.pad]
    assert np.isnan(palm.pose[:, 2]).all()


@both_modes
def test_no_scans_give_no_slips(mode: str) -> None:
    assert len(slips_by("template", PAD, scans_of(PAD, np.zeros((0, PAD.layout.taxels))), mode=mode)) == 0
