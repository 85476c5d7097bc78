"""Odometry of one pad: each scan is registered on the one before, and the steps are added up to a pose.

In a sum of steps a scan's noise comes in once with each sign: e_k = G_k n_k + (G_k-1 - G'_k) n_k-1 + ..., so that the
error of a pose hardly grows while the object stays where it is. The covariance is summed up that way (see
`uncertainty` for G and G'), counted from an ideal first pose, as good as one scan can give.

A step is the mean of both ways, of the later scan on the earlier one and back (inverse consistency: Christensen &
Johnson, IEEE Trans. Med. Imaging 20, 2001). Noise of the surface pulls a step to one side, by less than its standard
deviation, but in each scan to the same: it cancels, as neither of two scans of a still object is the earlier one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.scan_matching.interpolant import Interpolant, fill_missing, interpolate
from taxelflow.estimation.scan_matching.matching import (
    DOF,
    Fit,
    Guess,
    Points,
    find,
    linearize,
    surface_of,
    surroundings,
    take,
)
from taxelflow.estimation.scan_matching.track import (
    Last,
    Scan,
    Taxels,
    Track,
    add_step,
    begin_sums,
    forget_unobservable,
    keep_gains,
    propagate,
    write_pose,
    write_step,
)
from taxelflow.estimation.scan_matching.uncertainty import (
    covariance,
    drift,
    earlier_gains,
    gains,
    hidden_shares,
    is_anywhere,
    is_blurred,
    turn_observability,
    turn_variance,
)
from taxelflow.estimation.scan_matching.witness import contradicts
from taxelflow.messages import AMBIGUOUS, LOST, NO_POSE, UNRESOLVED, Bools, Floats
from taxelflow.numerics.bspline import STATE, State, put
from taxelflow.numerics.centroid import CELL_ERROR, loaded_centroid
from taxelflow.numerics.records import Records
from taxelflow.numerics.robust import gate
from taxelflow.numerics.rounding import NEGLIGIBLE, OBSERVABLE
from taxelflow.numerics.small_linalg import copy_matrix
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from numpy.typing import NDArray

YAW_UNKNOWN, YAW_OBSERVABLE, YAW_LOST = range(3)
"""Of a contact's turn: not observable yet; observable; no longer, so that theta stays empty until the contact ends."""
_STILL_OBSERVABLE = 2.0
"""An observable turn stays so down to this factor, in place of `OBSERVABLE`, ..."""
_SURE_RAD = 0.1
"""... and if its standard deviation is below this. What noise does not explain of a scan counts as more noise."""


class Block(NamedTuple):
    """Scans of all pads, fields of `Scans`."""

    t_s: Floats
    pressure: Floats
    contact: Bools
    complete: Bools
    ceiling: Floats


class Steps(NamedTuple):
    """What is filled in for all pads, fields of `Estimates`; they come in as NaN and 0."""

    pose: Floats
    covariance: Floats
    displacement: Floats
    displacement_covariance: Floats
    span_s: Floats
    quality: NDArray[np.uint8]
    unseen: Floats


@kernel
def follow(block: Block, taxels: Taxels, spline: Interpolant, tracks: Records, last: Last, out: Steps) -> None:
    """Fill out (scans, pads, ...) of one pad, `taxels`. tracks: (pads,) of `Track`; they and `last` are kept from block
    to block. The arrays of all pads have one layout in memory for any number of pads: one compile.
    """
    pad, count = taxels.pad, len(taxels.noise)
    own, track = slice(taxels.first, taxels.first + count), tracks[pad]
    ceiling = block.ceiling[own]
    for k in range(len(block.t_s)):
        if not block.contact[k, pad]:
            track.running = False
            continue
        now, variance, complete = np.empty(count), np.empty(count), block.complete[k, pad]
        has_missing = prepare(block.pressure[k, own], taxels.noise, complete, now, variance)
        if not complete:
            if not has_missing and track.running:  # a gap: nobody knows what the object did meanwhile
                track.running, out.quality[k, pad] = False, LOST
            if not track.running:
                continue
        if not track.running:
            begin(now, variance, taxels, spline, track, last)
        advance(Scan(k, now, variance, ceiling), block, taxels, spline, track, last, out)
        track.running, track.t_s = True, block.t_s[k]


