"""Slips by the pose that a load which shifts over an object at rest explains as well.

Where a hand pulls, swings or rocks an object, its load wanders, and so does every pose that is learned from pressure:
by more than a covariance by noise and faults of the taxels holds. So on a sensor with an `unseen_error` the pattern has
to consent to a slip by the pose. The pattern from before it began is compared with the present one:

- it consents if a slide explains the change clearly better than rest does (`rest_or_slide`);
- if the contact was still before, its load steady, and a slide explains more than a change of the load does, it
  consents unless rest explains the change clearly better: a load that was still does not shift;
- an object that covers the pad shows no end of its contact, where alone a rest leaves more than usual: there the odds
  of `evidence` decide;
- it consents where less than half of the load is on taxels that were loaded before: the object has come that far, by
  sliding or by rolling;
- odds for a slip (`odds`) are enough: they know a tilt from a slide, over 0.3 s, where the place is still in sight.

Else the slip is suspected. Patterns are means of bins. In the first 0.1 s a single scan is enough, too: many slips in a
hand are over before their bin is. Patterns are compared until a slide is clearly better: a slip that lasts while rest
is may be none (`RestlessPads`). The interval that is compared begins with the slip: the longer
the way, the clearer the decision. Where the load wanders the pose may claim a slip long before there is one; then it
begins after the last bin that rest explained clearly better, and so does the interval: what rolls or tilts rests in
each short one, where in a long one neither is explained.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.bins import BIN_S
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.clock import SAME_S
from taxelflow.numerics.rest_or_slide import compare, overlap
from taxelflow.numerics.rounding import SIGNIFICANT
from taxelflow.runtime.compiling import kernel
from taxelflow.sensors.skins import PadNoise, prepare, skin_of
from taxelflow.slip.claim import WINDOW_S, Claim, Pattern
from taxelflow.slip.pattern_change import BINS
from taxelflow.slip.restless import RESTLESS_SHARE

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Event, Scans, Slips
    from taxelflow.numerics.bins import Bin
    from taxelflow.sensors.layout import Layout
    from taxelflow.slip.pattern_change import PatternChanges


@dataclass(frozen=True, slots=True)
class _Still:
    """A contact that was still before a slip."""

    history_s: float = 2.5
    """Time before a slip that is remembered: the onset detector looks back 2 s."""
    bins: int = 6
    """A contact was still if it was not restless, see `restless`, over at least this many bins at a steady load."""


_STILL = _Still()


class Consent(NamedTuple):
    """Of the pattern to slips by the pose, (scans, pads) each. since_s: since when it consents to one that goes on; inf
    where it does not. rests: whether rest explains the change clearly better, since that slip began or it last did.
    """

    since_s: Floats
    rests: Bools


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A bin, and the path of the poses up to it, (pads, 2), m."""

    bin: Bin
    path_m: Floats


