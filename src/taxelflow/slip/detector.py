"""Slip detector of one pad, scan by scan: at rest the onset detector runs, during a slip the end detector."""

from __future__ import annotations

from math import erfc
from typing import NamedTuple

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.clock import ROUNDING_S, SAME_S
from taxelflow.numerics.records import Records, Vector
from taxelflow.runtime.compiling import kernel, routine
from taxelflow.slip.covariance import multiply, translation_variance
from taxelflow.slip.ending import SlideState, start_slide, start_stopped, stop_odds
from taxelflow.slip.jump import LOAD, JumpState, jump_p_value, start_jump, store_rest, track_jump
from taxelflow.slip.measurement import (
    Measurement,
    Observation,
    Parameters,
    has_pose,
    measure,
    measure_pose,
    raise_to_mean,
)
from taxelflow.slip.onset import OnsetState, alarm_threshold, prune, shiryaev_roberts
from taxelflow.slip.rest_filter import RestState, discount_noise_scale, noise_scale, start_rest, update_rest
from taxelflow.slip.walk import Walk, begin_walk, learn_walk, split_walk

NEW, RESTING, SLIPPING = range(3)
"""Modes of a pad: no contact, or one that is too young to be judged; at rest; slipping."""
_MIN_POSES = 3
"""Poses of a contact before it is judged."""


class _Stop(NamedTuple):
    """Odds of a stop."""

    reported: float = 3.0
    withdrawn: float = 0.02
    final: float = 30.0
    """Odds of a stop above which it is reported, and final. The report is withdrawn where those of the stops up to then
    fall below the second, if no later one is likelier than a priori: that the object stops just now, no pose of a slow
    slip excludes."""


_STOP = _Stop()
_END_SIGMAS = 2.5
"""A method without displacement stops slipping below this disturbance, standard deviations: 1 % of a still object's
scans exceed it."""
_END_P_VALUE = erfc(_END_SIGMAS / np.sqrt(2.0))
"""Of the same."""


class PadState:
    """State of the detector of one pad."""

    mode: int
    last_s: float
    """Time of the last scan."""
    first_s: float
    poses: int
    """First scan of the contact, and its scans since then."""
    partial: bool
    """The contact is what remained of one that was judged, after a sudden loss of load."""
    mean_variance: Vector
    """Mean variance of the poses at rest; 0 where there is none yet."""
    walk: Walk
    measurement: Measurement
    rest: RestState
    onset: OnsetState
    slide: SlideState
    jump: JumpState


class Change:
    """Begin or end of a slip, or a report that is withdrawn, NaN if there is none; and the statistic of the test."""

    onset_s: float
    velocity: Vector
    """m/s, m/s, rad/s; NaN where unknown."""
    statistic: float
    """The test's statistic over its threshold: above 1 it slips. NaN where the scan was not tested."""


@kernel
def follow(observations: Records, held: Records, states: Records, slipping: Bools, changes: Records) -> None:
    """Process a block of scans: fill `slipping` (scans, pads) and `changes` (scans, pads) of `Change`.

    observations: (scans, pads) of `Observation`. held: (1,) of `Parameters`. states: (pads,) of `PadState`, kept from
    block to block.
    """
    parameters: Parameters = held[0]
    for pad in range(observations.shape[1]):
        state: PadState = states[pad]
        measurement, rest, onset, slide = state.measurement, state.rest, state.onset, state.slide
        for number in range(observations.shape[0]):
            scan, change = observations[number, pad], changes[number, pad]
            _clear(change)
            silent = scan.contact and scan.load == 0.0  # no reading of the pad, which is late or slower than others
            if silent and scan.t_s - state.last_s <= parameters.settle_s + SAME_S:
                slipping[number, pad] = state.mode == SLIPPING and not slide.stop_reported
                continue
            _update_load(scan, state)
            track_jump(scan, measurement.log_load, state.jump)
            usable, undirected = _continue_contact(scan, state), not np.isnan(scan.disturbance)
            if usable and undirected:
                _test_disturbance(scan, parameters, state, change)
            measured, mode = usable and not undirected and measure(scan, measurement), state.mode
            if measured and mode == SLIPPING:
                _scale_noise(state)
                _test_stop(stop_odds(measurement, parameters.creep_m_s, slide), parameters, state, change)
            elif measured:
                raise_to_mean(state.poses, state.mean_variance, measurement.covariance)
            if measured:
                resting = mode != SLIPPING
                learn_walk(scan.pose_covariance, state.mean_variance, measurement.log_load, resting, state.walk)
                measurement.walk = (
                    split_walk(measurement.covariance, measurement.log_load, state.walk) if resting else 0.0
                )
            if measured and mode == RESTING:
                update_rest(measurement, parameters, rest)
                _test_onset(shiryaev_roberts(measurement, rest, onset), parameters, state, change)
                prune(measurement.t_s, onset)
            elif measured and mode == NEW:
                _settle(parameters, state)
            if measured:
                _test_jump(scan, parameters, state, change)
                measurement.previous_s = scan.t_s
            state.last_s = scan.t_s
            slipping[number, pad] = state.mode == SLIPPING and not slide.stop_reported


