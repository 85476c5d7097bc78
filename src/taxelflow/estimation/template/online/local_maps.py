"""The local map of each pad: how it begins with a contact, is replaced by an adjusted one, and ends."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.observations import across
from taxelflow.estimation.template.online.ended import Ended, map_of
from taxelflow.estimation.template.online.gauge import has_own_frame, hold
from taxelflow.estimation.template.online.hand import PadScan, Patterns, Rows, Scan, hand_of, places_of, room_for
from taxelflow.estimation.template.online.hand_gains import HandGains
from taxelflow.estimation.template.online.mapping_thread import Learner, Workers
from taxelflow.estimation.template.online.relocalization import DOUBT
from taxelflow.estimation.template.online.spreading import most_at_once
from taxelflow.estimation.template.online.starting import Begun, FirstScan, begun, begun_anew
from taxelflow.estimation.template.online.step import FOLLOW, follow_hand
from taxelflow.estimation.template.online.track_state import KEYFRAMES, Track
from taxelflow.estimation.template.online.witness import (
    add_errors,
    anchor,
    find_sure_shift,
    keep_shift,
    middle_of,
    put_on_average,
    reported_place,
)
from taxelflow.messages import no_scans
from taxelflow.numerics.bspline import STATE, state_of
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.records import record, records
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.runtime.adoption import AtFixedTimes
from taxelflow.runtime.settled import Settled

if TYPE_CHECKING:
    from taxelflow.estimation.template.online.local_map import LocalMap
    from taxelflow.messages import Floats
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.sensors.layout import Layout

_PROBATION = 3
"""A pattern that was recognised is looked for all over the pad until this many scans have shown where it is."""


class LocalMaps:
    """Tracks and maps of all pads, and the mapping beside the stream.

    hand, tracks, stored: as kernels read them. learners: (pads,). ended: exported maps of contacts that ended. gains:
    of the taxels, by which readings are divided.
    """

    def __init__(self, layout: Layout, workers: Workers, latency_s: float, adopting: Adopting | None = None) -> None:
        """adopting: at fixed times if left out."""
        adopting = adopting or AtFixedTimes(SAME_S)
        self._layout, pads = layout, len(layout.pads)
        self.hand, self.tracks = hand_of(layout), records(Track, pads)
        self._each = [record(Track, self.tracks, pad) for pad in range(pads)]  # views, which are slow to make
        self.stored = Patterns(np.zeros((pads, 8, 8)), np.zeros((pads, 8, 8)), np.zeros((4, layout.entries)))
        self.learners = [Learner(name, workers, latency_s, adopting) for name in layout.pads]
        self.ended = Ended(workers.mapper, at_once=adopting.waits)
        self._waits, self._blank = adopting.waits, np.zeros((), self.tracks.dtype)
        self._last = Scan(0.0, *(np.zeros(layout.entries),) * 4, np.zeros(pads, np.bool_))
        self.gains = HandGains(layout)
        self._across = np.zeros((pads, 2), dtype=np.bool_)  # of the taxels that are not masked
        self._follow_hand = Settled(follow_hand)
        self._nothing = room_for(no_scans(layout.entries, pads, 1))

    def learn_from(self, pad: int, scan: Scan) -> None:
        """Make a scan a keyframe, and begin to learn from it, unless the pattern was begun with it."""
        own, tracks, taxels = self.learners[pad], self.tracks, self._layout.of_pad(pad)
        if own.learned is not None and own.learned.keyframes.scanned.t_s[-1] == scan.t:
            return
        late, state = self._late(pad), tracks["state"][pad]
        bend = np.outer(tracks["speed"][pad], late if late.any() else ())  # as in `Scanned.of`, pad by pad
        own.waiting.add(scan.t, scan.reading[taxels], scan.variance[taxels], bend, state)
        held = int(tracks["keyframes"][pad])
        if held < KEYFRAMES.most:
            tracks["keyframe"][pad, held] = state
            tracks["keyframes"][pad] = held + 1
        self.go_on(pad)

    def run(self, job: int, scan: Scan, rows: Rows, k: int = 0) -> int:
        """Follow a scan on the patterns of the pads in contact, fill row k, or both."""
        return self._follow_hand(job, k, self.gains.divided(scan), self.hand, self.stored, self.tracks, rows)

    def track(self, pad: int) -> Track:
        """What a pad remembers; writing to it writes to `tracks`."""
        return self._each[pad]

    def part(self, pad: int, scan: Scan) -> PadScan:
        """A pad's part of a scan, divided by the taxels' gains."""
        return self._as_read(pad, self.gains.divided(scan))

    def _as_read(self, pad: int, scan: Scan) -> PadScan:
        """A pad's part of a scan."""
        own = self._layout.of_pad(pad)
        readings = scan.reading[own], scan.variance[own], scan.ceiling[own], scan.raw[own]
        return PadScan(*readings, places_of(self.hand, pad), self.hand.edge[own], self.hand.sides[pad])

    def _late(self, pad: int) -> Floats:
        """(taxels,), delays of a pad's taxels."""
        own = self._layout.of_pad(pad)
        return self.hand.delay[own] if len(self.hand.delay) else np.zeros(own.stop - own.start)

    def mask(self, noise: Floats) -> None:
        """See which pads have but a line of taxels left."""
        for pad, own in enumerate(self.learners):
            taxels = self._layout.of_pad(pad)
            self._across[pad] = across(places_of(self.hand, pad), noise[taxels] > 0)
            if own.learned is not None:
                self._open_across(pad, own.learned)

    def _open_across(self, pad: int, learned: LocalMap) -> None:
        """Leave open where the object is across a line of taxels, the pattern's or those that are left."""
        scanned = learned.keyframes.scanned
        self.track(pad).across[:] = scanned.reach * (scanned.across | self._across[pad])

    def begin(self, pad: int, scan: Scan) -> None:
        """A new contact: a pattern known from before, or else a new one from its first scan."""
        self.tracks[pad] = self._blank
        self.learners[pad].reported.clear()
        own, first = self.learners[pad], self._first(pad, scan)
        if self._waits:
            self._start(pad, begun(first, own.library), scan)
            return
        own.learned = None
        own.begin(scan.t, lambda new: self._start(pad, new, self._last), begun, first, own.library)

    def _start(self, pad: int, new: Begun, last: Scan) -> None:
        """Put in the pattern that a contact begins with. last: the scan that is to be followed from."""
        middle, m = self._middle(pad, last), self.track(pad)
        self._put(pad, new.learned)
        m.state[:] = new.state
        m.state[:2] += middle[:2] - new.middle
        m.last_t, m.load = last.t, middle[3]
        if new.again:
            m.probation, m.theta_0 = _PROBATION, state_of(new.state).theta
        anchor(m, middle[:2], new.learned.arm if new.again else None)

    def learn_anew(self, pad: int, scan: Scan, *, known_place: bool = True) -> None:
        """A new pattern from this scan, which stays where it is, if that is known."""
        own, first = self.learners[pad], self._first(pad, scan)
        at = self.track(pad).state[:2].copy() if known_place else None
        if self._waits:
            self._renew(pad, begun_anew(first, at), scan, known_place=known_place)
        elif not own.beginning:
            put = partial(self._renew_late, pad, known_place=known_place)
            own.begin(scan.t, put, begun_anew, first, at)

    def _renew(self, pad: int, new: Begun, last: Scan, *, known_place: bool) -> None:
        """Put a new pattern in the place of another. last: see `_start`."""
        m, middle = self.track(pad), self._middle(pad, last)[:2]
        m.theta_0 -= state_of(m.state).theta
        m.probation = m.poor = 0.0
        self.settle(pad, last.t)
        self._put(pad, new.learned)
        m.state[:] = new.state
        m.state[:2] += middle - new.middle
        keep_shift(m, middle)
        if not known_place:
            self.learners[pad].reported.clear()
            anchor(m, middle)

    def _renew_late(self, pad: int, new: Begun, *, known_place: bool) -> None:
        """The same when other scans have come meanwhile; its change is no motion."""
        self._renew(pad, new, self._last, known_place=known_place)
        self._register_again(pad)

    def _first(self, pad: int, scan: Scan) -> FirstScan:
        own = self._layout.of_pad(pad)
        gains, alive = self.gains.value[own].copy(), self.gains.alive[own].copy()
        part, as_read, middle = self.part(pad, scan), self._as_read(pad, scan), self._middle(pad, scan)[:2]
        return FirstScan(scan.t, part, as_read, gains, alive, self.hand.floor, self._late(pad), middle)

    def _middle(self, pad: int, scan: Scan) -> Floats:
        """(5,), see `middle_of`."""
        part, middle = self.part(pad, scan), np.empty(5)
        middle_of(part, self.hand.floor, middle)
        return middle

    def _put(self, pad: int, learned: LocalMap) -> None:
        """Make what was learned the pattern that scans are registered on."""
        pattern, m = learned.pattern, self.track(pad)
        (rows, cols), room = pattern.shape, self.stored.patterns.shape[1:]
        if rows > room[0] or cols > room[1]:
            more = ((0, 0), (0, max(rows - room[0], 0) + 8), (0, max(cols - room[1], 0) + 8))
            patterns, doubts = (np.pad(old, more, constant_values=np.nan) for old in self.stored[:2])
            self.stored = Patterns(patterns, doubts, self.stored.rests)
        self.stored.patterns[pad], self.stored.doubts[pad] = np.nan, np.nan
        self.stored.patterns[pad, :rows, :cols] = pattern.coefficients
        self.stored.doubts[pad, :rows, :cols] = DOUBT * pattern.doubt
        m.active, m.carries, m.turned = True, False, False
        m.lattice[:] = pattern.lattice
        m.origin[:] = learned.origin
        m.error, m.usual, m.radius = learned.error, learned.usual, learned.radius
        m.amplitude = learned.scanned.amplitude
        self.gains.put(pad, learned.gains)
        m.turns, m.gain_std = learned.turns, learned.loose_gain_std
        m.changing, m.seen, m.grows = learned.changing, learned.reports_turn, learned.grows or m.grows
        m.slack, m.slack_t = learned.slack + learned.rival
        m.tilt[:] = learned.tilt
        m.learned_s = learned.until_s
        self._open_across(pad, learned)
        m.reach, m.undecided = learned.scanned.reach, learned.undecided
        m.open[:] = m.reach * learned.hidden.direction
        states = learned.keyframes.states
        m.keyframes, m.keyframe[: len(states)] = len(states), states
        self.learners[pad].learned, self.learners[pad].beginning = learned, False

    def adopt(self, last: Scan, now_s: float) -> None:
        """Put in what is due; of a live loop a little at a time. last: the scan before."""
        self._last = last
        due = [own for own in self.learners if own.lane.jobs and own.lane.due_s <= now_s]
        if not due:
            return
        most = len(due) if self._waits else most_at_once(len(self.learners), now_s - last.t)
        for own in due[:most]:
            own.lane.adopt(now_s)

    def _improve(self, pad: int, new: LocalMap) -> None:
        """Put in what was learned, and register the last scan again, so that its change is no motion."""
        own, m, old = self.learners[pad], self.track(pad), self.learners[pad].learned
        if old is None:
            return
        place = reported_place(m, m.state)
        m.theta_0 += new.turned
        if new.turns and not old.turns:  # it has turned all the while
            m.state[:] = state_of(m.state)._replace(theta=state_of(new.keyframes.states[-1]).theta)
        if new.grows:
            own.take_over(new, m.state)
            if not old.grows:  # any size may be right
                m.load = 0.0
        elif old.grows:
            own.forget_waiting()  # they were registered in another frame
            own.take_over(new, m.state)
            m.grows, m.state[:] = False, state_of(m.state)._replace(size=0.0)
        else:
            m.shifted[:] = own.shifted(new, m.state)
        self._put(pad, new)
        if new.anchor is not None:
            put_on_average(m, new.anchor)
        hold(m, new, own.reported, float(self.hand.pitch_m[pad]))
        at = m.state.copy()
        self._register_again(pad)
        if not (new.grows or old.grows):
            own.shift_waiting(m.state - at)
        stepped = float(np.sum((reported_place(m, m.state) - place) ** 2))  # by so much one of the patterns is wrong
        new.slack[0] = max(new.slack[0], 0.5 * stepped)
        most = np.inf if new.anchor is None else new.anchor.variance
        if old.mature and has_own_frame(m):  # what is known well does not step
            m.broken = max(m.broken, min(m.broken + 0.5 * stepped, most))
        m.wander = min(m.wander, most)
        m.slack = new.slack[0] + new.rival[0]
        self.go_on(pad)

    def _register_again(self, pad: int) -> None:
        m, pitch_m = self.track(pad), self.hand.pitch_m[pad]
        before = m.sure.copy()
        self.follow_again(pad, self._last._replace(t=float(m.last_t)))
        cov = np.asarray(np.linalg.inv(m.doubted + NEGLIGIBLE * np.eye(STATE)), np.float64)
        add_errors(1.0, m, cov)
        find_sure_shift(1.0, m, cov)
        m.before_centre[:2] += pitch_m * (before - m.sure)
        turn = state_of(m.state).theta - m.theta_0 if m.seen else np.nan
        m.before[:] = *(pitch_m * reported_place(m, m.state)), turn

    def follow_again(self, pad: int, scan: Scan) -> None:
        """Register the last scan on the pattern as it is now; what the next one is predicted from stays."""
        alone = np.zeros(len(self.learners), np.bool_)
        alone[pad] = True
        m = self.track(pad)
        kept = m.speed.copy(), m.last_t
        m.speed[:] = 0.0
        self.run(FOLLOW, scan._replace(contact=alone), self._nothing)
        m.speed[:], m.last_t = kept
        m.shifted[:] = 0.0

    def go_on(self, pad: int) -> None:
        """Begin to learn from the scans that wait."""
        tracks, put = self.tracks, partial(self._improve, pad)
        self.learners[pad].go_on(float(tracks["last_t"][pad]), put, may_turn=bool(tracks["turned"][pad]))

    def settle(self, pad: int, now_s: float) -> None:
        """End what is still being learned when a contact, or its pattern, ends."""
        self.track(pad).theta_0 += self.learners[pad].settle(now_s)

    def keep(self, pad: int) -> None:
        """Remember the pattern of a contact that ends, as a map."""
        known = self.learners[pad].learned
        if known is not None:
            self.gains.ended(pad, known.keyframes.scanned)
            work = map_of(self._layout.pads[pad], known, self.track(pad), float(self.hand.pitch_m[pad]))
            self.ended.add(work, len(known.keyframes))