@routine
def prepare(pressure: Floats, noise: Floats, is_complete: bool, now: Floats, variance: Floats) -> bool:
    """Fill now and variance, all (taxels,). In an incomplete scan readings of 0 are missing; is one of a live taxel?"""
    has_missing, least = False, NEGLIGIBLE  # Pa; with less noise, weights are beyond all numbers
    for i in range(len(pressure)):
        now[i], variance[i] = pressure[i], max(noise[i], least) ** 2 if noise[i] > 0.0 else 0.0
        if not is_complete and now[i] == 0.0:
            has_missing = has_missing or noise[i] > 0.0
            variance[i] = 0.0
    return has_missing


@routine
def begin(now: Floats, variance: Floats, taxels: Taxels, spline: Interpolant, track: Track, last: Last) -> None:
    """A contact begins: its pose is the centroid, and the scan is its own predecessor."""
    middle = _middle(now, variance, taxels.places)
    track.pose[0], track.pose[1], track.pose[2] = middle[0], middle[1], 0.0
    begin_sums(track)
    track.yaw = YAW_UNKNOWN
    remember(now, variance, spline, last)


@routine
def remember(now: Floats, variance: Floats, spline: Interpolant, last: Last) -> None:
    """Make this scan the last."""
    interpolate(spline, now, last.coefficients)
    for i in range(len(now)):
        last.reading[i], last.variance[i] = now[i], variance[i]


@routine
def advance(
    scan: Scan, block: Block, taxels: Taxels, spline: Interpolant, track: Track, last: Last, out: Steps
) -> None:
    """Register a scan, add the step to the track, and fill the scan's row of out."""
    (k, now, variance, ceiling), pad = scan, taxels.pad
    matrix, step_matrix = out.covariance[k, pad], out.displacement_covariance[k, pad]
    begins = not track.running
    chosen = surroundings(last.reading, now, last.variance, variance, taxels.places)
    origin = track.pose.copy()
    points = take(chosen, now, variance, ceiling, taxels.places, origin)
    surface = surface_of(last, taxels, ceiling, spline, origin)
    fit, g = room_for(points), np.empty((3, len(points.taxel)))
    guess = Guess(0.0, 0.0, 1.0) if begins else first_guess(last, now, variance, taxels.places)
    turns = track.yaw != YAW_LOST and spline.unobservable[0] + spline.unobservable[1] == 0.0
    if not begins:
        find(surface, points, guess, False, turns, fit.state)
    chi, misfit, freedom = linearize(surface, points, fit)
    excess = max(1.0, chi / freedom)
    if turns:
        turns = is_turn_observable(track.yaw, fit, points, excess, g)
        if not turns and not begins:
            find(surface, points, guess, False, turns, fit.state)
    if not begins:
        if block.complete[k, pad]:
            take_both_ways(scan, chosen, taxels, spline, origin, guess.gain, turns, last, fit.state)
        chi, misfit, freedom = linearize(surface, points, fit)
        excess = max(1.0, chi / freedom)
    gains(fit, turns, g)
    share = CELL_ERROR if taxels.tilt > 0.0 else 0.0
    drift(g, points, share, fit.state, track.drift)
    own = covariance(g, points, excess)
    if begins:
        copy_matrix(own, track.covariance)
    else:
        update_yaw(track, turns)
        earlier = np.zeros((3, len(now)))
        earlier_gains(spline, surface.lattice, points, fit.state, g, earlier)
        propagate(own, earlier, last, track, step_matrix)
        add_step(fit.state, hidden_shares(fit, points, share), track)
        out.span_s[k, pad] = block.t_s[k] - track.t_s
        write_step(fit.state, turns, taxels.units, out.displacement[k, pad], step_matrix)
    shows_turn = track.yaw == YAW_OBSERVABLE or (begins and turns)
    write_pose(track, shows_turn, taxels.units, out.pose[k, pad], matrix, out.unseen[k, pad])
    forget_unobservable(spline.unobservable, begins, taxels.units, own, matrix, step_matrix)
    fits = misfit <= freedom * gate(1.0, freedom)
    out.quality[k, pad] = quality_of(scan, taxels, own, track, block.complete[k, pad]) if fits else UNRESOLVED
    keep_gains(g, points.taxel, last.gains)
    if not begins:
        if not block.complete[k, pad]:
            fill_missing(surface.c, surface.lattice, taxels.places, origin, taxels.noise, variance, fit.state, now)
        remember(now, variance, spline, last)


