"""The template scan by scan: registered at once, learned from beside the stream.

What is learned from a scan is adopted a fixed time after it, by the scans' own clock, so that results do not depend on
how fast the machine is or how the stream is cut; a machine that is too slow makes the stream wait.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.map_export import Maps
from taxelflow.estimation.template.observations import across, delays_of
from taxelflow.estimation.template.online.local_map import Learned
from taxelflow.estimation.template.online.map_update import first_pattern
from taxelflow.estimation.template.online.mapping_thread import Learner, Novel
from taxelflow.estimation.template.online.prediction import expected
from taxelflow.estimation.template.online.relocalization import DOUBT, close, recognised, surely_elsewhere
from taxelflow.estimation.template.online.step import ASKS, BOTH, ELSEWHERE, FOLLOW, REPORT, follow_hand
from taxelflow.estimation.template.online.track_state import (
    BLURRED,
    FAINT,
    GONE,
    MOST_KEYFRAMES,
    Hand,
    PadScan,
    Patterns,
    Rows,
    Scan,
    Track,
)
from taxelflow.estimation.template.warmup import compile_batch, compile_stream
from taxelflow.messages import Bools, Estimates, Scans, no_scans
from taxelflow.numerics.bspline import GAIN, THETA
from taxelflow.numerics.centroid import loaded_centroid
from taxelflow.numerics.records import record, records
from taxelflow.numerics.robust import gate

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout

_TURN_STD = 0.1
_LEAST_GAIN_STD = 0.05
_PROBATION = 3
"""A pattern that was recognised is looked for all over the pad until so many scans have told where it is."""
_MISTAKEN = 2
"""After so many scans that do not fit, it was another object."""


class StreamSession:
    """A causal estimator of pose on a pattern that it learns."""

    def __init__(self, layout: Layout, latency_s: float) -> None:
        self._layout = layout
        pads = len(layout.pads)
        self._pitch_m = np.sqrt(layout.pitch_m.prod(axis=1))
        scale = np.repeat(self._pitch_m, np.diff(layout.starts))
        self._places = np.stack([layout.x_m, layout.y_m]) / scale
        late, lead_s = delays_of(layout)
        self._delay = late if late.any() else np.zeros(0)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="taxelflow-learn")
        self._pads = [Learner(self._worker, latency_s) for _ in range(pads)]
        self._tracks = records(Track, pads)
        edge: Bools = np.asarray(layout.border.any(axis=1), dtype=np.bool_)
        self._hand = Hand(self._places, self._delay, edge, layout.starts, self._pitch_m, lead_s, layout.unseen_error)
        self._maps = Patterns(np.zeros((pads, 8, 8)), np.zeros((pads, 8, 8)), np.zeros((4, layout.entries)))
        self._touched = bytes(pads)
        self._noise = np.zeros(layout.entries)
        self._squared = np.zeros(layout.entries)
        self._last = Scan(0.0, self._noise, self._squared, np.full(layout.entries, np.inf), np.zeros(pads, np.bool_))
        self._live = b""  # which taxels are not masked now
        self._across = np.zeros((pads, 2), dtype=np.bool_)  # of them
        self._nothing = _rows(_room(no_scans(layout.entries, pads, 1)))
        self.notes: list[str] = []
        self.patterns = Maps()
        self._compile()

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        estimates = _room(scans)
        rows = _rows(estimates)
        if scans.noise is not self._noise:
            self._noise, self._squared = scans.noise, scans.noise**2
            live = (scans.noise > 0).tobytes()
            if live != self._live:
                self._live = live
                self._mask()
        for k in range(len(scans)):
            variance = self._squared
            if np.count_nonzero(scans.complete[k]) < scans.contact.shape[1]:
                variance = self._variance(scans.pressure[k], scans.complete[k])
            self._scan(k, Scan(float(scans.t_s[k]), scans.pressure[k], variance, scans.ceiling, scans.contact[k]), rows)
        return estimates

    def _mask(self) -> None:
        """See which pads have but a line of taxels left."""
        for pad, own in enumerate(self._pads):
            taxels = self._layout.of_pad(pad)
            self._across[pad] = across(self._places[:, taxels], self._noise[taxels] > 0)
            if own.learned is not None:
                self._open_across(pad, own.learned)

    def _open_across(self, pad: int, learned: Learned) -> None:
        """Leave open where the object is across a line of taxels, the pattern's or those that are left."""
        scanned = learned.keyframes.scanned
        self._track(pad).across[:] = scanned.reach * (scanned.across | self._across[pad])

    def finish(self) -> Estimates:
        """Nothing is held back."""
        for pad in range(len(self._pads)):
            self._settle(pad)
            self._keep(pad)
        self._worker.shutdown()
        return Estimates.unknown(no_scans(self._layout.entries, len(self._pads)))

    @property
    def learning(self) -> bool:
        """Whether a pattern is being learned, or waits to be adopted."""
        return any(own.learning for own in self._pads)

    def expected(self, t_s: float | None = None) -> Floats:
        """(entries,), what the taxels should read, by all that is known: in the last scan, or at t_s if the motion goes
        on as it was; NaN on pads without a pattern.
        """
        return expected(self._maps, self._hand, self._tracks, t_s)

    def _track(self, pad: int) -> Track:
        return record(Track, self._tracks, pad)

    def _keep(self, pad: int) -> None:
        """Remember the pattern of a contact that ends, as a map."""
        known = self._pads[pad].learned
        if known is None:
            return
        own, pitch_m = self._layout.of_pad(pad), self._pitch_m[pad]
        states = known.keyframes.states
        theta_0 = self._track(pad).theta_0 if known.turns else 0.0
        self.patterns.add(
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

    def _scan(self, k: int, scan: Scan, rows: Rows) -> None:
        """Estimate one scan into row k."""
        touched = scan.contact.tobytes()
        if touched != self._touched:
            self._change(scan)
            self._touched = touched
        for pad, own in enumerate(self._pads):
            if own.due_s <= scan.t:
                self._adopt(pad)
        came = self._run(BOTH, scan, rows, k)
        if came == ELSEWHERE:
            self._find_again(scan)
            came = self._run(REPORT, scan, rows, k)
        self._last = scan
        if came == ASKS:
            for pad in np.flatnonzero(self._tracks["flag"]).tolist():
                self._answer(pad, scan)

    def _run(self, job: int, scan: Scan, rows: Rows, k: int = 0) -> int:
        """Follow a scan on the patterns of the pads in contact, fill row k, or both."""
        return follow_hand(job, k, scan, self._hand, self._maps, self._tracks, rows)

    def _part(self, pad: int, scan: Scan) -> PadScan:
        """A pad's part of a scan."""
        own = self._layout.of_pad(pad)
        places = np.ascontiguousarray(self._places[:, own])
        return PadScan(scan.reading[own], scan.variance[own], scan.ceiling[own], places, self._hand.edge[own])

    def _find_again(self, scan: Scan) -> None:
        """Look for the object all over the pad where a scan does not fit where it was looked for."""
        for pad in np.flatnonzero(scan.contact).tolist():
            m, known = self._track(pad), self._pads[pad].learned
            if known is None:
                continue
            part = self._part(pad, scan)
            fits = m.chi <= gate(m.usual, m.count)
            if not known.mature:
                if not fits and known.is_noise_beside(part.reading, part.variance):
                    self._learn_anew(pad, scan, known_place=False)
                    self._follow_again(pad, scan)
                continue
            if fits and m.probation == 0.0:
                continue
            near = m.probation == 0.0
            if fits and np.diagonal(m.information)[:THETA].min() > BLURRED**-2:
                m.probation = max(m.probation - 1.0, 0.0)
            found = recognised(known, m.centroid, part, float(m.state[THETA]) if near else None)
            if found is None and not near and not fits and m.poor >= _MISTAKEN:
                self._learn_anew(pad, scan)
            if found is None or (near and not close(found[0], m.state)):
                continue
            if not fits or surely_elsewhere(found, m):
                m.state[:], m.information[:], m.chi, m.count = found
                m.doubted[:], m.step[:] = found[1], found[1]
                m.carries = m.continues = False
                m.speed[:] = 0.0

    def _variance(self, reading: Floats, complete: Bools) -> Floats:
        """Noise squared, 0 where a reading is missing."""
        variance = self._squared.copy()
        for pad in np.flatnonzero(~complete):
            own = self._layout.of_pad(int(pad))
            variance[own][reading[own] == 0] = 0.0
        return variance

    def _change(self, scan: Scan) -> None:
        """Contacts that begin or end."""
        for pad in np.flatnonzero(scan.contact != np.frombuffer(self._touched, np.bool_)).tolist():
            if scan.contact[pad]:
                self._begin(pad, scan)
            else:
                self._settle(pad)
                self._keep(pad)
                self._pads[pad].end()
                self._track(pad).active = False

    def _settle(self, pad: int) -> None:
        """Take what is still being learned when a contact, or its pattern, ends."""
        self._track(pad).theta_0 += self._pads[pad].settle()

    def _begin(self, pad: int, scan: Scan) -> None:
        """A new contact: a pattern known from before, or else a new one from its first scan."""
        part, middle = self._part(pad, scan), np.empty(4)
        loaded_centroid(part.reading, part.variance, part.places, part.edge, middle)
        self._tracks[pad] = np.zeros((), self._tracks.dtype)
        m = self._track(pad)
        for known in reversed(self._pads[pad].library):
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

    def _late(self, pad: int) -> Floats:
        """(taxels,), delays of a pad's taxels."""
        own = self._layout.of_pad(pad)
        return self._delay[own] if len(self._delay) else np.zeros(own.stop - own.start)

    def _learn_anew(self, pad: int, scan: Scan, *, known_place: bool = True) -> None:
        """A new pattern from this scan, which stays where it is, if that is known."""
        m = self._track(pad)
        if not known_place:
            m.continues = False
            m.speed[:] = 0.0
        m.theta_0 -= m.state[THETA]
        m.probation = m.poor = 0.0
        self._settle(pad)
        learned = first_pattern(scan.t, self._part(pad, scan), self._late(pad), m.state[:2] if known_place else None)
        self._put(pad, learned)
        m.state[:] = learned.keyframes.states[0]

    def _put(self, pad: int, learned: Learned) -> None:
        """Make what was learned the pattern that scans are registered on."""
        pattern, m = learned.pattern, self._track(pad)
        rows, cols = pattern.shape
        room = self._maps.patterns.shape[1:]
        if rows > room[0] or cols > room[1]:
            more = ((0, 0), (0, max(rows - room[0], 0) + 8), (0, max(cols - room[1], 0) + 8))
            patterns, doubts = (np.pad(old, more, constant_values=np.nan) for old in self._maps[:2])
            self._maps = Patterns(patterns, doubts, self._maps.rests)
        self._maps.patterns[pad], self._maps.doubts[pad] = np.nan, np.nan
        self._maps.patterns[pad, :rows, :cols] = pattern.coefficients
        self._maps.doubts[pad, :rows, :cols] = DOUBT * pattern.doubt
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
        self._pads[pad].learned = learned

    def _adopt(self, pad: int) -> None:
        """Put in what was learned, and register the last scan anew, so that its change is no motion."""
        own, m = self._pads[pad], self._track(pad)
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
        self._follow_again(pad, self._last._replace(t=float(m.last_t)))
        turn = m.state[THETA] - m.theta_0 if m.seen else np.nan
        m.before[:] = *(self._pitch_m[pad] * m.state[:2]), turn
        self._go_on(pad)

    def _follow_again(self, pad: int, scan: Scan) -> None:
        """Register the last scan on the pattern as it is now; what the next one is predicted from stays."""
        alone = np.zeros(len(self._pads), np.bool_)
        alone[pad] = True
        m = self._track(pad)
        kept = m.speed.copy(), m.span, m.last_t
        m.speed[:] = 0.0
        self._run(FOLLOW, scan._replace(contact=alone), self._nothing)
        m.speed[:], m.span, m.last_t = kept

    def _answer(self, pad: int, scan: Scan) -> None:
        """Do what a scan calls for."""
        own, m = self._pads[pad], self._track(pad)
        if own.learned is None:
            return
        if m.flag == GONE:
            grows = m.grows
            self._settle(pad)
            self._begin(pad, scan)
            self._track(pad).grows = grows  # it is the same contact
            return
        if m.state[GAIN] > FAINT and not own.learned.mature:  # what was learned from is too faint
            self._learn_anew(pad, scan)
            return
        part = self._part(pad, scan)
        late = self._late(pad) if len(self._delay) else np.zeros(0)
        bend = m.speed[:, np.newaxis] * late
        own.learn_from(Novel(scan.t, part.reading.copy(), part.variance.copy(), bend, m.state.copy()))
        if m.keyframes < MOST_KEYFRAMES:
            m.keyframe[m.keyframes] = m.state[: GAIN + 1]
            m.keyframes += 1
        self._go_on(pad)

    def _go_on(self, pad: int) -> None:
        """Begin to learn from the scans that wait."""
        m = self._track(pad)
        self._pads[pad].go_on(float(m.last_t), may_turn=bool(m.turned))

    def _compile(self) -> None:
        """Run the kernels on nothing, so that none is compiled within the stream."""
        compile_batch()
        compile_stream()
        self._run(BOTH, self._last, self._nothing)


def _rows(estimates: Estimates) -> Rows:
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


def _room(scans: Scans) -> Estimates:
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
