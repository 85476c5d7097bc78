"""The track of a contact: what is kept from scan to scan, and how a step's covariance joins that of the pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.records import Vector
from taxelflow.runtime.compiling import inlined, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SCALE_ERROR = 0.03
"""Standard deviation of the share by which steps are too long or too short: a spline through taxels is too flat between
them, by 1 % for waves of six pitches and 4 % for waves of four."""


class Taxels(NamedTuple):
    """Of one pad: its number, its first entry, places (2, taxels) in pitches, noise (taxels,), and the units (3,) of a
    pose in m, m, rad. tilt: the sensor's unseen error, see `Layout`.
    """

    pad: int
    first: int
    places: Floats
    noise: Floats
    units: Floats
    tilt: float


class Scan(NamedTuple):
    """One scan of a pad: its number, and (taxels,) what is read, its variance, 0 where it is missing, and ceiling."""

    number: int
    reading: Floats
    variance: Floats
    ceiling: Floats


class Last(NamedTuple):
    """The last scan, kept from scan to scan: reading and variance (taxels,), 0 where missing or masked, the gains G
    (3, taxels) of its registration, and its spline's coefficients (ny, nx).
    """

    reading: Floats
    variance: Floats
    gains: Floats
    coefficients: Floats


class Track:
    """What is known of a contact, lengths in pitches; running: the last scan can be registered on, t_s: its time.

    pose, covariance: since the contact began; older: that of the scans before the last. path: sum of the steps; hidden:
    of what errors that stay with the taxels may have hidden of them; drift: covariance by such errors. yaw: one of
    `odometry.YAW_UNKNOWN` ... loaded: taxels of the scan by which the centre of pressure is a witness, 0 if there is
    none; angle, apart, doubt: turn, distance (2,) of pose and centre, and its covariance as xx, xy, yy by that scan.
    """

    running: bool
    yaw: int
    loaded: int
    t_s: float
    angle: float
    apart: Annotated[Floats, 2]
    doubt: Vector
    pose: Vector
    path: Vector
    hidden: Vector
    covariance: Annotated[Floats, 3, 3]
    drift: Annotated[Floats, 3, 3]
    older: Annotated[Floats, 3, 3]


@routine
def begin_sums(track: Track) -> None:
    """A contact begins: nothing is summed up yet but the pose's covariance."""
    track.loaded = 0
    for a in range(3):
        track.path[a] = track.hidden[a] = 0.0
        for b in range(3):
            track.drift[a, b] = track.older[a, b] = 0.0


@routine
def add_step(state: Floats, hidden: Floats, track: Track) -> None:
    """Add a step, state (3 or more,), to the pose and its path. hidden: (3,), what errors hide of it, over the step."""
    for a in range(3):
        track.pose[a] += state[a]
        track.path[a] += state[a]
        track.hidden[a] += state[a] * hidden[a]


@routine
def propagate(own: Floats, earlier: Floats, last: Last, track: Track, step: Floats) -> None:
    """Fill step (3, 3) with the covariance of a displacement, and bring the pose's up to date.

    own: G N1 G^T of this scan. earlier: (3, taxels), G' of the last one, whose noise is in the pose already, by G: what
    is left of it, G - G', is summed up, as the difference of large parts would be rounded to a variance below 0.
    """
    for a in range(3):
        for b in range(3):
            mine = left = 0.0
            for i in range(len(last.reading)):
                variance = last.variance[i] if last.reading[i] != 0.0 else 0.0
                mine += earlier[a, i] * earlier[b, i] * variance
                left += (last.gains[a, i] - earlier[a, i]) * (last.gains[b, i] - earlier[b, i]) * variance
            step[a, b] = own[a, b] + mine
            track.older[a, b] += left
            track.covariance[a, b] = own[a, b] + track.older[a, b]


@routine
def keep_gains(g: Floats, taxel: NDArray[np.int64], kept: Floats) -> None:
    """Put gains (3, n) of some taxels into those of all (3, taxels), which are 0 for the others."""
    for a in range(3):
        for i in range(kept.shape[1]):
            kept[a, i] = 0.0
        for j in range(len(taxel)):
            kept[a, taxel[j]] = g[a, j]


@inlined
def variance_of(track: Track, a: int, b: int) -> float:
    """Of two components of a pose, their covariance with an error of the scale of the path, in pitches and rad."""
    return float(track.covariance[a, b] + _SCALE_ERROR**2 * track.path[a] * track.path[b])


@inlined
def drift_of(track: Track, a: int, b: int) -> float:
    """Of two components of a pose, their covariance by errors that stay with the taxels, in pitches and rad."""
    return float(track.drift[a, b] + track.hidden[a] * track.hidden[b])


@inlined
def forget_turn(pose: Floats, matrix: Floats) -> None:
    """Make the turn of a pose (3,) with covariance (3, 3) unknown."""
    pose[2] = np.nan
    for a in range(3):
        matrix[2, a] = matrix[a, 2] = np.nan


@routine
def write_step(state: Floats, turns: bool, units: Floats, displacement: Floats, matrix: Floats) -> None:
    """Fill displacement (3,) and bring its covariance (3, 3) to m and rad."""
    for a in range(3):
        displacement[a] = state[a] * units[a]
        for b in range(3):
            matrix[a, b] *= units[a] * units[b]
    if not turns:
        forget_turn(displacement, matrix)


@routine
def write_pose(track: Track, shows_turn: bool, units: Floats, pose: Floats, matrix: Floats, unseen: Floats) -> None:
    """Fill pose (3,), covariance (3, 3), see `variance_of`, and unseen (3, 3), see `drift_of`, in m and rad."""
    for a in range(3):
        pose[a] = track.pose[a] * units[a]
        for b in range(3):
            matrix[a, b] = variance_of(track, a, b) * units[a] * units[b]
            unseen[a, b] = drift_of(track, a, b) * units[a] * units[b]
    if not shows_turn:
        forget_turn(pose, matrix)


@routine
def forget_unobservable(
    unobservable: Floats, begins: bool, units: Floats, own: Floats, pose_matrix: Floats, step_matrix: Floats
) -> None:
    """Along an axis that is not observable, the object may be anywhere on the pad: variances of that in all (3, 3)."""
    for a in range(2):
        if unobservable[a] > 0.0:
            pose_matrix[a, a] = (unobservable[a] * units[a]) ** 2
            step_matrix[a, a] = np.nan if begins else 2.0 * pose_matrix[a, a]
            own[a, a] = unobservable[a] ** 2