class ShiftingLoad:
    """Follows the slips by the pose of all pads."""

    def __init__(self, layout: Layout) -> None:
        self._layout, self._numbers = layout, {name: number for number, name in enumerate(layout.pads)}
        self._pitch_m, self._noise = np.sqrt(layout.pitch_m.prod(axis=1)), PadNoise(layout)
        self._doubts = layout.unseen_error > 0.0
        count = len(layout.pads)
        self._claims: dict[int, Claim] = {}
        self._ended: dict[int, Claim] = {}
        self._coming: list[Bin] = []  # of scans that `step` has not reached
        self._scans: deque[Scans] = deque()  # blocks whose last scan `step` has not reached
        self._scan = 0  # the next one of the first of these
        self._seen: list[_Seen] = []
        self._stirred: list[tuple[float, Floats]] = []  # first time of a bin, and (pads,) of it
        self._path_m = np.zeros((count, 2))

    def prepare(self) -> None:
        """Make ready what a comparison needs, so that none of a stream waits for it."""
        if self._doubts:
            prepare(self._layout)

    def see(self, scans: Scans) -> None:
        """Scans that `step` will reach."""
        if self._doubts and len(scans):
            self._scans.append(scans)

    def step(self, slips: Slips, events: list[Event], changes: PatternChanges, completed: list[Bin]) -> Consent:
        """Consent to slips in these scans.

        events: by the pose, of these scans, in time order. changes: of these scans. completed: bins since the last
        call, which may be of later scans.
        """
        shape = slips.contact.shape
        found = Consent(np.full(shape, -np.inf), np.zeros(shape, dtype=np.bool_))
        if not self._doubts:
            return found
        self._coming += completed
        begun = [event for event in events if event.event in ("slip_start", "slip_stop", "release")]
        paths_m, done = np.empty((*shape, 2)), 0
        _follow(slips.displacement, self._path_m, paths_m)
        for scan, (t_s, centre_s) in enumerate(zip(slips.t_s.tolist(), changes.centre_s.tolist(), strict=True)):
            self._path_m = paths_m[scan]
            if isfinite(centre_s):
                self._stirred.append((centre_s, changes.stirred[scan]))
            while done < len(begun) and begun[done].t_s <= t_s:
                self._change(begun[done])
                done += 1
            while self._coming and self._coming[0].until_s <= t_s:
                self._judge(_Seen(self._coming.pop(0), self._path_m))
            self._compare_scan()
            for pad, claim in self._claims.items():
                found.since_s[scan, pad], found.rests[scan, pad] = claim.since_s, claim.rests
        return found

    def _change(self, event: Event) -> None:
        """Begin or end a slip by the pose."""
        pad = self._numbers[event.pad]
        claim = self._claims.pop(pad, None)
        if claim is not None:
            self._ended[pad] = claim
        if event.event == "slip_start":
            before = self._ended.get(pad)
            resumed = before is not None and before.onset_s == event.onset_s  # its end was withdrawn
            claim = before if before is not None and resumed else self._claimed(pad, event)
            self._claims[pad] = claim

    def _claimed(self, pad: int, event: Event) -> Claim:
        """A slip by the pose that begins; a method without displacement has no way to doubt."""
        if np.isnan(event.speed_m_s):
            return Claim(event.onset_s, still=True, since_s=-np.inf)
        stirred = [flags[pad] for since_s, flags in self._stirred if since_s + WINDOW_S <= event.onset_s + SAME_S]
        steady = np.array([flag for flag in stirred if not np.isnan(flag)])
        still = len(steady) >= _STILL.bins and bool(steady.mean() <= RESTLESS_SHARE)
        earlier = [
            seen
            for seen in self._seen
            if seen.bin.until_s <= event.onset_s and seen.bin.touching[pad] and seen.bin.whole[pad]
        ]
        before = self._pattern(pad, earlier[-BINS.before :]) if earlier else None
        scans_s = event.t_s, event.t_s + BIN_S  # then bins have seen it
        return Claim(event.onset_s, still, before, scans_s=scans_s)

    def _pattern(self, pad: int, seen: list[_Seen]) -> Pattern:
        """Mean of some bins, at least one."""
        own, scans = self._layout.of_pad(pad), sum(one.bin.scans for one in seen)
        total, path_m = seen[0].bin.pressure[own], seen[0].path_m[pad]
        for one in seen[1:]:
            total, path_m = total + one.bin.pressure[own], path_m + one.path_m[pad]
        return Pattern(seen[-1].bin.until_s, total / scans, scans, path_m / len(seen))

    def _judge(self, seen: _Seen) -> None:
        """One more bin: compare the patterns that have not shown their slip yet."""
        self._seen.append(seen)
        oldest_s = seen.bin.until_s - _STILL.history_s - SAME_S
        self._seen = [one for one in self._seen if one.bin.until_s >= oldest_s]
        self._stirred = [one for one in self._stirred if one[0] >= oldest_s]
        for pad, claim in self._claims.items():
            if not claim.shown and seen.bin.touching[pad] and seen.bin.whole[pad]:
                self._compare(pad, claim, self._pattern(pad, [seen]), seen.bin.noise, is_bin=True)

    def _compare_scan(self) -> None:
        """The next scan may show a slip before its bin is complete."""
        scans, scan = self._scans[0], self._scan
        self._scan = (scan + 1) % len(scans)
        if not self._scan:
            self._scans.popleft()
        for pad, claim in self._claims.items():
            if claim.shown or not (scans.contact[scan, pad] and scans.complete[scan, pad]):
                continue
            (since_s, until_s), t_s = claim.scans_s, float(scans.t_s[scan])
            if since_s - SAME_S <= t_s <= until_s + SAME_S:
                claim.scans_s = t_s + BIN_S / 10, until_s  # large pads take milliseconds
                own = scans.pressure[scan, self._layout.of_pad(pad)]
                now = Pattern(t_s, own, 1, self._path_m[pad])
                self._compare(pad, claim, now, scans.noise, is_bin=False)

    def _compare(self, pad: int, claim: Claim, now: Pattern, noise: Floats, *, is_bin: bool) -> None:
        """Does a slide explain the change of a pattern clearly better than rest, or rest than a slide?

        noise: (entries,), standard deviation of a reading. is_bin: a mean, by which the object may rest, too.
        """
        if now.until_s <= claim.onset_s:
            return
        before, skin = claim.before, skin_of(self._layout, pad)
        if before is None:
            claim.before = now if is_bin else None
            return
        common = overlap(skin, before.pressure, now.pressure)
        scatter = float(self._noise.median(noise)[pad] * np.sqrt(1.0 / before.scans + 1.0 / now.scans))
        if common.comparable:
            way = np.array([*(now.path_m - before.path_m) / self._pitch_m[pad], 0.0])
            left = compare(skin, before.pressure, now.pressure, scatter, way, gain_error=self._layout.unseen_error)
            claim.judge(now, left, scatter, covers=common.covers, is_bin=is_bin)
        elif is_bin or _touches_anew(before.pressure, now.pressure, scatter):
            claim.show()


