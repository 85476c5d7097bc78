"""The patterns that the scans of a hand are registered on, as they begin, are learned, and are put in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.map_export import Maps
from taxelflow.estimation.template.observations import across, delays_of
from taxelflow.estimation.template.online.map_update import first_pattern
from taxelflow.estimation.template.online.mapping_thread import Learner, Novel
from taxelflow.estimation.template.online.relocalization import DOUBT, recognised
from taxelflow.estimation.template.online.step import FOLLOW, follow_hand
from taxelflow.estimation.template.online.track_state import (
    MOST_KEYFRAMES,
    Hand,
    PadScan,
    Patterns,
    Rows,
    Scan,
    Track,
)
from taxelflow.messages import Estimates, no_scans
from taxelflow.numerics.bspline import GAIN, THETA
from taxelflow.numerics.centroid import loaded_centroid
from taxelflow.numerics.records import record, records

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from taxelflow.estimation.template.online.local_map import Learned
    from taxelflow.messages import Bools, Floats, Scans
    from taxelflow.sensors.layout import Layout

_TURN_STD = 0.1
"""How far theta may move from scan to scan, rad."""
_LEAST_GAIN_STD = 0.05
_PROBATION = 3
"""A pattern that was recognised is looked for all over the pad until so many scans have told where it is."""


class LocalMaps:
    """Tracks and patterns of all pads, what is being learned, and the maps of contacts that ended.

    hand, tracks, stored: as kernels read them. learners: (pads,). kept: maps of ended contacts.
    """

    def __init__(self, layout: Layout, worker: Executor, latency_s: float) -> None:
        self._layout = layout
        pads = len(layout.pads)
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        self._places = np.stack([layout.x_m, layout.y_m]) / np.repeat(self._pitch_m, np.diff(layout.starts))
        late, lead_s = delays_of(layout)
        self._delay = late if late.any() else np.zeros(0)
        edge: Bools = np.asarray(layout.border.any(axis=1), dtype=np.bool_)
        self.hand = Hand(self._places, self._delay, edge, layout.starts, self._pitch_m, lead_s, layout.unseen_error)
        self.tracks = records(Track, pads)
        self.stored = Patterns(np.zeros((pads, 8, 8)), np.zeros((pads, 8, 8)), np.zeros((4, layout.entries)))
        self.learners = [Learner(worker, latency_s) for _ in range(pads)]
        self.kept = Maps()
        self._across = np.zeros((pads, 2), dtype=np.bool_)  # of the taxels that are not masked
        self._nothing = rows_of(room_for(no_scans(layout.entries, pads, 1)))

    def learn_from(self, pad: int, scan: Scan) -> None:
        """Make a scan a keyframe, and begin to learn from it."""
        m, part = self.track(pad), self.part(pad, scan)
        late = self._late(pad) if len(self._delay) else np.zeros(0)
        bend = m.speed[:, np.newaxis] * late
        novel = Novel(scan.t, part.reading.copy(), part.variance.copy(), bend, m.state.copy())
        self.learners[pad].learn_from(novel)
        if m.keyframes < MOST_KEYFRAMES:
            m.keyframe[m.keyframes] = m.state[: GAIN + 1]
            m.keyframes += 1
        self.go_on(pad)

    def run(self, job: int, scan: Scan, rows: Rows, k: int = 0) -> int:
        """Follow a scan on the patterns of the pads in contact, fill row k, or both."""
        return follow_hand(job, k, scan, self.hand, self.stored, self.tracks, rows)

    def track(self, pad: int) -> Track:
        """What a pad remembers; writing to it writes to `tracks`."""
        return record(Track, self.tracks, pad)

    def part(self, pad: int, scan: Scan) -> PadScan:
        """A pad's part of a scan."""
        own = self._layout.of_pad(pad)
        places = np.ascontiguousarray(self._places[:, own])
        return PadScan(scan.reading[own], scan.variance[own], scan.ceiling[own], places, self.hand.edge[own])

    def _late(self, pad: int) -> Floats:
        """(taxels,), delays of a pad's taxels."""
        own = self._layout.of_pad(pad)
        return self._delay[own] if len(self._delay) else np.zeros(own.stop - own.start)

    def mask(self, noise: Floats) -> None:
        """See which pads have but a line of taxels left."""
        for pad, own in enumerate(self.learners):
            taxels = self._layout.of_pad(pad)
            self._across[pad] = across(self._places[:, taxels], noise[taxels] > 0)
            if own.learned is not None:
                self._open_across(pad, own.learned)

    def _open_across(self, pad: int, learned: Learned) -> None:
        """Leave open where the object is across a line of taxels, the pattern's or those that are left."""
        scanned = learned.keyframes.scanned
        self.track(pad).across[:] = scanned.reach * (scanned.across | self._across[pad])

    def begin(self, pad: int, scan: Scan) -> None:
        """A new contact: a pattern known from before, or else a new one from its first scan."""
        part, middle = self.part(pad, scan), np.empty(4)
        loaded_centroid(part.reading, part.variance, part.places, part.edge, middle)
        self.tracks[pad] = np.zeros((), self.tracks.dtype)
        m = self.track(pad)
        for known in reversed(self.learners[pad].library):
            found = recognised(known, middle[:2], part)
            if found is not None:
                self._put(pad, known)
                m.state[:] = found[0]
                m.probation, m.theta_0 = _PROBATION, found[0][THETA]
                break
        else:
            learned = first_pattern(scan.t, part, self._late(pad))
            self._put(pad, learned)
            m.state[:] = learned.keyframes.states[0]
        m.last_t, m.load = scan.t, middle[3]
        m.centroid[:] = middle[:2]

    def learn_anew(self, pad: int, scan: Scan, *, known_place: bool = True) -> None:
        """A new pattern from this scan, which stays where it is, if that is known."""
        m = self.track(pad)
        if not known_place:
            m.continues = False
            m.speed[:] = 0.0
        m.theta_0 -= m.state[THETA]
        m.probation = m.poor = 0.0
        self.settle(pad)
        learned = first_pattern(scan.t, self.part(pad, scan), self._late(pad), m.state[:2] if known_place else None)
        self._put(pad, learned)
        m.state[:] = learned.keyframes.states[0]

    def _put(self, pad: int, learned: Learned) -> None:
        """Make what was learned the pattern that scans are registered on."""
        pattern, m = learned.pattern, self.track(pad)
        rows, cols = pattern.shape
        room = self.stored.patterns.shape[1:]
        if rows > room[0] or cols > room[1]:
            more = ((0, 0), (0, max(rows - room[0], 0) + 8), (0, max(cols - room[1], 0) + 8))
            patterns, doubts = (np.pad(old, more, constant_values=np.nan) for old in self.stored[:2])
            self.stored = Patterns(patterns, doubts, self.stored.rests)
        self.stored.patterns[pad], self.stored.doubts[pad] = np.nan, np.nan
        self.stored.patterns[pad, :rows, :cols] = pattern.coefficients
        self.stored.doubts[pad, :rows, :cols] = DOUBT * pattern.doubt
        m.active, m.carries, m.turned = True, False, False
        m.lattice[:] = pattern.lattice
        m.error, m.usual, m.radius = learned.error, learned.usual, learned.radius
        m.amplitude = learned.keyframes.scanned.amplitude
        m.turn_std = _TURN_STD if learned.turns else 0.0
        m.gain_std = max(3.0 * learned.gain_std, _LEAST_GAIN_STD)
        m.changing, m.seen, m.grows = learned.changing, learned.told, learned.grows or m.grows
        m.slack, m.slack_t = learned.slack
        self._open_across(pad, learned)
        states = learned.keyframes.states
        m.keyframes = len(states)
        m.keyframe[: len(states)] = states[:, : GAIN + 1]
        self.learners[pad].learned = learned

    def adopt(self, pad: int, last: Scan) -> None:
        """Put in what was learned, and register the last scan anew, so that its change is no motion."""
        own, m = self.learners[pad], self.track(pad)
        old, new = own.learned, own.taken()
        if old is None or new is None:
            return
        m.theta_0 += new.turned
        if new.turns and not old.turns:  # it has turned all the while
            m.state[THETA] = new.keyframes.states[-1, THETA]
        if new.grows:
            own.take_over(new, [m.state])
            if not old.grows:  # any size may be right
                m.load = 0.0
        self._put(pad, new)
        self.follow_again(pad, last._replace(t=float(m.last_t)))
        turn = m.state[THETA] - m.theta_0 if m.seen else np.nan
        m.before[:] = *(self._pitch_m[pad] * m.state[:2]), turn
        self.go_on(pad)

    def follow_again(self, pad: int, scan: Scan) -> None:
        """Register the last scan on the pattern as it is now; what the next one is predicted from stays."""
        alone = np.zeros(len(self.learners), np.bool_)
        alone[pad] = True
        m = self.track(pad)
        kept = m.speed.copy(), m.span, m.last_t
        m.speed[:] = 0.0
        self.run(FOLLOW, scan._replace(contact=alone), self._nothing)
        m.speed[:], m.span, m.last_t = kept

    def go_on(self, pad: int) -> None:
        """Begin to learn from the scans that wait."""
        m = self.track(pad)
        self.learners[pad].go_on(float(m.last_t), may_turn=bool(m.turned))

    def settle(self, pad: int) -> None:
        """Take what is still being learned when a contact, or its pattern, ends."""
        self.track(pad).theta_0 += self.learners[pad].settle()

    def keep(self, pad: int) -> None:
        """Remember the pattern of a contact that ends, as a map."""
        known = self.learners[pad].learned
        if known is None:
            return
        own, pitch_m = self._layout.of_pad(pad), self._pitch_m[pad]
        states = known.keyframes.states
        theta_0 = self.track(pad).theta_0 if known.turns else 0.0
        self.kept.add(
            self._layout.pads[pad],
            known.pattern,
            known.keyframes.scanned,
            states,
            states[-1, : THETA + 1] * [pitch_m, pitch_m, 1.0] - [0.0, 0.0, theta_0],
            error=known.error,
            pitch_m=float(pitch_m),
            turns=known.turns,
            dead=self._layout.source[own][:0],
        )


def rows_of(estimates: Estimates) -> Rows:
    """Estimates as kernels fill them in."""
    return Rows(
        estimates.pose,
        estimates.covariance,
        estimates.displacement,
        estimates.displacement_covariance,
        estimates.span_s,
        estimates.lag_s,
        estimates.disturbance,
        estimates.quality,
    )


def room_for(scans: Scans) -> Estimates:
    """Estimates to be filled in, row by row."""
    shape = scans.contact.shape
    return Estimates(
        t_s=scans.t_s,
        displacement=np.empty((*shape, 3)),
        pose=np.empty((*shape, 3)),
        covariance=np.empty((*shape, 3, 3)),
        displacement_covariance=np.empty((*shape, 3, 3)),
        span_s=np.empty(shape),
        lag_s=np.empty(shape),
        disturbance=np.empty(shape),
        quality=np.empty(shape, np.uint8),
    )
