"""The verdict on slips: by the pose, or on restless pads by the evidence of the patterns; and the events of both."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import QUALITY, Event

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Slips
    from taxelflow.slip.odds import Odds


class Verdict:
    """Slipping and events, block by block."""

    def __init__(self, pads: tuple[str, ...]) -> None:
        count = len(pads)
        self._pads = pads
        self._numbers = {name: number for number, name in enumerate(pads)}
        self._slipping = np.zeros((1, count), dtype=np.bool_)
        self._by_odds = np.zeros((1, count), dtype=np.bool_)
        self._since_s, self._way = np.zeros(count), np.zeros((count, 3))  # of the slip that goes on

    def step(self, slips: Slips, slipping: Bools, events: list[Event], odds: Odds) -> tuple[Bools, list[Event]]:
        """Slipping (scans, pads), and the events of these scans in time order.

        slipping, events: by the pose. A slip that only the pose sees on a restless pad becomes `slip_suspected`.
        """
        final = np.where(odds.restless, odds.log_odds > 0, slipping) & slips.contact
        before = np.concatenate([self._slipping, final])
        by_odds = np.concatenate([self._by_odds, odds.restless])
        self._slipping, self._by_odds = before[-1:], by_odds[-1:]
        if not events and not final.any() and not before[0].any():
            return final, []
        own: dict[tuple[int, int], list[Event]] = {}
        for event in events:
            scan = int(np.searchsorted(slips.t_s, event.t_s))
            own.setdefault((scan, self._numbers[event.pad]), []).append(event)
        changed = (before[1:] != before[:-1]) & (by_odds[1:] | by_odds[:-1])
        places = {(int(scan), int(pad)) for scan, pad in zip(*np.nonzero(changed), strict=True)}
        found, start = [], 0
        for scan, pad in sorted(places | own.keys()):
            self._add_way(slips, before, start, scan)
            start = scan
            posed = own.get((scan, pad), [])
            if before[scan + 1, pad] and not before[scan, pad]:
                self._since_s[pad], self._way[pad] = slips.t_s[scan], 0.0
            if by_odds[scan : scan + 2, pad].any():
                ends = before[scan, pad], before[scan + 1, pad]
                posed = self._decided(posed, float(slips.t_s[scan]), pad, (bool(ends[0]), bool(ends[1])))
            quality, evidence = QUALITY[slips.quality[scan, pad]], float(odds.log_odds[scan, pad])
            evidence = nan if np.isnan(evidence) else evidence  # one and the same NaN, as of other fields
            found += [_witnessed(event, quality, evidence) for event in posed]
        self._add_way(slips, before, start, len(slips))
        return final, found

    def _decided(self, posed: list[Event], t_s: float, pad: int, ends: tuple[bool, bool]) -> list[Event]:
        """Events of one scan of a restless pad. posed: those by the pose. ends: slipping before and in this scan."""
        slipped, slips_on = ends
        starts = [event for event in posed if event.event == "slip_start"]
        slip: list[Event] = []
        if slips_on and not slipped:
            slip = starts[:1] or [Event(t_s, self._pads[pad], "slip_start", t_s)]
        elif slipped and not slips_on:
            slip = [self._stop(t_s, pad)]
        elif not slips_on:
            slip = [replace(event, event="slip_suspected") for event in starts]
        touch, release = ([event for event in posed if event.event == kind] for kind in ("contact", "release"))
        return [*touch, *slip, *release]

    def _stop(self, t_s: float, pad: int) -> Event:
        """End of a slip that the odds decided, with its mean motion as far as poses tell it."""
        vx, vy, yaw_rate = (self._way[pad] / max(t_s - self._since_s[pad], 1e-9)).tolist()
        if not vx and not vy:
            return Event(t_s, self._pads[pad], "slip_stop", t_s)
        turn = yaw_rate if yaw_rate else nan
        return Event(t_s, self._pads[pad], "slip_stop", t_s, float(np.arctan2(vy, vx)), float(np.hypot(vx, vy)), turn)

    def _add_way(self, slips: Slips, before: Bools, start: int, stop: int) -> None:
        """Add the displacements of slips in these scans."""
        slid = before[start + 1 : stop + 1, :, np.newaxis] & np.isfinite(slips.displacement[start:stop])
        steps = np.where(slid, slips.displacement[start:stop], 0.0)
        self._way = np.cumsum(np.concatenate([self._way[np.newaxis], steps]), axis=0)[-1]  # the same in any blocks


def _witnessed(event: Event, quality: str, evidence: float) -> Event:
    """A slip's event with the quality of its pose and the evidence."""
    if event.event in ("contact", "release"):
        return event
    return replace(event, quality=quality, evidence=evidence)
