"""The slip stage: the pose's detector, the patterns' evidence and pads that agree side by side, and one verdict."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from taxelflow.messages import OK, Bools, Event, Floats, cut, joined
from taxelflow.numerics.bins import AHEAD_S
from taxelflow.slip.begun import Begun
from taxelflow.slip.cut_contact import BorderLoss
from taxelflow.slip.measurement import parameter_records
from taxelflow.slip.odds import AFTER, AGAINST, LiveOdds, Odds, OfflineOdds
from taxelflow.slip.offline import OfflineSlipSession
from taxelflow.slip.onset import MAX_EXPONENT
from taxelflow.slip.pad_agreement import PadAgreement
from taxelflow.slip.pattern_change import BINS, PatternChanges, PatternWatch
from taxelflow.slip.session import SlipSession
from taxelflow.slip.shifting_load import ShiftingLoad, ahead
from taxelflow.slip.slip_events import SlipEvents
from taxelflow.slip.sticking import Sticking
from taxelflow.slip.verdict import Posed, Verdict

if TYPE_CHECKING:
    from taxelflow.messages import Scans, Slips
    from taxelflow.numerics.bins import Bin
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.session import Detected

Block = TypeVar("Block", Odds, PatternChanges)


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """The oldest scans that are judged. slipping: (scans, pads). evidence: (scans, pads), log odds of a slip by the
    change of the pattern; NaN where unknown. rests: (scans, pads), by how much these are below those of an object of
    which nothing is known; 0 in streams, whose odds come later than their poses. statistic: (scans, pads), that which
    decides, over its threshold: above 1 it slips. It is that of the pose, on restless pads the odds; NaN where a scan
    was not tested. events: those that are complete, in time order; of a recording later than their scans, as slips wait
    for their end. sticks: (scans, pads), see `Sticking`; None where no shear is measured. begun_s: (scans, pads), since
    when the pattern consents to the slip by the pose that goes on, or when the next one begins, see `ahead`; None in
    streams.
    """

    slipping: Bools
    evidence: Floats
    rests: Floats
    statistic: Floats
    events: list[Event]
    sticks: Bools | None = None
    begun_s: Floats | None = None

    def __len__(self) -> int:
        return len(self.slipping)


class SlipStage:
    """Slips of all pads. `see` gets the scans, `step` their slips, which may come later."""

    def __init__(
        self,
        layout: Layout,
        *,
        alarms_per_hour: float,
        creep_m_s: float,
        load_m: float,
        settle_s: float,
        stream: bool,
        judged: bool,
    ) -> None:
        """The options are those of `SlipMonitor`. judged: see `SlipMonitor.watch`."""
        pads, parameters = layout.pads, parameter_records(alarms_per_hour, load_m, creep_m_s, settle_s)
        bins = (AFTER.live, ()) if stream else (AFTER.recorded, BINS.longer)
        self._sheared = False  # a second witness, with which longer baselines consent to a slip, too
        self._watch = PatternWatch(layout, creep_m_s, *bins)
        self._detector = (SlipSession if stream else OfflineSlipSession)(pads, parameters)
        self._odds = (LiveOdds if stream else OfflineOdds)(layout.pitch_m)
        self._agreement = PadAgreement(layout, alarms_per_hour, creep_m_s, load_m)
        self._verdict = Verdict(layout, stream=stream, judged=judged)
        self._shifts, self._ahead_s = ShiftingLoad(layout), 0.0 if stream else AHEAD_S
        self._sticking, self._begun = Sticking(len(pads), self._ahead_s), Begun(len(pads))
        if stream:
            self._shifts.prepare()
        self._since_s: list[Floats] = []  # when patterns consent, of scans that are not judged yet
        self._completed = SlipEvents(pads, stream=stream)
        self._loss = None if stream else BorderLoss(layout)
        self._losses: list[Floats] = []  # of scans that are not judged yet
        self._changes: list[PatternChanges] = []
        self._slips: list[Slips] = []  # not judged yet
        self._posed: list[Bools] = []  # slipping by the pose, of scans that are not judged yet
        self._statistics: list[Floats] = []  # by the pose, likewise
        self._events: list[Event] = []

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._detector.scatter

    def see(self, scans: Scans) -> list[Bin]:
        """Compare the patterns of scans, whose slips follow; the bins that they complete, where those are compared."""
        self._sheared, before = scans.shear is not None, len(self._watch.completed or ())
        self._changes.append(self._watch.step(scans))
        self._shifts.see(scans)
        if self._loss is not None:
            self._losses.append(self._loss.of(scans))
        return self._watch.completed[before:] if self._watch.completed else []

    def step(self, slips: Slips) -> Judged:
        """Judge scans that were seen, which follow those of the last call."""
        self._slips.append(slips)
        return self._judge(self._detector.step(slips), last=False)

    def finish(self) -> Judged:
        """The scans that `step` has held back."""
        return self._judge(self._detector.finish(), last=True)

    def _judge(self, detected: Detected, *, last: bool) -> Judged:
        posed, first = detected.slipping, sum(map(len, self._posed))
        self._posed.append(posed)
        self._statistics.append(detected.statistic)
        self._events += detected.events
        parts = []
        if len(posed):
            self._slips = [joined(self._slips)]
            of_posed = self._slips[0]
            if len(of_posed) > len(posed):  # a stream holds nothing back, and copies nothing
                of_posed = cut(of_posed, first, first + len(posed))
            changes, bins = self._taken(len(posed)), self._watch.completed or []
            if self._sheared:
                self._sticking.see(changes.t_s, changes.spread)
            consent = self._shifts.step(of_posed, detected.events, changes, bins)
            bins.clear()
            self._since_s.append(consent.since_s)
            parts.append(self._odds.step(posed, of_posed, changes, consent.rests))
        if last:
            parts.append(self._odds.finish())
        count = sum(map(len, parts))
        if not count:
            none = np.empty((0, *posed.shape[1:]))
            return Judged(posed[:0], none, none, none, self._completed.finish() if last else [])
        odds = joined(parts)
        slips = joined(self._slips)
        flags = self._posed[0] if len(self._posed) == 1 else np.concatenate(self._posed)
        statistics = self._statistics[0] if len(self._statistics) == 1 else np.concatenate(self._statistics)
        since_s = self._since_s[0] if len(self._since_s) == 1 else np.concatenate(self._since_s)
        decisive = odds.log_odds
        if self._ahead_s:
            decisive = self._begun.step(odds, flags & (slips.quality[: len(flags)] == OK), slips.t_s)
        soon_s, begun_s = self._dated(since_s, flags, slips.t_s, count)
        # Odds know a tilt from a slide, over a short way; longer baselines need shear to know it.
        for_slip = odds.soon if self._sheared else odds.log_odds
        soon_s = np.where(for_slip > 0.0, np.fmin(soon_s, slips.t_s[:count, np.newaxis]), soon_s)
        self._since_s = [since_s[count:]] if len(since_s) > count else []
        left = len(slips) > count
        self._slips = [cut(slips, count, len(slips))] if left else []
        self._posed = [flags[count:]] if len(flags) > count else []
        self._statistics = [statistics[count:]] if len(statistics) > count else []
        slips = cut(slips, 0, count) if left else slips
        due = [event for event in self._events if event.t_s <= slips.t_s[-1]]
        self._events = self._events[len(due) :]
        posed_slips = Posed(flags[:count], due, self._agreement.step(slips), soon_s)
        slipping, found = self._verdict.step(slips, posed_slips, odds, decisive)
        complete = self._completed.step(slips, slipping, found, self._lost(count))
        statistic = statistics[:count]
        if np.count_nonzero(odds.restless):
            statistic = np.where(odds.restless, np.exp(np.clip(decisive, -MAX_EXPONENT, MAX_EXPONENT)), statistic)
        sticks = self._sticking.step(slips.t_s, slips.contact, slipping, odds.log_odds) if self._sheared else None
        events = [*complete, *self._completed.finish()] if last else complete
        rests = np.fmax(AGAINST - odds.log_odds, 0.0) if self._ahead_s else np.zeros_like(odds.log_odds)
        return Judged(slipping, odds.log_odds, rests, statistic, events, sticks, begun_s)

    def _dated(self, since_s: Floats, flags: Bools, t_s: Floats, count: int) -> tuple[Floats, Floats | None]:
        """Since when the patterns of the oldest scans consent, see `Posed`, and `Judged.begun_s`."""
        if not self._ahead_s:
            return since_s, None
        begun_s = ahead(since_s, flags, t_s, self._ahead_s, count)
        known_s = np.where(begun_s <= t_s[:count, np.newaxis], begun_s, np.inf)
        return np.where(flags[:count], known_s, -np.inf), begun_s

    def _lost(self, count: int) -> Floats | None:
        """The oldest losses at borders, of this many scans."""
        if self._loss is None:
            return None
        whole = np.concatenate(self._losses)
        self._losses = [whole[count:]]
        return whole[:count]

    def _taken(self, count: int) -> PatternChanges:
        """The oldest changes, of this many scans."""
        whole = joined(self._changes)
        if len(whole) == count:
            self._changes = []
            return whole
        arrays = [getattr(whole, field.name) for field in fields(whole)]
        self._changes = [PatternChanges(*(array[count:] for array in arrays))]
        return PatternChanges(*(array[:count] for array in arrays))