@kernel
def has_flips(last: Bools, flags: Bools) -> bool:
    """Whether flags (scans, pads) change from scan to scan, the last ones before them (1, pads) included."""
    for scan in range(flags.shape[0]):
        for pad in range(flags.shape[1]):
            if flags[scan, pad] != (flags[scan - 1, pad] if scan > 0 else last[0, pad]):
                return True
    return False


@routine
def _clear(change: Change) -> None:
    change.onset_s = change.statistic = np.nan
    for axis in range(3):
        change.velocity[axis] = np.nan


@routine
def _continue_contact(scan: Observation, state: PadState) -> bool:
    """Count the poses of a contact; False if there is none to judge."""
    if not scan.contact or (np.isnan(scan.disturbance) and not has_pose(scan, state.partial)):
        state.mode, state.poses = NEW, 0
        return False
    if state.poses == 0:
        state.first_s, state.measurement.previous_s = scan.t_s, -np.inf
        discount_noise_scale(state.rest)
        begin_walk(state.walk)
    state.poses += 1
    return True


@routine
def _update_load(scan: Observation, state: PadState) -> None:
    """Update the log load. A sudden change makes a new contact: an object, or a part of it, was grasped or released."""
    if not scan.contact:
        state.measurement.log_load = 0.0
        state.partial = state.jump.load_fell = False
    elif scan.load > 0.0:
        before, log_load = state.measurement.log_load, np.log(scan.load)
        rise = log_load - before if before != 0.0 else 0.0
        state.measurement.log_load = log_load
        if abs(rise) > LOAD.jump:
            if state.mode == RESTING and rise < 0.0:
                start_jump(log_load, state.jump)
            state.partial = rise < 0.0 and (state.partial or state.mode != NEW)  # the peak of an impact is no contact
            state.mode, state.poses = NEW, 0


@routine
def _settle(parameters: Parameters, state: PadState) -> None:
    """One more measurement of a contact that is too young to be judged."""
    measurement, rest = state.measurement, state.rest
    variance = translation_variance(measurement.covariance) * noise_scale(rest)
    yaw_known = not np.isnan(measurement.covariance.variance[2]) and (state.poses == 1 or rest.yaw_poses > 0)
    _start_rest(measurement.position, variance, yaw_known, parameters, state)
    if state.poses >= _MIN_POSES and measurement.t_s - state.first_s >= parameters.settle_s - SAME_S:
        state.mode = RESTING


@routine
def _start_rest(position: Floats, variance: float, yaw_known: bool, parameters: Parameters, state: PadState) -> None:
    """Start the rest filter at a position (3,) of this variance, m^2, and the onset detector."""
    start_rest(position, variance, state.measurement.log_load, parameters, state.rest)
    if not yaw_known:
        state.rest.yaw_poses = 0
    state.onset.count = 0


@routine
def _test_onset(statistic: float, parameters: Parameters, state: PadState, change: Change) -> None:
    """Does a slip begin? statistic: of `shiryaev_roberts`, after the last measurement of an object at rest."""
    measurement, rest, slip, step = state.measurement, state.rest, state.onset.slip, state.rest.innovation
    components = step.axes + (1 if step.yaw_used else 0)
    threshold = alarm_threshold(parameters.alarm_interval_s, measurement.t_s - measurement.previous_s, components)
    change.statistic = statistic / threshold
    if statistic > threshold:
        state.mode = SLIPPING
        start_slide(measurement, slip, rest.p_aa, state.slide)
        rest.square_sum = max(rest.square_sum - slip.explained, 0.0)  # the slip's part is not noise
        _report(slip.start_s, slip.velocity, step.yaw_used, change)