def _touches_anew(before: Floats, now: Floats, noise: float) -> bool:
    """Whether a taxel that was not loaded has the largest load: noise of a single scan on a large pad may be half of
    its load.
    """
    largest = int(now.argmax())
    return bool(before[largest] <= LOADED.skirt * before.max() and now[largest] > SIGNIFICANT * noise)


@kernel
def _follow(displacement: Floats, path_m: Floats, out: Floats) -> None:
    """Fill paths (scans, pads, 2) that go on from path_m (pads, 2) by displacements (scans, pads, 3), if known."""
    for pad in range(len(path_m)):
        for axis in range(2):
            path = path_m[pad, axis]
            for scan in range(len(out)):
                step = displacement[scan, pad, axis]
                path += 0.0 if np.isnan(step) else step
                out[scan, pad, axis] = path


def ahead(since_s: Floats, slipping: Bools, t_s: Floats, within_s: float, count: int) -> Floats:
    """(count, pads), since when a pattern consents to a slip by the pose that goes on, as known within a time from each
    scan; later than the scan where the pose claims it too early. Else when the next such slip begins that is known by
    then; inf where none is.

    since_s, slipping: (scans, pads), of these scans and later ones; t_s: (scans,).
    """
    soon = np.empty_like(since_s)
    own_s, own, coming_s, coming = (np.full(since_s.shape[1], np.inf) for _ in range(4))
    for scan in range(len(since_s) - 1, -1, -1):
        consents = slipping[scan] & (since_s[scan] < np.inf)
        own_s = np.where(slipping[scan], np.where(consents, t_s[scan], own_s), np.inf)
        own = np.where(consents, since_s[scan], own)
        shown, latest_s = own_s < np.inf, t_s[scan] + within_s + SAME_S
        coming_s = np.where(shown, own_s, coming_s)
        coming = np.where(shown, np.maximum(own, t_s[scan]), coming)
        soon[scan] = np.where(own_s <= latest_s, own, np.where(coming_s <= latest_s, coming, np.inf))
    return soon[:count]
