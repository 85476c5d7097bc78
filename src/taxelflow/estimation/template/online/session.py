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
from taxelflow.estimation.template.online import track_state as online
from taxelflow.estimation.template.online.keyframes import MOST_KEYFRAMES
from taxelflow.estimation.template.online.local_map import Learned
from taxelflow.estimation.template.online.map_update import first_pattern
from taxelflow.estimation.template.online.mapping_thread import Learner, Novel
from taxelflow.estimation.template.online.prediction import expected
from taxelflow.estimation.template.online.relocalization import DOUBT, close, recognised, surely_elsewhere
from taxelflow.estimation.template.online.step import ASKS, BOTH, ELSEWHERE, FOLLOW, REPORT, follow_hand
from taxelflow.estimation.template.warmup import compile_kernels
from taxelflow.messages import Bools, Estimates, Scans, no_scans
from taxelflow.numerics.bspline import GAIN, STATE, THETA
from taxelflow.numerics.centroid import loaded_centroid
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
        late, self._lead = delays_of(layout)
        self._delay = late if late.any() else np.zeros(0)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="taxelflow-learn")
        self._pads = [Learner(self._worker, latency_s) for _ in range(pads)]
        self._memory = np.zeros((pads, online.SLOTS))
        self._states = np.zeros((pads, STATE))
        self._information, self._steps = np.zeros((pads, STATE, STATE)), np.zeros((pads, STATE, STATE))
        self._rests = np.zeros((4, layout.entries))
        self._patterns, self._doubts = np.zeros((pads, 8, 8)), np.zeros((pads, 8, 8))
        self._keyframes = np.zeros((pads, MOST_KEYFRAMES, 4))
        self._before, self._before_cov = np.zeros((pads, 3)), np.zeros((pads, 3, 3))
        self._before_t = np.zeros(pads)
        self._touched = bytes(pads)
        self._last_reading, self._last_variance = np.zeros(layout.entries), np.zeros(layout.entries)
        self._noise = np.zeros(layout.entries)
        self._squared = np.zeros(layout.entries)
        self._live = b""  # which taxels are not masked now
        self._across = np.zeros((pads, 2), dtype=np.bool_)  # of them
        self._ceiling = np.full(layout.entries, np.inf)
        self._border: Bools = np.asarray(layout.border.any(axis=1), dtype=np.bool_)
        self._no_estimates = _room(no_scans(layout.entries, pads, 1))
        self._arrays = (
            self._places,
            self._delay,
            self._border,
            layout.starts,
            self._pitch_m,
            self._lead,
            self._memory,
            self._states,
            self._information,
            self._steps,
            self._rests,
            self._before,
            self._before_cov,
            self._before_t,
            self._keyframes,
            self._last_reading,
            self._last_variance,
        )
        self.notes: list[str] = []
        self.patterns = Maps()
        self._compile()

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads; see `EstimatorSession.step`."""
        estimates = _room(scans)
        if scans.noise is not self._noise:
            self._noise, self._squared = scans.noise, scans.noise**2
            live = (scans.noise > 0).tobytes()
            if live != self._live:
                self._live = live
                self._mask()
        self._ceiling = scans.ceiling
        for k in range(len(scans)):
            self._scan(k, scans, estimates)
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
        across_now = scanned.reach * (scanned.across | self._across[pad])
        self._memory[pad, online.ACROSS_X : online.ACROSS_Y + 1] = across_now

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
        known = (self._patterns, self._memory, self._states, self._steps, self._rests)
        return expected(*known, self._places, self._layout.starts, t_s)

    def _keep(self, pad: int) -> None:
        """Remember the pattern of a contact that ends, as a map."""
        known = self._pads[pad].learned
        if known is None:
            return
        own, m = self._layout.of_pad(pad), self._memory[pad]
        states, pitch_m = known.keyframes.states, self._pitch_m[pad]
        self.patterns.add(
            self._layout.pads[pad],
            known.pattern,
            known.keyframes.scanned,
            states,
            states[-1, : THETA + 1] * [pitch_m, pitch_m, 1.0] - [0.0, 0.0, m[online.THETA_0] if known.turns else 0.0],
            rough=known.rough,
            pitch_m=float(pitch_m),
            size=self._layout.pitch_m[pad] / pitch_m,
            turns=known.turns,
            dead=self._layout.source[own][:0],
        )

    def _scan(self, k: int, scans: Scans, estimates: Estimates) -> None:
        t, reading, contact = float(scans.t_s[k]), scans.pressure[k], scans.contact[k]
        variance = self._squared
        if np.count_nonzero(scans.complete[k]) < len(contact):
            variance = self._variance(reading, scans.complete[k])
        touched = contact.tobytes()
        if touched != self._touched:
            self._change(t, contact, reading, variance)
            self._touched = touched
        for pad, own in enumerate(self._pads):
            if own.due_s <= t:
                self._adopt(pad)
        came = self._run(BOTH, t, reading, variance, contact, estimates, k)
        if came == ELSEWHERE:
            self._find_again(t, contact, reading, variance)
            came = self._run(REPORT, t, reading, variance, contact, estimates, k)
        if came == ASKS:
            for pad in np.flatnonzero(self._memory[:, online.FLAG]).tolist():
                self._answer(pad, t, reading, variance)

    def _run(
        self, job: int, t: float, reading: Floats, variance: Floats, contact: Bools, estimates: Estimates, k: int = 0
    ) -> int:
        """Follow a scan on the patterns of the pads in contact, fill row k of estimates, or both."""
        return follow_hand(
            job,
            k,
            t,
            reading,
            variance,
            self._ceiling,
            contact,
            *self._arrays,
            self._patterns,
            self._doubts,
            estimates.pose,
            estimates.covariance,
            estimates.displacement,
            estimates.displacement_covariance,
            estimates.span_s,
            estimates.lag_s,
            estimates.disturbance,
            estimates.quality,
        )

    def _find_again(self, t: float, contact: Bools, reading: Floats, variance: Floats) -> None:
        """Look for the object all over the pad where a scan does not fit where it was looked for."""
        for pad in np.flatnonzero(contact):
            m, known = self._memory[pad], self._pads[pad].learned
            if known is None:
                continue
            own = self._layout.of_pad(int(pad))
            fits = m[online.CHI] <= gate(m[online.USUAL], m[online.COUNT])
            if not known.mature:
                if not fits and known.is_noise_beside(reading[own], variance[own]):
                    self._learn_anew(int(pad), t, reading, variance, known_place=False)
                    self._follow_again(int(pad), t, reading, variance)
                continue
            if fits and m[online.PROBATION] == 0.0:
                continue
            near = m[online.PROBATION] == 0.0
            if fits and np.diagonal(self._information[pad])[:THETA].min() > online.BLURRED**-2:
                m[online.PROBATION] = max(m[online.PROBATION] - 1.0, 0.0)
            middle = m[online.CENTROID_X : online.CENTROID_Y + 1]
            scan = (np.ascontiguousarray(self._places[:, own]), reading[own], variance[own], self._ceiling[own])
            found = recognised(known, middle, *scan, self._states[pad, THETA] if near else None)
            if found is None and not near and not fits and m[online.POOR] >= _MISTAKEN:
                self._learn_anew(int(pad), t, reading, variance)
            if found is None or (near and not close(found[0], self._states[pad])):
                continue
            if not fits or surely_elsewhere(found, self._states[pad], m):
                self._states[pad], self._information[pad], m[online.CHI], m[online.COUNT] = found
                self._steps[pad], m[online.CARRIES] = found[1], 0.0
                m[online.CONTINUES] = m[online.SPEED_X] = m[online.SPEED_Y] = m[online.SPEED_T] = 0.0

    def _variance(self, reading: Floats, complete: Bools) -> Floats:
        """Noise squared, 0 where a reading is missing."""
        variance = self._squared.copy()
        for pad in np.flatnonzero(~complete):
            own = self._layout.of_pad(int(pad))
            variance[own][reading[own] == 0] = 0.0
        return variance

    def _change(self, t: float, contact: Bools, reading: Floats, variance: Floats) -> None:
        """Contacts that begin or end."""
        for pad in np.flatnonzero(contact != np.frombuffer(self._touched, np.bool_)):
            own = self._pads[pad]
            if contact[pad]:
                self._begin(int(pad), t, reading, variance)
            else:
                self._settle(int(pad))
                self._keep(int(pad))
                own.end()
                self._memory[pad, online.ACTIVE] = 0.0

    def _settle(self, pad: int) -> None:
        """Take what is still being learned when a contact, or its pattern, ends."""
        self._memory[pad, online.THETA_0] += self._pads[pad].settle()

    def _begin(self, pad: int, t: float, reading: Floats, variance: Floats) -> None:
        """A new contact: a pattern known from before, or else a new one from its first scan."""
        own = self._layout.of_pad(pad)
        places, middle = np.ascontiguousarray(self._places[:, own]), np.empty(4)
        loaded_centroid(reading[own], variance[own], places, self._border[own], middle)
        m = self._memory[pad]
        m[:] = 0.0
        scan = (places, reading[own], variance[own], self._ceiling[own])
        for known in reversed(self._pads[pad].library):
            found = recognised(known, middle[:2], *scan)
            if found is not None:
                self._put(pad, known)
                self._states[pad] = found[0]
                m[online.PROBATION], m[online.THETA_0] = _PROBATION, found[0][THETA]
                break
        else:
            delay = self._delay[own] if len(self._delay) else np.zeros(own.stop - own.start)
            learned = first_pattern(t, *scan, delay)
            self._put(pad, learned)
            self._states[pad] = learned.keyframes.states[0]
        m[online.LAST_T] = t
        m[online.CENTROID_X], m[online.CENTROID_Y], m[online.LOAD] = middle[0], middle[1], middle[3]

    def _learn_anew(self, pad: int, t: float, reading: Floats, variance: Floats, *, known_place: bool = True) -> None:
        """A new pattern from this scan, which stays where it is, if that is known."""
        state, taxels, m = self._states[pad], self._layout.of_pad(pad), self._memory[pad]
        if not known_place:
            m[online.CONTINUES] = m[online.SPEED_X] = m[online.SPEED_Y] = m[online.SPEED_T] = 0.0
        m[online.THETA_0] -= state[THETA]
        m[online.PROBATION] = m[online.POOR] = 0.0
        self._settle(pad)
        delay = self._delay[taxels] if len(self._delay) else np.zeros(taxels.stop - taxels.start)
        scan = (np.ascontiguousarray(self._places[:, taxels]), reading[taxels], variance[taxels], self._ceiling[taxels])
        learned = first_pattern(t, *scan, delay, state[:2] if known_place else None)
        self._put(pad, learned)
        self._states[pad] = learned.keyframes.states[0]

    def _put(self, pad: int, learned: Learned) -> None:
        """Make what was learned the pattern that scans are registered on."""
        pattern, m = learned.pattern, self._memory[pad]
        rows, cols = pattern.shape
        room = self._patterns.shape[1:]
        if rows > room[0] or cols > room[1]:
            more = ((0, 0), (0, max(rows - room[0], 0) + 8), (0, max(cols - room[1], 0) + 8))
            self._patterns, self._doubts = (
                np.pad(old, more, constant_values=np.nan) for old in (self._patterns, self._doubts)
            )
        self._patterns[pad], self._doubts[pad] = np.nan, np.nan
        self._patterns[pad, :rows, :cols] = pattern.coefficients
        self._doubts[pad, :rows, :cols] = DOUBT * pattern.doubt
        m[online.ACTIVE], m[online.CARRIES], m[online.TURNED] = 1.0, 0.0, 0.0
        m[online.SPACING : online.LOW + 1] = pattern.lattice
        m[online.ROUGH], m[online.USUAL], m[online.RADIUS] = learned.rough, learned.usual, learned.radius
        m[online.TURN_STD] = _TURN_STD if learned.turns else 0.0
        m[online.GAIN_STD] = max(3.0 * learned.gain_std, _LEAST_GAIN_STD)
        m[online.SHARE] = 1.0 - 1.0 / max(learned.sight, 2.0)
        m[online.SHARE_OF_PLACE] = 1.0 - 1.0 / max(learned.sight_of_place, 2.0)
        m[online.CHANGING] = 1.0 if learned.changing else 0.0
        m[online.SLACK], m[online.SLACK_T] = learned.slack
        m[online.SEEN] = 1.0 if learned.told else 0.0
        self._open_across(pad, learned)
        states = learned.keyframes.states
        m[online.KEYFRAMES] = len(states)
        self._keyframes[pad, : len(states)] = states[:, : GAIN + 1]
        self._pads[pad].learned = learned

    def _adopt(self, pad: int) -> None:
        """Put in what was learned, and register the last scan anew, so that its change is no motion."""
        own, m = self._pads[pad], self._memory[pad]
        old, new = own.learned, own.taken()
        if old is None or new is None:
            return
        m[online.THETA_0] += new.turned
        if new.turns and not old.turns:  # it has turned all the while
            self._states[pad, THETA] = new.keyframes.states[-1, THETA]
        if new.placed:
            own.take_over(new, [self._states[pad]])
            if not old.placed:  # any size may be right
                m[online.LOAD] = 0.0
        self._put(pad, new)
        self._follow_again(pad, float(m[online.LAST_T]), self._last_reading, self._last_variance)
        state, scale = self._states[pad], self._pitch_m[pad]
        turn = state[THETA] - m[online.THETA_0] if m[online.SEEN] else np.nan
        self._before[pad] = scale * state[0], scale * state[1], turn
        self._go_on(pad)

    def _follow_again(self, pad: int, t: float, reading: Floats, variance: Floats) -> None:
        """Register a scan that was registered before on a pattern that is new."""
        m, alone = self._memory[pad], np.zeros(len(self._pads), dtype=np.bool_)
        alone[pad] = True
        kept = m[online.SPEED_X : online.LAST_T + 1].copy()
        m[online.SPEED_X : online.SPEED_T + 1] = 0.0
        self._run(FOLLOW, t, reading, variance, alone, self._no_estimates)
        m[online.SPEED_X : online.LAST_T + 1] = kept

    def _answer(self, pad: int, t: float, reading: Floats, variance: Floats) -> None:
        """Do what a scan calls for."""
        own, flag = self._pads[pad], self._memory[pad, online.FLAG]
        if own.learned is None:
            return
        if flag == online.GONE:
            grows = self._memory[pad, online.GROWS]
            self._settle(pad)
            self._begin(pad, t, reading, variance)
            self._memory[pad, online.GROWS] = grows  # it is the same contact
            return
        taxels = self._layout.of_pad(pad)
        m = self._memory[pad]
        if self._states[pad, GAIN] > online.FAINT and not own.learned.mature:  # what was learned from is too faint
            self._learn_anew(pad, t, reading, variance)
            return
        late = self._delay[taxels] if len(self._delay) else np.zeros(0)
        bend = m[online.SPEED_X : online.SPEED_T + 1, np.newaxis] * late
        own.learn_from(Novel(t, reading[taxels].copy(), variance[taxels].copy(), bend, self._states[pad].copy()))
        count = int(m[online.KEYFRAMES])
        if count < MOST_KEYFRAMES:
            self._keyframes[pad, count] = self._states[pad, : GAIN + 1]
            m[online.KEYFRAMES] += 1
        self._go_on(pad)

    def _go_on(self, pad: int) -> None:
        """Begin to learn from the scans that wait."""
        m = self._memory[pad]
        self._pads[pad].go_on(float(m[online.LAST_T]), may_turn=bool(m[online.TURNED]))

    def _compile(self) -> None:
        """Run the kernels on nothing, so that none is compiled within the stream."""
        compile_kernels()
        none = np.zeros(len(self._pads), dtype=np.bool_)
        self._run(BOTH, 0.0, self._last_reading, self._last_variance, none, self._no_estimates)


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
