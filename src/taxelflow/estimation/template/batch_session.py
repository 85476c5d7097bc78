"""The template over whole contacts: scans are held until their contact, or a window of it, is complete."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.brief_gaps import bridged, formed
from taxelflow.estimation.template.bundle_adjustment import linearised
from taxelflow.estimation.template.centre_of_pressure import witnessed
from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.dead_taxels import working
from taxelflow.estimation.template.deforming import ODOMETRY, Moment, follow_changing
from taxelflow.estimation.template.depth import as_pressure, with_depth
from taxelflow.estimation.template.hypotheses import state_precision
from taxelflow.estimation.template.map_doubt import of_map
from taxelflow.estimation.template.map_export import Maps, as_map
from taxelflow.estimation.template.observations import REFUTED, Scanned, delays_of
from taxelflow.estimation.template.pose_output import Poses, aligned, poses_of
from taxelflow.estimation.template.tilt import without_tilt
from taxelflow.estimation.template.warmup import compile_batch
from taxelflow.messages import AMBIGUOUS, OK, Bools, Estimates, Scans, cut, joined, no_scans, of_scans
from taxelflow.numerics.blas import on_one_core

if TYPE_CHECKING:
    from taxelflow.estimation.template.solution import Solved
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


class _Windows(NamedTuple):
    """How a long contact is solved."""

    overlap: int = 4
    """A window shares one part in this many with the one before."""
    readings: int = 800_000
    """Readings of a window at most: solving takes 250 bytes for each."""
    fewest_scans: int = 100
    """Scans of a window, at least."""


_WINDOWS = _Windows()


@dataclass(slots=True, eq=False)
class _Open:
    """A contact that goes on: the first scan that is still to be solved, and the poses that it shares with before."""

    start: int
    before: Floats | None = None

    @property
    def first_unknown(self) -> int:
        return self.start + (0 if self.before is None else len(self.before))


@dataclass(slots=True, eq=False)
class _Done:
    """Poses of a pad from scan `start` on; the first `known` of them were given out before. present: (scans,), any
    of its taxels was read.
    """

    pad: int
    start: int
    known: int
    poses: Poses
    t_s: Floats
    present: Bools


def _on_one_map(solved: Solved, scanned: Scanned, pitch_m: float, unseen_error: float, *, whole_contact: bool) -> Poses:
    """Poses of a contact that one map explains, doubted by its map's error and by rivals of its hypothesis.

    Unseen errors of the sensor outweigh that of the map. Without them the likelihood has decided whether the object
    turns.
    """
    precision = state_precision(solved, scanned)
    whole, level = with_depth(solved.states, solved.depth), scanned.amplitude if solved.heights else 0.0

    def information(error: float) -> tuple[Floats, Floats, Floats, Floats | None]:
        """(scans, 5, 5), of the states, blurred by errors of the readings, without the tilt; the step and the shift by
        it; and the map's part of the covariance, None where unseen errors outweigh it.
        """
        linear = linearised(solved.pattern, scanned, whole, error, precision, level)
        blocks, states = linear.normal.blocks, solved.states
        own, step, shift = without_tilt(blocks, solved.pattern, scanned, states, error, unseen_error)
        return own, step, shift, None if unseen_error else of_map(linear, precision)

    blurred, step, shift, by_map = information(max(solved.error, unseen_error))
    poses = _bridged(poses_of(replace(solved, states=solved.states + step), scanned, blurred, pitch_m), scanned)
    if by_map is None:
        if whole_contact:
            sharp = blurred if solved.error >= unseen_error else information(solved.error)[0]
            poses = poses.with_noise(sharp, solved, scanned, pitch_m)
        poses = poses.shifted(shift, pitch_m).doubted(solved.rival, pitch_m)
    elif by_map.any():
        poses = poses.with_map(by_map, solved, scanned, pitch_m)
    return poses.doubted(solved.growth, pitch_m)


def _bridged(poses: Poses, scanned: Scanned) -> Poses:
    """Poses whose brief gaps are closed, unresolved while the contact forms and while it ends."""
    return bridged(formed(poses, scanned.load().sum(axis=1)), scanned.t_s)


class BatchSession:
    """Holds scans, solves contacts, gives out what is complete. Scans are numbered from the start of the stream."""

    holds_unseen_error = True

    def __init__(self, layout: Layout, window_scans: int) -> None:
        self._layout = layout
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        largest = int(np.diff(layout.starts).max())
        self._delay, self._lead = delays_of(layout)
        self._window = int(min(window_scans, max(_WINDOWS.fewest_scans, _WINDOWS.readings / largest)))
        compile_batch()
        self._held: list[Scans] = []
        self._first = self._out = self._seen = 0  # of the scans: first held, first not given out, first not seen
        self._open: list[_Open | None] = [None] * len(layout.pads)
        self._done: list[_Done] = []
        self._dead: dict[str, set[int]] = {}
        self._alive = np.zeros(int(layout.source.max(initial=-1)) + 1, np.bool_)  # by taxel of the scan
        self.patterns = Maps()

    @property
    def notes(self) -> list[str]:
        """What the estimator has found out about the sensor."""
        return [
            f"masked, because they do not answer to the pattern: taxels {', '.join(map(str, sorted(taxels)))} of {pad}"
            for pad, taxels in self._dead.items()
        ]

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads whose contacts are complete; see `EstimatorSession.step`."""
        self._held.append(scans)
        start, self._seen = self._seen, self._seen + len(scans)
        for pad in range(len(self._layout.pads)):
            self._follow(pad, scans.contact[:, pad], start)
        return self._given()

    def finish(self) -> Estimates:
        """Estimates of contacts that last to the end of the stream."""
        for pad, going_on in enumerate(self._open):
            if going_on is not None:
                self._solve(pad, going_on, self._seen)
                self._open[pad] = None
        return self._given()

    def _follow(self, pad: int, contact: Bools, start: int) -> None:
        """Open, cut and close contacts of a pad; contact: (scans,) from scan `start` on."""
        for number, touched in enumerate(contact.tolist(), start):
            going_on = self._open[pad]
            if not touched:
                if going_on is not None:
                    self._solve(pad, going_on, number)
                    self._open[pad] = None
            elif going_on is None:
                self._open[pad] = _Open(number)
            elif number + 1 - going_on.start == self._window:
                poses = self._solve(pad, going_on, number + 1)
                shared = self._window // _WINDOWS.overlap
                self._open[pad] = _Open(number + 1 - shared, poses.pose[-shared:])

    def _solve(self, pad: int, contact: _Open, stop: int) -> Poses:
        """Solve a contact up to scan `stop` (excluded)."""
        layout, own = self._layout, self._layout.of_pad(pad)
        held = cut(self._all(), contact.start - self._first, stop - self._first)
        present = held.complete[:, pad] | (held.pressure[:, own] != 0).any(axis=1)
        scans = held if present.all() else of_scans(held, present)
        known = 0 if contact.before is None else len(contact.before)
        if not len(scans):  # no taxel of the pad was read for a window
            poses = Poses(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, np.uint8)).spread(present)
            self._done.append(_Done(pad, contact.start, known, poses, held.t_s, present))
            return poses
        pitch_m = float(self._pitch_m[pad])
        scanned = self._scanned(pad, scans, contact)
        readings, variance = scanned.readings, scanned.variance.copy()
        with on_one_core():  # the matrices are too small to share among cores
            # Where a sensor's faults may be anything, they look like a depth: it is then no better a model.
            solved = solve_contact(scanned, sinks=not layout.unseen_error)
            solved.turns &= solved.shown
            poses, moment = self._poses(pad, solved, scanned, readings)
        is_saturated = ((readings >= scans.ceiling[own]) | (variance == 0)).all(axis=1)
        poses.quality[is_saturated & (poses.quality == OK)] = AMBIGUOUS  # no reading bounds the place
        dead = layout.source[own][solved.dead]
        if len(dead):
            self._dead.setdefault(layout.pads[pad], set()).update(dead.tolist())
        poses = poses if present.all() else poses.spread(present)
        if contact.before is not None:
            poses = aligned(poses, contact.before)
        pose = poses.pose[present][moment.which[-1]]
        self.patterns.keep(as_map(layout.pads[pad], moment, pose, solved.error, pitch_m, dead))
        self._done.append(_Done(pad, contact.start, known, poses, held.t_s, present))
        return poses

    def _poses(self, pad: int, solved: Solved, scanned: Scanned, readings: Floats) -> tuple[Poses, Moment]:
        """Poses of a solved contact on its map, or by odometry where no one map explains its scans, with all that is
        uncertain about them; and the map at some moment. readings: (scans, taxels), before gains divided them.
        """
        layout, pitch_m, unseen_error = self._layout, float(self._pitch_m[pad]), self._layout.unseen_error
        of_one_map = solved.error <= REFUTED or len(scanned) <= ODOMETRY.memory
        if of_one_map:
            whole_contact = pad < layout.pad_count or layout.contact_of[pad] >= 0  # load leaves a part of one
            poses = _on_one_map(solved, scanned, pitch_m, unseen_error, whole_contact=whole_contact)
            shown = as_pressure(solved.pattern) if solved.heights else solved.pattern
            moment = Moment(shown, scanned, solved.states, np.arange(len(scanned)), solved.turns)
        else:
            poses, moment = follow_changing(scanned, pitch_m, turns=solved.turns)
            poses = _bridged(poses, scanned)
        poses = poses.open_across(scanned, pitch_m)
        if unseen_error:
            edge: Bools = np.asarray(layout.border[layout.of_pad(pad)].any(axis=1), dtype=np.bool_)
            as_read = replace(scanned, readings=readings)
            poses = witnessed(poses, as_read, edge, pitch_m, unseen_error, solved if of_one_map else None)
        if unseen_error and of_one_map:
            poses = poses.open_along(solved.hidden.direction, scanned, pitch_m)
        return poses, moment

    def _scanned(self, pad: int, scans: Scans, contact: _Open) -> Scanned:
        """A pad's part of the scans of a contact."""
        layout, own = self._layout, self._layout.of_pad(pad)
        readings = np.ascontiguousarray(scans.pressure[:, own])
        variance = np.repeat((scans.noise[own] ** 2)[np.newaxis], len(scans), axis=0)
        variance[~scans.complete[:, pad, np.newaxis] & (readings == 0)] = 0.0  # missing, not unloaded
        places = np.stack([layout.x_m[own], layout.y_m[own]]) / self._pitch_m[pad]
        has_turned = contact.before is not None and bool(np.isfinite(contact.before[:, 2]).any())
        unseen = 0.0 if has_turned else layout.unseen_error  # what a window before has shown needs no proof
        self._alive[layout.source[own]] |= working(readings, scans.noise[own])
        limits = scans.ceiling[own], self._delay[own], unseen, self._alive[layout.source[own]]
        return Scanned.of(scans.t_s, places, readings, variance, *limits)

    def _all(self) -> Scans:
        self._held = [joined(self._held or [no_scans(self._layout.entries, len(self._layout.pads))])]
        return self._held[0]

    def _given(self) -> Estimates:
        """Estimates of all scans that are known on every pad."""
        stop = min([going_on.first_unknown for going_on in self._open if going_on is not None] + [self._seen])
        scans = self._all()
        out = cut(scans, self._out - self._first, stop - self._first)
        estimates = Estimates.unknown(out)
        waiting = []
        for done in self._done:
            self._fill(estimates, done)
            if done.start + len(done.poses) > stop:
                waiting.append(done)
        self._done = waiting
        first = min([going_on.start for going_on in self._open if going_on is not None] + [stop])
        self._held = [cut(scans, first - self._first, len(scans))]  # what windows share is needed again
        self._first, self._out = first, stop
        return estimates

    def _fill(self, estimates: Estimates, done: _Done) -> None:
        """Put the part of a solved contact that is new, and in the block given out, into it."""
        low = max(done.start + done.known, self._out)
        high = min(done.start + len(done.poses), self._out + len(estimates))
        if high <= low:
            return
        rows, part = slice(low - self._out, high - self._out), slice(low - done.start, high - done.start)
        poses, pad = done.poses, done.pad
        estimates.pose[rows, pad] = poses.pose[part]
        estimates.covariance[rows, pad] = poses.covariance[part]
        estimates.quality[rows, pad] = poses.quality[part]
        estimates.lag_s[rows, pad] = -self._lead[pad]
        moved, noise, span = poses.steps(done.t_s, done.present)
        estimates.displacement[rows, pad] = moved[part]
        estimates.displacement_covariance[rows, pad] = noise[part]
        estimates.span_s[rows, pad] = span[part]
