"""The slip stage: the pose's detector and the patterns' evidence side by side, and one verdict."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Event, Floats, cut, joined
from taxelflow.slip.odds import AFTER_BINS, LIVE_AFTER_BINS, LiveOdds, Odds, OfflineOdds
from taxelflow.slip.offline import OfflineSlipSession
from taxelflow.slip.pattern_change import PatternChanges, PatternWatch
from taxelflow.slip.session import SlipSession
from taxelflow.slip.verdict import Verdict

if TYPE_CHECKING:
    from taxelflow.messages import Scans, Slips
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.measurement import Parameters


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """The oldest scans that are judged. slipping: (scans, pads). evidence: (scans, pads), log odds of a slip by the
    change of the pattern; NaN where unknown. events: of these scans, in time order.
    """

    slipping: Bools
    evidence: Floats
    events: list[Event]

    def __len__(self) -> int:
        return len(self.slipping)


class SlipStage:
    """Slips of all pads. `see` gets the scans, `step` their slips, which may come later."""

    def __init__(self, layout: Layout, parameters: Parameters, creep_m_s: float, *, stream: bool) -> None:
        pads = layout.pads
        self._watch = PatternWatch(layout, creep_m_s, LIVE_AFTER_BINS if stream else AFTER_BINS)
        self._detector = (SlipSession if stream else OfflineSlipSession)(pads, parameters)
        self._odds = LiveOdds(len(pads)) if stream else OfflineOdds(len(pads))
        self._verdict = Verdict(pads)
        self._changes: list[PatternChanges] = []
        self._slips: list[Slips] = []  # not judged yet
        self._posed: list[Bools] = []  # slipping by the pose, of scans that are not judged yet
        self._events: list[Event] = []

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._detector.scatter

    def see(self, scans: Scans) -> None:
        """Compare the patterns of scans, whose slips follow."""
        self._changes.append(self._watch.step(scans))

    def step(self, slips: Slips) -> Judged:
        """Judge scans that were seen, which follow those of the last call."""
        self._slips.append(slips)
        return self._judge(*self._detector.step(slips), last=False)

    def finish(self) -> Judged:
        """The scans that `step` has held back."""
        return self._judge(*self._detector.finish(), last=True)

    def _judge(self, posed: Bools, events: list[Event], *, last: bool) -> Judged:
        self._posed.append(posed)
        self._events += events
        parts = []
        if len(posed):
            parts.append(self._odds.step(posed, self._taken(len(posed))))
        if last:
            parts.append(self._odds.finish())
        count = sum(map(len, parts))
        if not count:
            return Judged(posed[:0], np.empty((0, *posed.shape[1:])), [])
        odds = Odds(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Odds)))
        slips, self._slips = _split_slips(self._slips, count)
        flags = np.concatenate(self._posed)
        self._posed = [flags[count:]]
        due = [event for event in self._events if event.t_s <= slips.t_s[-1]]
        self._events = self._events[len(due) :]
        slipping, found = self._verdict.step(slips, flags[:count], due, odds)
        return Judged(slipping, odds.log_odds, found)

    def _taken(self, count: int) -> PatternChanges:
        """The oldest changes, of so many scans."""
        names = [field.name for field in fields(PatternChanges)]
        whole = {name: np.concatenate([getattr(part, name) for part in self._changes]) for name in names}
        self._changes = [PatternChanges(**{name: array[count:] for name, array in whole.items()})]
        return PatternChanges(**{name: array[:count] for name, array in whole.items()})


def _split_slips(held: list[Slips], count: int) -> tuple[Slips, list[Slips]]:
    """The first `count` scans, and what is left."""
    block = joined(held)
    return cut(block, 0, count), [cut(block, count, len(block))]