@routine
def room_for(points: Points) -> Fit:
    """Room for what is linearised, at the state of no motion."""
    count = len(points.taxel)
    fit = Fit(np.empty(STATE), np.zeros((count, DOF)), np.empty(count), np.empty((DOF, DOF)), np.empty((DOF, DOF)))
    put(State(0.0, 0.0, 0.0, 1.0, 0.0), fit.state)
    return fit


@routine
def take_both_ways(
    scan: Scan,
    chosen: NDArray[np.int64],
    taxels: Taxels,
    spline: Interpolant,
    origin: Floats,
    gain: float,
    turns: bool,
    last: Last,
    state: Floats,
) -> None:
    """Make state (5,), the motion from the last scan to this one, the mean of itself and of the way back.

    chosen: numbers of the taxels that take part. origin: (2 or more,), where the object's point was. gain: ratio of the
    loads of this scan and the last.
    """
    place = origin.copy()
    place[0] += state[0]
    place[1] += state[1]
    now = Last(scan.reading, scan.variance, last.gains, np.empty(last.coefficients.shape))
    interpolate(spline, now.reading, now.coefficients)
    surface = surface_of(now, taxels, scan.ceiling, spline, place)
    points = take(chosen, last.reading, last.variance, scan.ceiling, taxels.places, place)
    back = np.empty(STATE)
    find(surface, points, Guess(-state[0], -state[1], 1.0 / gain), True, turns, back)
    for a in range(3):
        state[a] = 0.5 * (state[a] - back[a])


@routine
def quality_of(scan: Scan, taxels: Taxels, own: Floats, track: Track, is_complete: bool) -> int:
    """Quality of a pose whose scan fits the last one. own: (3, 3), covariance by one scan. `NO_POSE` where the pipeline
    judges.
    """
    is_ambiguous = is_blurred(own) or is_anywhere(track.covariance, taxels.places)
    return AMBIGUOUS if is_ambiguous or (is_complete and contradicts(scan, taxels, track)) else NO_POSE


@routine
def first_guess(last: Last, now: Floats, variance: Floats, places: Floats) -> Guess:
    """How far the centroid has moved from the last scan to this one, and by what factor the load has changed."""
    total = last_total = 0.0
    for i in range(len(now)):
        if variance[i] > 0.0 and last.variance[i] > 0.0:
            total += now[i]
            last_total += last.reading[i]
    gain = total / last_total if total > 0.0 and last_total > 0.0 else 1.0
    before, after = _middle(last.reading, last.variance, places), _middle(now, variance, places)
    return Guess(after[0] - before[0], after[1] - before[1], gain)


@routine
def _middle(reading: Floats, variance: Floats, places: Floats) -> Floats:
    """(4,), `loaded_centroid`; where the border is does not matter here."""
    out = np.empty(4)
    loaded_centroid(reading, variance, places, np.zeros(len(reading), np.bool_), out)
    return out


@routine
def is_turn_observable(yaw: int, fit: Fit, points: Points, excess: float, g: Floats) -> bool:
    """Whether this scan's information on the turn is real and enough. excess: chi-square per reading, at least 1."""
    needed = _STILL_OBSERVABLE if yaw == YAW_OBSERVABLE else OBSERVABLE
    if turn_observability(fit) <= needed * excess:
        return False
    gains(fit, True, g)
    return turn_variance(g, points) * excess < _SURE_RAD**2


@routine
def update_yaw(track: Track, turns: bool) -> None:
    """The turn is reported from where it is first observable, until it is no longer."""
    if track.yaw == YAW_OBSERVABLE and not turns:
        track.yaw = YAW_LOST
    elif track.yaw == YAW_UNKNOWN and turns:
        track.yaw = YAW_OBSERVABLE
