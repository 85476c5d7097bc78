"""The verdict on slips: by the pose, on restless pads by the patterns' evidence, and by facing pads that agree.

A pose that is not `ok` may move by tilt, rolling or growth alone. Its slip begins once the pattern is not against it,
also where a recording dates it to the end of the slip before, from which it is not parted by a scan at rest.
A stream, which knows the pattern's change 0.2 s late, does not wait for it where a method has only the border for a
reason: there the pose decides, unless the slip began so long before it was detected that its pattern has shown it.
Nor does any slip by the pose begin that a load which shifts over an object at rest explains as well (`ShiftingLoad`).

A group has a part of its pad's contact. Load that moves over the border of the group looks like motion of that part, so
where the whole contact rests, and its pose is `ok`, the part does not slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import OK, QUALITY, Event
from taxelflow.numerics.clock import SAME_S
from taxelflow.runtime.blocks import is_block
from taxelflow.slip.decision import Flags, decide, decide_block, find_vague
from taxelflow.slip.odds import LIVE_DELAY_S
from taxelflow.slip.suspicion import Suspicion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.odds import Odds


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """Slips by the poses of some scans. slipping: (scans, pads), by the pose of each pad, with events in time order.
    agreed: (scans, pads), by facing pads together. since_s: (scans, pads), see `ShiftingLoad.step`.
    """

    slipping: Bools
    events: list[Event]
    agreed: Bools
    since_s: Floats


def pads_of_groups(layout: Layout) -> NDArray[np.int64]:
    """(pads,), number of the pad of which a group has a part; -1 for pads, contacts, whole pads and several pads."""
    whole = np.full(len(layout.pads), -1)
    for group in range(layout.pad_count, len(layout.pads)):
        taxels = layout.source[layout.of_pad(group)]
        pads = np.unique(np.searchsorted(layout.starts[: layout.pad_count + 1], taxels, side="right") - 1)
        if layout.contact_of[group] < 0 and len(pads) == 1:
            own = layout.of_pad(int(pads[0]))
            whole[group] = pads[0] if len(taxels) < own.stop - own.start else -1
    return whole


class Verdict:
    """Slipping and events, block by block."""

    def __init__(self, layout: Layout, *, stream: bool = False, judged: bool = False) -> None:
        """judged: see `SlipMonitor.watch`."""
        self._stream = stream
        count = len(layout.pads)
        self._pads = layout.pads
        self._numbers = {name: number for number, name in enumerate(layout.pads)}
        self._whole = pads_of_groups(layout)
        self._in_part: Bools = self._whole >= 0
        self._grouped = bool(self._in_part.any())
        self._separate = [(contact, pad) for contact, pad in enumerate(layout.contact_of.tolist()) if pad >= 0]
        self._slipping = np.zeros((1, count), dtype=np.bool_)
        self._by_odds = np.zeros((1, count), dtype=np.bool_)
        self._judged = judged
        """Whether the method judges poses of cut contacts: it declares it, or one of them is `ok`."""
        self._began_early = np.zeros((1, count), dtype=np.bool_)
        self._suspected: dict[int, Event] = {}
        """Begins of slips by the pose that go on and are only suspected, by pad."""
        self._suspicion = Suspicion(layout.pitch_m)
        self._begun_s = np.full(count, -np.inf)
        """Onset of the last slip of each pad."""

    def step(self, slips: Slips, posed: Posed, odds: Odds, decisive: Floats) -> tuple[Bools, list[Event]]:
        """Slipping (scans, pads), and the events of these scans in time order.

        A slip that only the pose of one pad sees on a restless pad, or on a part of one that rests, or that its pattern
        speaks against while the pose is not `ok`, becomes `slip_suspected`, again and again while its pose moves on.
        decisive: (scans, pads), the log odds by which a restless pad slips, see `Begun`.
        """
        events, (final, by_odds, begins) = posed.events, np.zeros((3, *posed.slipping.shape), dtype=np.bool_)
        own: dict[tuple[int, int], list[Event]] = {}
        for event in events:
            scan, pad = int(np.searchsorted(slips.t_s, event.t_s)), self._numbers[event.pad]
            own.setdefault((scan, pad), []).append(event)
            begins[scan, pad] |= event.event == "slip_start"
        judged = self._sure(slips), self._vague(slips, events)
        flags = Flags(posed.slipping, begins, posed.agreed, slips.contact, odds.restless, *judged)
        last, last_by_odds = self._slipping, self._by_odds
        decide_ = decide_block if is_block(len(slips), decide) else decide
        log_odds = decisive, odds.soon
        changes = decide_(flags, self._whole, log_odds, posed.since_s, last, last_by_odds, final, by_odds)
        self._slipping, self._by_odds = final[-1:], by_odds[-1:]
        again = self._suspicion.step(slips, posed.slipping & ~final)
        if not events and not changes and not again:
            return final, []
        before, by_odds = np.concatenate([last, final]), np.concatenate([last_by_odds, by_odds])
        changed = (before[1:] != before[:-1]) & (by_odds[1:] | by_odds[:-1])
        places = {(int(scan), int(pad)) for scan, pad in zip(*np.nonzero(changed), strict=True)}
        found = []
        for scan, pad in sorted(places | own.keys() | again.keys()):
            own_events = own.get((scan, pad), [])
            if by_odds[scan : scan + 2, pad].any():
                ends = before[scan, pad], before[scan + 1, pad]
                since_s = np.inf if odds.restless[scan, pad] else float(posed.since_s[scan, pad])
                ends_now = bool(ends[0]), bool(ends[1])
                own_events = self._decided(own_events, float(slips.t_s[scan]), pad, ends_now, since_s)
            self._keep_suspected(own.get((scan, pad), []), pad, slips_on=bool(before[scan + 1, pad]))
            if (scan, pad) in again and not own_events:
                own_events = [self._again(pad, float(slips.t_s[scan]), again[scan, pad])]
            quality, evidence = QUALITY[slips.quality[scan, pad]], float(odds.log_odds[scan, pad])
            evidence = nan if np.isnan(evidence) else evidence  # one and the same NaN, as of other fields
            found += [_witnessed(self._in_order(pad, event), quality, evidence) for event in own_events]
        return final, found

    def _sure(self, slips: Slips) -> Bools:
        """(scans, pads), pads in contact with an `ok` pose that no separate contact shares."""
        if not self._grouped:  # only groups ask
            return slips.contact
        sure: Bools = slips.contact & (slips.quality == OK)
        for contact, pad in self._separate:
            sure[:, pad] &= ~slips.contact[:, contact]
        return sure

    def _vague(self, slips: Slips, events: list[Event]) -> Bools:
        """(scans, pads), poses that need their pattern's consent to begin a slip."""
        if not self._stream or self._judged:
            vague: Bools = slips.quality > OK
            return vague
        vague = np.empty(slips.quality.shape, dtype=np.bool_)
        marks = slips.quality, slips.border, slips.contact
        self._judged = find_vague(*marks, self._in_part, self._visible(slips, events), self._judged, vague)
        return vague

    def _visible(self, slips: Slips, events: list[Event]) -> Bools:
        """(scans or 1, pads), whether the last slip by the pose began early enough for its pattern to show it."""
        if not events:
            return self._began_early
        visible = np.empty((len(slips), len(self._pads)), dtype=np.bool_)
        start = 0
        for event in events:
            scan = int(np.searchsorted(slips.t_s, event.t_s))
            visible[start:scan], start = self._began_early, scan
            if event.event == "slip_start":
                self._began_early[0, self._numbers[event.pad]] = event.t_s - event.onset_s > LIVE_DELAY_S + SAME_S
        visible[start:] = self._began_early
        return visible

    def _decided(
        self, posed: list[Event], t_s: float, pad: int, ends: tuple[bool, bool], since_s: float
    ) -> list[Event]:
        """Events of one scan that its pose does not decide alone. posed: by the pose. ends: slipping before, now.

        since_s: a slip that was suspected began when its pose did, but not before this; inf on a restless pad, and
        where facing pads decide: it begins now.
        """
        slipped, slips_on = ends
        starts = [event for event in posed if event.event == "slip_start"]
        slip: list[Event] = []
        if slips_on and not slipped:
            suspected = [self._suspected[pad]] if since_s < np.inf and pad in self._suspected else []
            slip = starts[:1] or [replace(one, t_s=t_s, onset_s=max(one.onset_s, since_s)) for one in suspected]
            slip = slip or [Event(t_s, self._pads[pad], "slip_start", t_s)]
        elif not slips_on:
            stops = [event for event in posed if event.event == "slip_stop" and starts]
            slip = (stops[:1] or [Event(t_s, self._pads[pad], "slip_stop", t_s)]) if slipped else []
            slip += [replace(event, event="slip_suspected") for event in starts]
        touch, release = ([event for event in posed if event.event == kind] for kind in ("contact", "release"))
        return [*touch, *slip, *release]

    def _in_order(self, pad: int, event: Event) -> Event:
        """No slip ends before its onset, which may be that of its pattern's consent."""
        if event.event == "slip_start":
            self._begun_s[pad] = event.onset_s
        early = event.event == "slip_stop" and event.onset_s < self._begun_s[pad]
        return replace(event, onset_s=float(self._begun_s[pad])) if early else event

    def _again(self, pad: int, t_s: float, since_s: float) -> Event:
        """A suspected slip that goes on: that of its pose, or, since a time, what is left of a slip that has ended."""
        slip = self._suspected.get(pad, Event(since_s, self._pads[pad], "slip_start", since_s))
        return replace(slip, t_s=t_s, event="slip_suspected")

    def _keep_suspected(self, posed: list[Event], pad: int, *, slips_on: bool) -> None:
        """Keep the begin of a slip by the pose that is only suspected, until the pose's slip ends."""
        for event in posed:
            if event.event == "slip_start" and not slips_on:
                self._suspected[pad] = event
            elif event.event != "slip_start":
                self._suspected.pop(pad, None)


def _witnessed(event: Event, quality: str, evidence: float) -> Event:
    """A slip's event with the quality of its pose and the evidence."""
    if event.event in ("contact", "release"):
        return event
    return replace(event, quality=quality, evidence=evidence)
