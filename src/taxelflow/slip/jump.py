"""Jump test: a slip that is faster than the scans, during which the load almost vanishes.

A sudden change of load is a new contact to the detector, which discards the position at rest. A hand that opens and
closes looks the same from scan to scan, but takes longer than half a second. So a contact has slipped if its load fell
at once and rose again within that time, without release, and if it then rests farther from its former pose than noise
and load explain. The test is a chi-square test of the displacement with 2 degrees of freedom.

Poses are absolute: a method that lost its map on the way knows no displacement.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.messages import LOST
from taxelflow.numerics.clock import SAME_S
from taxelflow.runtime.compiling import routine
from taxelflow.slip.measurement import Measurement, Observation, Parameters


class _Load(NamedTuple):
    """A load that jumps."""

    jump: float = 0.7
    """Change of the log load from one scan to the next that makes a new contact: a factor of 2."""
    settling_times: float = 5.0
    """Longest duration of a jump, in settling times of a contact: a hand needs longer to release, grasp and settle."""


LOAD = _Load()


class JumpState:
    """State of the jump test of one pad."""

    rest_s: float
    rest_x: float
    rest_y: float
    rest_xx: float
    rest_yy: float
    rest_xy: float
    """Time, position (m) and covariance (m^2) of the last absolute pose at rest."""
    rest_log_load: float
    load_fell: bool
    """The load has fallen at once since then."""
    min_log_load: float
    """Smallest log load since it fell."""
    arrival_s: float
    largest_step_m: float
    """When the position made its largest step since the load fell, and that step."""
    x: float
    y: float
    """Last position, m."""


@routine
def store_rest(scan: Observation, measurement: Measurement, jump: JumpState) -> None:
    """The object rests at the absolute pose of this scan."""
    covariance = measurement.pose_covariance
    jump.rest_s, jump.rest_log_load = scan.t_s, measurement.log_load
    jump.rest_x, jump.rest_y = scan.pose[0], scan.pose[1]
    jump.rest_xx, jump.rest_yy, jump.rest_xy = covariance.variance[0], covariance.variance[1], covariance.xy


@routine
def start_jump(log_load: float, jump: JumpState) -> None:
    """The load of an object at rest falls at once."""
    jump.load_fell, jump.min_log_load, jump.largest_step_m = True, log_load, 0.0
    jump.x, jump.y = jump.rest_x, jump.rest_y


@routine
def track_jump(scan: Observation, log_load: float, jump: JumpState) -> None:
    """Follow load and pose after the load has fallen; a lost or unknown pose is skipped."""
    if not jump.load_fell:
        return
    jump.min_log_load = min(jump.min_log_load, log_load)
    step_m = np.hypot(scan.pose[0] - jump.x, scan.pose[1] - jump.y)
    if scan.quality == LOST or np.isnan(step_m):
        return
    jump.x, jump.y = scan.pose[0], scan.pose[1]
    if step_m > jump.largest_step_m:
        jump.largest_step_m, jump.arrival_s = step_m, scan.t_s


@routine
def jump_p_value(measurement: Measurement, parameters: Parameters, jump: JumpState) -> float:
    """Probability that noise and load displace an object at rest by as much as observed.

    1 until the load has risen again. Evaluated once: then, or after the longest duration of a jump, `load_fell` is
    reset.
    """
    if not jump.load_fell:
        return 1.0
    late = measurement.t_s - jump.rest_s > LOAD.settling_times * parameters.settle_s + SAME_S
    held = measurement.log_load - jump.min_log_load > LOAD.jump
    if late or held:
        jump.load_fell = False
    if late or not held:
        return 1.0
    largest = max(jump.rest_log_load, measurement.log_load)
    by_load = (parameters.load_m * (largest - jump.min_log_load)) ** 2
    noise = measurement.pose_covariance
    x, y = jump.x - jump.rest_x, jump.y - jump.rest_y
    xx, yy = jump.rest_xx + noise.variance[0] + by_load, jump.rest_yy + noise.variance[1] + by_load
    xy = jump.rest_xy + noise.xy
    return float(np.exp(-0.5 * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)))
