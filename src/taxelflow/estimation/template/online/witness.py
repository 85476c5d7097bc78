"""The centre of pressure beside the map, scan by scan, see `centre_of_pressure`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.centre_of_pressure import BORDER_ERROR
from taxelflow.estimation.template.online.hand import PadScan
from taxelflow.estimation.template.online.track_state import KEYFRAMES, Track
from taxelflow.estimation.template.two_witnesses import combine, surely, transformed
from taxelflow.messages import Floats
from taxelflow.numerics.bspline import state_of, states_of
from taxelflow.numerics.centroid import eccentricity_variance, loaded_centroid, pressure_centre
from taxelflow.numerics.cut import HIDDEN
from taxelflow.numerics.geometry import turned
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.numerics.small_linalg import eigenvalues2
from taxelflow.runtime.compiling import kernel, lean_kernel

if TYPE_CHECKING:
    from taxelflow.estimation.template.centre_of_pressure import Anchor


@kernel
def middle_of(scan: PadScan, floor: float, out: Floats) -> None:
    """Fill out (5,), see `pressure_centre`, of the readings as they are: a map's error is in the gains, too.

    On a sensor without unseen error, floor 0, only of those that surely are load.
    """
    if floor > 0.0:
        pressure_centre(scan.raw, scan.variance, scan.places, scan.edge, out)
    else:
        loaded_centroid(scan.reading, scan.variance, scan.places, scan.edge, out[:4])


def anchor(m: Track, middle: Floats, arm: Floats | None = None) -> None:
    """Report the point of an object by which it was known before, or else the centre of pressure (2,) of its contact.

    arm: (3, 2), see `arm_on_map`.
    """
    if arm is None:
        angle = float(state_of(m.state).theta) - m.theta_0
        m.arm[:], m.gauge[:], m.arm_load = turned(middle - m.state[:2] - m.origin, -angle), 0.0, m.load
        m.inside[:], m.shift[:], m.sure[:] = np.nan, 0.0, 0.0
    else:
        m.arm[:], m.gauge[:], m.inside[:] = (turned(one, m.theta_0) for one in arm)
        m.arm_load = np.inf
    m.centroid[:] = middle
    put_anew(m)


def put_on_average(m: Track, anchor: Anchor) -> None:
    """Report the point of the object on which the centre of pressure lies on average, but of an object that was known
    before, or is seen along a line only.
    """
    m.inside[:] = turned(anchor.inside, m.theta_0)
    if np.isfinite(m.arm_load) and not np.any(m.across > 0.0):
        m.arm[:] = turned(anchor.arm, m.theta_0)


def keep_shift(m: Track, middle: Floats) -> None:
    """Keep the shift by the border on a new pattern of the last scan alone, which does not show it. middle: (2,), the
    centre of pressure of that scan.
    """
    if not np.isnan(m.inside).any():
        m.inside[:] = turned(middle - m.state[:2] - m.shift, m.theta_0 - float(state_of(m.state).theta))


def put_anew(m: Track) -> None:
    """Begin at a place that no motion led to."""
    m.continues = False
    m.speed[:], m.start[:] = 0.0, reported_place(m, m.state)


def arm_on_map(m: Track) -> Floats:
    """(3, 2), in pitches, from the origin of the map to where its centre of pressure lies, from there to the point of
    the object that is reported, and from the origin to the centre of the pressure that it shows.
    """
    return np.stack([turned(one, -m.theta_0) for one in (m.arm, m.gauge, m.inside)])


def reported_place(m: Track, state: Floats) -> Floats:
    """(2,), in pitches, of the point of the object that is reported, on the map alone. state: (5,) of the object."""
    place: Floats = reported_places(m, state[np.newaxis])[0]
    return place


def reported_places(m: Track, states: Floats) -> Floats:
    """(n, 2), `reported_place` of states (n, 5): reading fields of a record takes a few microseconds each time."""
    arm = m.arm + m.gauge
    away = turned(arm, states_of(states).theta - m.theta_0)
    places: Floats = states[:, :2] + m.origin + np.where(m.across > 0.0, arm, away)
    return places


@lean_kernel
def reported_arm(scale: float, m: Track) -> tuple[float, float]:
    """From the place of the state to the point that is reported, m; a turn moves it only where taxels show motion.

    scale: of a pitch, m.
    """
    angle = m.state[2] - m.theta_0
    cos, sin = np.cos(angle), np.sin(angle)
    along, up = m.arm[0] + m.gauge[0], m.arm[1] + m.gauge[1]
    x = along if m.across[0] > 0.0 else cos * along - sin * up
    y = up if m.across[1] > 0.0 else sin * along + cos * up
    return scale * x, scale * y


@lean_kernel
def move_covariance(x: float, y: float, cov: Floats) -> None:
    """Make a covariance (3, 3) of a pose that of a point of the object at x and y from it."""
    turn, along, across = cov[2, 2], cov[0, 2], cov[1, 2]
    cov[0, 0] += y * y * turn - 2.0 * y * along
    cov[1, 1] += x * x * turn + 2.0 * x * across
    cov[0, 1] += x * along - y * across - x * y * turn
    cov[0, 2], cov[1, 2] = along - y * turn, across + x * turn
    cov[1, 0], cov[2, 0], cov[2, 1] = cov[0, 1], cov[0, 2], cov[1, 2]


@lean_kernel
def find_shift(floor: float, m: Track) -> None:
    """Make m.shift, where the pattern shows the centre of pressure, by how much the border has moved that.

    Nothing for a contact that grows, whose centre is its own, and where the centre of pressure is no witness, floor 0;
    nor before keyframes were adjusted, for a contact that forms shows more and more of its pattern.
    """
    angle = m.state[2] - m.theta_0
    cos, sin = np.cos(angle), np.sin(angle)
    m.shift[0] -= m.state[0] + cos * m.inside[0] - sin * m.inside[1]
    m.shift[1] -= m.state[1] + sin * m.inside[0] + cos * m.inside[1]
    if floor <= 0.0 or m.grows or m.across[0] > 0.0 or m.across[1] > 0.0 or np.isnan(m.shift[0]):
        m.shift[0] = m.shift[1] = 0.0


@lean_kernel
def add_errors(scale: float, m: Track, cov: Floats) -> None:
    """Add to cov (2 or more, ...) of a place on the map what errors of the pattern and a tilt of the load add.

    scale: of a pitch.
    """
    angle, unit = m.state[2], scale * scale
    cos, sin = np.cos(angle), np.sin(angle)
    xx, xy, yy = transformed(cos, -sin, sin, cos, (m.tilt[0], m.tilt[1], m.tilt[2]))
    cov[0, 0], cov[1, 1] = cov[0, 0] + unit * (m.slack + xx), cov[1, 1] + unit * (m.slack + yy)
    cov[0, 1], cov[1, 0] = cov[0, 1] + unit * xy, cov[1, 0] + unit * xy


@lean_kernel
def find_sure_shift(scale: float, m: Track, cov: Floats) -> None:
    """Make m.sure what of m.shift counts, see `surely`. scale: of a pitch, m. cov: (3, 3), of the pose on the map."""
    own, unit = m.centroid_covariance, 1.0 / (scale * scale)
    xx, yy = own[0] + own[3] + unit * cov[0, 0], own[2] + own[5] + unit * cov[1, 1]
    share = surely((m.shift[0], m.shift[1]), (xx, own[1] + own[4] + unit * cov[0, 1], yy))
    m.sure[0], m.sure[1] = share * m.shift[0], share * m.shift[1]


@lean_kernel
def follow_centre(scale: float, floor: float, m: Track) -> None:
    """Report the point where the centre of pressure lies on average, from the next scan on, while no turn is seen.

    A turn that is not observable moves this point least; the change is no motion. Where the border cuts a contact that
    has moved, its centre of pressure is not the object's: a map without unseen error is right there, floor 0. scale: of
    a pitch, m.
    """
    in_line = m.across[0] > 0.0 or m.across[1] > 0.0
    enters = floor <= 0.0 and m.cut and m.away > KEYFRAMES.near
    if m.seen or m.grows or in_line or enters or m.load <= 0.0:
        return
    before_x, before_y = reported_arm(scale, m)
    angle = m.state[2] - m.theta_0
    cos, sin = np.cos(angle), np.sin(angle)
    x = m.centroid[0] - m.sure[0] - m.state[0] - m.origin[0]
    y = m.centroid[1] - m.sure[1] - m.state[1] - m.origin[1]
    own = m.centroid_covariance[0] + m.centroid_covariance[2]
    doubted = m.shift[0] * m.shift[0] + m.shift[1] * m.shift[1]
    load = m.load * (own / (own + doubted) if doubted > 0.0 else 1.0)
    m.arm_load += load
    share = load / m.arm_load
    m.arm[0] += share * (cos * x + sin * y - m.arm[0])
    m.arm[1] += share * (cos * y - sin * x - m.arm[1])
    x, y = reported_arm(scale, m)
    m.before[0] += x - before_x
    m.before[1] += y - before_y


@lean_kernel
def find_centre(scale: float, m: Track, centre: Floats) -> None:
    """Fill centre (5,), see `Track.before_centre`, uncut and moved as the reported point is. scale: of a pitch, m."""
    angle = m.state[2] - m.theta_0
    cos, sin = np.cos(angle), np.sin(angle)
    centre[0] = scale * (m.centroid[0] - m.sure[0] + cos * m.gauge[0] - sin * m.gauge[1])
    centre[1] = scale * (m.centroid[1] - m.sure[1] + sin * m.gauge[0] + cos * m.gauge[1])
    for a in range(3):
        centre[2 + a] = scale * scale * m.centroid_covariance[3 + a]


@lean_kernel
def weigh_pose(scale: float, floor: float, m: Track, centre: Floats, pose: Floats, cov: Floats, weight: Floats) -> None:
    """Fill weight (2, 2), W, and make cov (3, 3) of a pose (3,) on its map that of both witnesses. centre: (5,)."""
    if m.load <= 0.0:
        return
    moved = np.hypot(centre[0] - scale * m.start[0], centre[1] - scale * m.start[1])
    own, unit, cut = m.centroid_covariance, scale * scale, (BORDER_ERROR * m.border * moved) ** 2
    dx, dy = m.sure[0], m.sure[1]
    xx, xy, yy = own[0] + own[3] + dx * dx, own[1] + own[4] + dx * dy, own[2] + own[5] + dy * dy
    xx, xy, yy = unit * xx, unit * xy, unit * yy
    tilt = eccentricity_variance(floor, 0.5 * (own[6] + own[8]))
    common = unit * (tilt + dx * dx) + cut, unit * dx * dy, unit * (tilt + dy * dy) + cut
    apart, is_cut = (centre[0] - pose[0], centre[1] - pose[1]), dx * dx + dy * dy > 0.0
    combine(cov, (xx + cut, xy, yy + cut), common, apart, is_cut, weight)


@lean_kernel
def leave_open(scale: float, m: Track, cov: Floats) -> None:
    """Add to cov (3, 3) of a pose that it may be anywhere along the direction in which no reading shows a motion.

    While that is undecided: along the one in which the centre of pressure shows it least, if it hides most of it.
    """
    x, y = m.open[0], m.open[1]
    if m.undecided:
        a, b, c, d = 1.0 - m.hidden[0], -m.hidden[1], -m.hidden[2], 1.0 - m.hidden[3]
        xx, xy, yy = a * a + c * c, a * b + c * d, b * b + d * d
        least = eigenvalues2(xx, yy, xy)[0]
        x, y = (xy, least - xx) if abs(xy) > NEGLIGIBLE * (xx + yy) else (1.0, 0.0) if xx <= yy else (0.0, 1.0)
        away = m.reach / np.hypot(x, y) if least < HIDDEN * HIDDEN else 0.0
        x, y = away * x, away * y
    cov[0, 0], cov[1, 1] = cov[0, 0] + scale * scale * x * x, cov[1, 1] + scale * scale * y * y
    cov[0, 1] += scale * scale * x * y
    cov[1, 0] = cov[0, 1]


@lean_kernel
def weigh_step(step: Floats, covariance: Floats, centre: Floats, before: Floats, weight: Floats) -> None:
    """Make a step (3,) on the map and its covariance (3, 3) those of both witnesses. centre, before: (5,)."""
    p, q, r, s = 1.0 - weight[0, 0], -weight[0, 1], -weight[1, 0], 1.0 - weight[1, 1]
    own = transformed(p, q, r, s, (covariance[0, 0], covariance[0, 1], covariance[1, 1]))
    noise = (centre[2] + before[2], centre[3] + before[3], centre[4] + before[4])
    other = transformed(weight[0, 0], weight[0, 1], weight[1, 0], weight[1, 1], noise)
    covariance[0, 0], covariance[1, 1] = own[0] + other[0], own[2] + other[2]
    covariance[0, 1] = covariance[1, 0] = own[1] + other[1]
    x, y = covariance[0, 2], covariance[1, 2]
    covariance[0, 2] = covariance[2, 0] = p * x + q * y
    covariance[1, 2] = covariance[2, 1] = r * x + s * y
    add_weighted(step, centre[0] - before[0] - step[0], centre[1] - before[1] - step[1], weight)


@lean_kernel
def add_weighted(place: Floats, x: float, y: float, weight: Floats) -> None:
    """Move a place by the weighted (2, 2) part of x and y."""
    place[0] += weight[0, 0] * x + weight[0, 1] * y
    place[1] += weight[1, 0] * x + weight[1, 1] * y
