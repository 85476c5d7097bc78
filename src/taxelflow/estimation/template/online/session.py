"""The template scan by scan: registered at once, learned from beside the stream.

What is learned from a scan is adopted a fixed time after it, by the scans' own clock, so that results do not depend on
how fast the machine is or how the stream is cut; a machine that is too slow makes the stream wait. A live loop adopts
it when it is ready instead, see `runtime.adoption`.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.online.explained import UNEXPLAINED, fits
from taxelflow.estimation.template.online.hand import POSE, Rows, Scan, room_for
from taxelflow.estimation.template.online.local_maps import LocalMaps
from taxelflow.estimation.template.online.mapping_thread import Workers
from taxelflow.estimation.template.online.prediction import change, expected
from taxelflow.estimation.template.online.relocalization import close, relocalise, surely_elsewhere
from taxelflow.estimation.template.online.spreading import Turns, most_at_once
from taxelflow.estimation.template.online.step import ASKS, BOTH, ELSEWHERE, REPORT
from taxelflow.estimation.template.online.track_state import FAINT, GONE, Track
from taxelflow.estimation.template.online.witness import arm_on_map, put_anew, reported_place
from taxelflow.estimation.template.warmup import compile_batch, compile_stream
from taxelflow.messages import Bools, Estimates, Scans, no_scans
from taxelflow.numerics.bspline import state_of
from taxelflow.numerics.rounding import BLURRED
from taxelflow.runtime.worker import worker

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Floats, LearnedPattern
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.sensors.layout import Layout


class StreamSession:
    """A causal estimator of pose on a pattern that it learns."""

    holds_unseen_error = True

    def __init__(self, layout: Layout, latency_s: float) -> None:
        self._layout, self._latency_s = layout, latency_s
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="taxelflow-learn")
        self._maps = LocalMaps(layout, Workers(self._thread, self._thread), latency_s)
        pads = len(layout.pads)
        self._touched = bytes(pads)
        self._noise = np.zeros(layout.entries)
        self._squared = np.zeros(layout.entries)
        none = self._noise
        self._last = Scan(0.0, none, self._squared, np.full(layout.entries, np.inf), none, np.zeros(pads, np.bool_))
        self._searches = Turns(pads)
        self._live = b""  # which taxels are not masked now
        self.notes: list[str] = []
        self._compile()

    def adopt_by(self, adopting: Adopting) -> None:
        """See `Background`."""
        mapper, starter = worker(), worker("starts")
        self._maps = LocalMaps(self._layout, Workers(mapper, starter), self._latency_s, adopting)
        compiled = [
            beside.submit(compile_) for beside in (mapper, starter) for compile_ in (compile_batch, compile_stream)
        ]
        for done in compiled:
            done.result()

    @property
    def patterns(self) -> Sequence[LearnedPattern]:
        """Maps of the contacts that have ended."""
        return self._maps.ended.kept

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        rows = room_for(scans)
        if scans.noise is not self._noise:
            self._noise, self._squared = scans.noise, scans.noise**2
            live = (scans.noise > 0).tobytes()
            if live != self._live:
                self._live = live
                self._maps.mask(self._noise)
        for k in range(len(scans)):
            variance = self._squared
            if 0 in scans.complete[k].tobytes():  # in a third of the time of NumPy's own
                variance = self._variance(scans.pressure[k], scans.complete[k])
            reading = scans.pressure[k]
            scan = Scan(float(scans.t_s[k]), reading, variance, scans.ceiling, reading, scans.contact[k])
            self._scan(k, scan, rows)
        return Estimates.of(scans.t_s, rows.vectors, rows.matrices, rows.scalars, rows.quality)

    def finish(self) -> Estimates:
        """Nothing is held back."""
        for pad in range(len(self._maps.learners)):
            self._maps.settle(pad, np.inf)
            self._maps.keep(pad)
        self._maps.ended.finish()
        self._thread.shutdown()
        return Estimates.unknown(no_scans(self._layout.entries, len(self._maps.learners)))

    @property
    def learning(self) -> bool:
        """Whether a pattern is being learned, or waits to be adopted."""
        return any(own.lane.busy for own in self._maps.learners)

    def expected(self, t_s: float | None = None) -> Floats:
        """(entries,), what the taxels should read, by all that is known; NaN on pads without a pattern.

        In the last scan, or at t_s: as in the last scan, changed as the pattern changes if the motion goes on.
        """
        known, gains = self._maps, np.where(np.isfinite(self._maps.gains.value), self._maps.gains.value, 0.0)
        if t_s is None:
            return gains * expected(known.stored, known.hand, known.tracks)
        return np.maximum(self._last.reading + gains * change(known.stored, known.hand, known.tracks, t_s), 0.0)

    def _scan(self, k: int, scan: Scan, rows: Rows) -> None:
        """Estimate one scan into row k."""
        touched = scan.contact.tobytes()
        if touched != self._touched:
            self._change(scan)
            self._touched = touched
        self._maps.adopt(self._last, scan.t)
        came = self._maps.run(BOTH, scan, rows, k)
        if came == ELSEWHERE:
            self._find_again(scan)
            came = self._maps.run(REPORT, scan, rows, k)
        self._last = scan
        if self._maps.ended.waiting:
            self._maps.ended.go_on(busy=self.learning)
        if came == ASKS:
            for pad in np.flatnonzero(self._maps.tracks["flag"]).tolist():
                self._answer(pad, scan, rows.vectors[POSE, k, pad, :2], rows.matrices[POSE, k, pad])

    def _find_again(self, scan: Scan) -> None:
        """Look for the object all over the pad where a scan does not fit where it was looked for."""
        asking, touched = [], np.flatnonzero(scan.contact).tolist()
        for pad in touched:
            m, known = self._maps.track(pad), self._maps.learners[pad].learned
            if known is None or (fits(m) and not (known.mature and m.probation > 0.0)):
                continue
            if known.mature:
                asking.append(pad)
                continue
            part = self._maps.part(pad, scan)
            if known.is_noise_beside(part.reading, part.variance):
                self._maps.learn_anew(pad, scan, known_place=False)
                self._maps.follow_again(pad, scan)
        most = most_at_once(len(touched), scan.t - self._last.t)
        for pad in self._searches.taken(asking, scan.t, most):
            self._search(pad, scan)

    def _search(self, pad: int, scan: Scan) -> None:
        """Look for a pad's object all over it."""
        m, known = self._maps.track(pad), self._maps.learners[pad].learned
        if known is None:
            return
        fit, near = fits(m), m.probation == 0.0
        if fit and np.diagonal(m.information)[:2].min() > BLURRED**-2:
            m.probation = max(m.probation - 1.0, 0.0)
        part = self._maps.part(pad, scan)
        found = relocalise(known, m.centroid, part, float(state_of(m.state).theta) if near else None)
        if found is None and not near and not fit and m.poor >= UNEXPLAINED.scans:
            m.broken += _doubt_of_place(m)
            self._maps.learn_anew(pad, scan)
        if found is None or (near and not close(found.state, m.state)):
            return
        if not fit or surely_elsewhere(found, m):
            m.state[:], m.information[:], m.chi, m.count = found
            m.doubted[:], m.step[:] = found.information, found.information
            m.unexplained = min(m.unexplained, UNEXPLAINED.most)  # or it had not been found
            m.carries = False
            put_anew(m)

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
                self._maps.begin(pad, scan)
            else:
                self._maps.settle(pad, scan.t)
                self._maps.keep(pad)
                m = self._maps.track(pad)
                self._maps.learners[pad].end(arm_on_map(m))
                m.active = False

    def _answer(self, pad: int, scan: Scan, place_m: Floats, covariance: Floats) -> None:
        """Do what a scan calls for. place_m: (2,), where it was reported; covariance: (3, 3), of that."""
        own, tracks = self._maps.learners[pad], self._maps.tracks
        known = own.learned
        if known is None or own.beginning:
            return
        if tracks["flag"][pad] == GONE:
            m = self._maps.track(pad)
            grows, broken = m.grows, m.broken + _doubt_of_place(m)
            self._maps.settle(pad, scan.t)
            self._maps.begin(pad, scan)
            m = self._maps.track(pad)
            m.grows, m.broken = grows, broken  # it is the same contact
            return
        if state_of(tracks["state"][pad]).gain > FAINT and not known.mature:
            faintest = known.keyframes.scanned.readings.max(axis=1).min()
            if self._maps.part(pad, scan).reading.max() > FAINT * faintest:  # what was learned from is too faint
                self._maps.learn_anew(pad, scan)
                return
        pitch_m = float(self._maps.hand.pitch_m[pad])
        own.reported.add(scan.t, place_m / pitch_m, float(covariance[0, 0] + covariance[1, 1]) / pitch_m**2)
        self._maps.learn_from(pad, scan)

    def _compile(self) -> None:
        """Run the kernels on nothing, so that none is compiled within the stream."""
        compile_batch()
        compile_stream()
        none = room_for(no_scans(self._layout.entries, len(self._layout.pads), 1))
        self._maps.run(BOTH, self._last, none)


def _doubt_of_place(m: Track) -> float:
    """Variance of x and y, in pitches^2, between where the object was followed to and its contact's centroid."""
    return 0.5 * float(np.sum((reported_place(m, m.state) - m.centroid) ** 2))