@routine
def _scale_noise(state: PadState) -> None:
    """Apply the learned scale to the noise of a measurement; the turn while theta was unknown is unknown."""
    covariance = state.measurement.covariance
    if state.slide.yaw_lost or np.isnan(covariance.variance[2]):
        state.slide.yaw_lost, covariance.variance[2] = True, np.nan
    multiply(covariance, noise_scale(state.rest))


@routine
def _test_stop(odds: float, parameters: Parameters, state: PadState, change: Change) -> None:
    """Has a slipping object stopped? odds: of `stop_odds`, after its last measurement."""
    measurement, slide, stop = state.measurement, state.slide, state.slide.stop
    change.statistic = _STOP.reported / odds
    if odds > _STOP.reported and not slide.stop_reported:
        slide.stop_reported, slide.reported_s = True, measurement.t_s
        duration_s = max(stop.since_s - slide.start_s, ROUNDING_S)
        for axis in range(3):
            slide.residual[axis] = (stop.position[axis] - slide.origin[axis]) / duration_s
        _report(stop.since_s, slide.residual, not slide.yaw_lost, change)
    elif slide.earlier_odds < _STOP.withdrawn and slide.later_evidence <= 0.0 and slide.stop_reported:
        slide.stop_reported = False
        _report(slide.start_s, slide.velocity, not slide.yaw_lost, change)
    if odds > _STOP.final:
        state.mode = RESTING
        for axis in range(3):
            state.mean_variance[axis] = 0.0  # that of another place
        _start_rest(stop.position, stop.variance, not slide.yaw_lost, parameters, state)


@routine
def _test_jump(scan: Observation, parameters: Parameters, state: PadState, change: Change) -> None:
    """Has an object that rests now jumped here since its load fell?"""
    measurement, jump = state.measurement, state.jump
    if state.mode == SLIPPING:
        jump.load_fell = False  # a motion from here on is no jump
    if state.mode != RESTING:
        return
    measure_pose(scan, noise_scale(state.rest), measurement)
    dt_s = scan.t_s - state.last_s
    if jump_p_value(measurement, parameters, jump) < dt_s / parameters.alarm_interval_s:
        state.mode = SLIPPING
        # The slip began after the last pose at rest and ended before the first one here.
        start_s, end_s = jump.rest_s + 0.25 * dt_s, jump.arrival_s - 0.25 * dt_s
        way = (jump.x - jump.rest_x, jump.y - jump.rest_y)
        start_stopped(measurement, way, start_s, end_s, dt_s, state.slide)
        _report(start_s, state.slide.velocity, False, change)
    if not jump.load_fell:
        store_rest(scan, measurement, jump)


@routine
def _test_disturbance(scan: Observation, parameters: Parameters, state: PadState, change: Change) -> None:
    """One scan of a method without displacement: it slips if noise makes such a disturbance less often than accepted.

    The disturbance is Gaussian with standard deviation 1 while the object rests.
    """
    p_value = erfc(scan.disturbance / np.sqrt(2.0))
    if state.mode == SLIPPING:
        change.statistic = _END_P_VALUE / p_value
        if scan.disturbance < _END_SIGMAS:
            state.mode = RESTING
            change.onset_s = scan.t_s
        return
    settled, accepted = scan.t_s - state.first_s >= parameters.settle_s - SAME_S, scan.t_s - state.last_s
    accepted /= parameters.alarm_interval_s
    change.statistic = accepted / p_value if settled else np.nan
    if settled and p_value < accepted:
        state.mode, state.slide.stop_reported = SLIPPING, False
        change.onset_s = scan.t_s


@routine
def _report(onset_s: float, velocity: Floats, yaw_known: bool, change: Change) -> None:
    change.onset_s = onset_s
    for axis in range(3):
        change.velocity[axis] = velocity[axis] if axis < 2 or yaw_known else np.nan
