"""The verdict on slips: by the pose, on restless pads by the patterns' evidence, and by facing pads that agree.

A group has a part of its pad's contact. Load that moves over the border of the group looks like motion of that part, so
where the whole contact rests, and its pose is `ok`, the part does not slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import OK, QUALITY, Event
from taxelflow.runtime.blocks import is_block
from taxelflow.runtime.compiling import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Bools, Floats, Slips
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.odds import Odds


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """Slips by the poses of some scans. slipping: (scans, pads), by the pose of each pad, with events in time order.
    agreed: (scans, pads), by facing pads together.
    """

    slipping: Bools
    events: list[Event]
    agreed: Bools


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


def decide_block(
    flags: tuple[Bools, Bools, Bools, Bools, Bools],
    whole: NDArray[np.int64],
    log_odds: Floats,
    last: Bools,
    last_by_odds: Bools,
    final: Bools,
    by_odds: Bools,
) -> bool:
    """`decide` in NumPy."""
    slipping, agreed, contact, restless, sure = flags
    judged = np.where(restless, log_odds > 0.0, slipping)
    rests = np.zeros_like(final)
    for pad, part_of in enumerate(whole.tolist()):  # pads come before their groups
        if part_of >= 0:
            rests[:, pad] = sure[:, part_of] & ~final[:, part_of]
        final[:, pad] = (judged[:, pad] | agreed[:, pad]) & contact[:, pad] & ~rests[:, pad]
    by_odds[...] = restless | agreed | rests
    changed = final != np.concatenate([last, final])[:-1]
    return bool((changed & (by_odds | np.concatenate([last_by_odds, by_odds])[:-1])).any())


@kernel
def decide(
    flags: tuple[Bools, Bools, Bools, Bools, Bools],
    whole: NDArray[np.int64],
    log_odds: Floats,
    last: Bools,
    last_by_odds: Bools,
    final: Bools,
    by_odds: Bools,
) -> bool:
    """Fill what slips, and whether others than its pose decide it, (scans, pads) each; whether they change anything.

    flags: (scans, pads), slipping by the pose, agreed, contact, restless, and whether the pose of a pad's only contact
    is `ok`. whole: (pads,), see `pads_of_groups`. last, last_by_odds: (1, pads), before.
    """
    slipping, agreed, contact, restless, sure = flags
    changes = False
    for scan in range(final.shape[0]):
        for pad in range(final.shape[1]):
            was, by = last[0, pad], last_by_odds[0, pad]
            if scan > 0:
                was, by = final[scan - 1, pad], by_odds[scan - 1, pad]
            judged = log_odds[scan, pad] > 0.0 if restless[scan, pad] else slipping[scan, pad]
            part_of = whole[pad]  # pads come before their groups
            rests = part_of >= 0 and sure[scan, part_of] and not final[scan, part_of]
            final[scan, pad] = (judged or agreed[scan, pad]) and contact[scan, pad] and not rests
            by_odds[scan, pad] = restless[scan, pad] or agreed[scan, pad] or rests
            changes |= final[scan, pad] != was and (by or by_odds[scan, pad])
    return changes


class Verdict:
    """Slipping and events, block by block."""

    def __init__(self, layout: Layout) -> None:
        count = len(layout.pads)
        self._pads = layout.pads
        self._numbers = {name: number for number, name in enumerate(layout.pads)}
        self._whole = pads_of_groups(layout)
        self._separate = [(contact, pad) for contact, pad in enumerate(layout.contact_of.tolist()) if pad >= 0]
        self._slipping = np.zeros((1, count), dtype=np.bool_)
        self._by_odds = np.zeros((1, count), dtype=np.bool_)

    def step(self, slips: Slips, posed: Posed, odds: Odds) -> tuple[Bools, list[Event]]:
        """Slipping (scans, pads), and the events of these scans in time order.

        A slip that only the pose of one pad sees on a restless pad, or on a part of one that rests, becomes
        `slip_suspected`.
        """
        events, final, by_odds = posed.events, np.empty_like(posed.slipping), np.empty_like(posed.slipping)
        flags = (posed.slipping, posed.agreed, slips.contact, odds.restless, self._sure(slips))
        last, last_by_odds = self._slipping, self._by_odds
        decide_ = decide_block if is_block(len(slips)) else decide
        changes = decide_(flags, self._whole, odds.log_odds, last, last_by_odds, final, by_odds)
        self._slipping, self._by_odds = final[-1:], by_odds[-1:]
        if not events and not changes:
            return final, []
        before, by_odds = np.concatenate([last, final]), np.concatenate([last_by_odds, by_odds])
        own: dict[tuple[int, int], list[Event]] = {}
        for event in events:
            scan = int(np.searchsorted(slips.t_s, event.t_s))
            own.setdefault((scan, self._numbers[event.pad]), []).append(event)
        changed = (before[1:] != before[:-1]) & (by_odds[1:] | by_odds[:-1])
        places = {(int(scan), int(pad)) for scan, pad in zip(*np.nonzero(changed), strict=True)}
        found = []
        for scan, pad in sorted(places | own.keys()):
            own_events = own.get((scan, pad), [])
            if by_odds[scan : scan + 2, pad].any():
                ends = before[scan, pad], before[scan + 1, pad]
                own_events = self._decided(own_events, float(slips.t_s[scan]), pad, (bool(ends[0]), bool(ends[1])))
            quality, evidence = QUALITY[slips.quality[scan, pad]], float(odds.log_odds[scan, pad])
            evidence = nan if np.isnan(evidence) else evidence  # one and the same NaN, as of other fields
            found += [_witnessed(event, quality, evidence) for event in own_events]
        return final, found

    def _sure(self, slips: Slips) -> Bools:
        """(scans, pads), pads in contact with an `ok` pose that no separate contact shares."""
        sure: Bools = slips.contact & (slips.quality == OK)
        for contact, pad in self._separate:
            sure[:, pad] &= ~slips.contact[:, contact]
        return sure

    def _decided(self, posed: list[Event], t_s: float, pad: int, ends: tuple[bool, bool]) -> list[Event]:
        """Events of one scan that its pose does not decide alone. posed: by the pose. ends: slipping before, now."""
        slipped, slips_on = ends
        starts = [event for event in posed if event.event == "slip_start"]
        slip: list[Event] = []
        if slips_on and not slipped:
            slip = starts[:1] or [Event(t_s, self._pads[pad], "slip_start", t_s)]
        elif slipped and not slips_on:
            slip = [Event(t_s, self._pads[pad], "slip_stop", t_s)]
        elif not slips_on:
            slip = [replace(event, event="slip_suspected") for event in starts]
        touch, release = ([event for event in posed if event.event == kind] for kind in ("contact", "release"))
        return [*touch, *slip, *release]


def _witnessed(event: Event, quality: str, evidence: float) -> Event:
    """A slip's event with the quality of its pose and the evidence."""
    if event.event in ("contact", "release"):
        return event
    return replace(event, quality=quality, evidence=evidence)
