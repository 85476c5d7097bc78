"""Contacts of a pad followed from scan to scan: which loaded taxel belongs to which of them.

A blob is a connected set of loaded taxels. A contact keeps its number from scan to scan: it goes on in the blobs that
hold at least a quarter of what it loaded before, else in the nearest new one. Two contacts that meet in one blob are
cut: the cores that they had, all above half of their peaks in it, grow over the blob from its highest taxel to its
lowest, a watershed. A contact without a blob frees its number, a new blob takes the lowest free one; if that was in
use in the scan before, this scan counts as without contact, so that no two contacts look like one that leaps. Parts of
a contact that have been apart for some scans become two, if a number is free; contacts that meet while one is still
young are one, and so are those of which one has for some scans had no peak, but lain on the other's flank: it has
lifted there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import Bools, Floats, no_scans

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout

    Indices = NDArray[np.int64]

ABSENT, TOUCHING, NEAR, FREE = range(4)
_SHARE = 0.25
"""Of what a contact loaded before, that a blob must hold to be its continuation."""
_CORE = 0.5
_YOUNG, _APART = 5, 3
"""Scans after which a contact is sure to be one, and for which parts of one must be apart to be two, or one of two
without a peak to be gone."""
_REACH = 3.0
"""A contact is looked for within so many pitches, if there are others."""


@dataclass(frozen=True, slots=True)
class Followed:
    """labels: (scans, taxels) of the sensor, n for a loaded taxel of contact n of its pad, from 1; -n for one beside
    it, which is not loaded; 0 for all others. room: (scans, pads followed, slots), how far contact n lies from the
    others: ABSENT, TOUCHING (loaded taxels lie side by side), NEAR (one taxel between), FREE. whole: (scans, pads
    followed, slots), whether it is one blob.
    """

    labels: NDArray[np.int8]
    room: NDArray[np.int8]
    whole: Bools


class Follower:
    """Follows up to slots (pads,) contacts on each of some pads; keeps what the next scan needs."""

    def __init__(self, layout: Layout, pads: Indices, slots: Indices, on: float, off: float) -> None:
        """on, off: standard deviations of noise above which a blob becomes a contact, and a taxel is loaded."""
        self._layout, self._pads, self._slots = layout, pads, slots
        self._levels = on, off
        self._first, self._next = beside(layout, pads)
        pitch = np.repeat(np.sqrt(layout.pitch_m.prod(axis=1)), np.diff(layout.starts))[: layout.taxels]
        self._places = np.stack([layout.x_m[: layout.taxels], layout.y_m[: layout.taxels]]) / pitch
        self._most = int(slots.max())
        self._label = np.zeros(layout.taxels, dtype=np.int8)
        self._reading = np.zeros(layout.taxels)
        self._age = np.zeros((len(pads), self._most), dtype=np.int64)
        self._apart, self._flank = np.zeros_like(self._age), np.zeros_like(self._age)
        self.step(no_scans(layout.entries, len(layout.pads)))  # compiles

    def step(self, scans: Scans) -> Followed:
        """The contacts of these scans, which follow those of the last call."""
        labels = np.zeros((len(scans), self._layout.taxels), dtype=np.int8)
        room = np.zeros((len(scans), len(self._pads), self._most), dtype=np.int8)
        whole = np.zeros(room.shape, dtype=np.bool_)
        follow(
            scans.pressure,
            scans.noise,
            scans.contact,
            scans.complete,
            self._pads,
            self._slots,
            self._layout.starts,
            self._first,
            self._next,
            self._places,
            *self._levels,
            self._label,
            self._reading,
            self._age,
            self._apart,
            self._flank,
            labels,
            room,
            whole,
        )
        return Followed(labels, room, whole)


def beside(layout: Layout, pads: Indices) -> tuple[Indices, Indices]:
    """Taxels beside each taxel of these pads: those of taxel k are next[first[k] : first[k + 1]].

    In a grid those that share a side or a corner with it, else its neighbours by `Layout.neighbours`.
    """
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for pad in pads.tolist():
        own = layout.of_pad(pad)
        if layout.tables[pad]:
            pairs.append(layout.neighbours(pad) + own.start)
        else:
            row, col = layout.row[own], layout.col[own]
            near = np.maximum(np.abs(row[:, np.newaxis] - row), np.abs(col[:, np.newaxis] - col)) == 1
            pairs.append(np.argwhere(np.triu(near)) + own.start)
    one_way = np.concatenate(pairs)
    both = np.concatenate([one_way, one_way[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    first = np.searchsorted(both[:, 0], np.arange(layout.taxels + 1))
    return first.astype(np.int64), np.ascontiguousarray(both[:, 1])


@kernel
def follow(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    pads: Indices,
    slots: Indices,
    starts: Indices,
    first: Indices,
    beside: Indices,
    places: Floats,
    on: float,
    off: float,
    label: NDArray[np.int8],
    before: Floats,
    age: NDArray[np.int64],
    apart: NDArray[np.int64],
    flank: NDArray[np.int64],
    labels: NDArray[np.int8],
    room: NDArray[np.int8],
    whole: Bools,
) -> None:
    """Fill labels, room and whole (see `Followed`). label, before: (taxels,) of the scan before, and age, apart and
    flank: (pads, slots), in scans, are memory; contacts of age 0 are none.
    """
    blob = np.zeros(len(label), dtype=np.int64)
    for scan in range(len(pressure)):
        for number in range(len(pads)):
            pad = pads[number]
            low, high = starts[pad], starts[pad + 1]
            if not contact[scan, pad]:
                label[low:high] = 0
                age[number] = 0
                apart[number] = 0
                flank[number] = 0
                continue
            reading = pressure[scan]
            blobs = _find(reading, noise, not complete[scan, pad], off, low, high, first, beside, blob)
            if slots[number] == 1:
                label[low:high] = (blob[low:high] > 0).astype(np.int8)
                age[number, 0] = 1
            else:
                own_age, own_apart = age[number, : slots[number]], apart[number, : slots[number]]
                owner = _own(reading, noise, on, low, high, places, blob, blobs, label, before, own_age, own_apart)
                if _cut(reading, low, high, first, beside, blob, owner, label, before):
                    _join_flanks(reading, low, high, first, beside, label, own_age, flank[number])
            before[low:high] = reading[low:high]
            labels[scan, low:high] = label[low:high]
            _surround(reading, low, high, first, beside, labels[scan], age[number], room[scan, number])
            _count(blob[low:high], label[low:high], age[number], whole[scan, number])


@kernel
def _find(
    reading: Floats,
    noise: Floats,
    lacks: bool,
    off: float,
    low: int,
    high: int,
    first: Indices,
    beside: Indices,
    blob: Indices,
) -> int:
    """Number the connected loaded taxels from 1 in blob, 0 elsewhere; how many there are. A taxel that says nothing
    (masked, or missing where the scan lacks some) counts as loaded between two that are.
    """
    for k in range(low, high):
        blob[k] = -1 if reading[k] > off * noise[k] > 0.0 else 0
    for k in range(low, high):
        if noise[k] == 0.0 or (lacks and reading[k] == 0.0):
            near = 0
            for j in beside[first[k] : first[k + 1]]:
                near += 1 if blob[j] == -1 else 0
            if near > 1:
                blob[k] = -2
    blobs, stack = 0, np.empty(high - low, dtype=np.int64)
    for k in range(low, high):
        if blob[k] >= 0:
            continue
        blobs += 1
        blob[k], stack[0], left = blobs, k, 1
        while left > 0:
            left -= 1
            j = stack[left]
            for i in beside[first[j] : first[j + 1]]:
                if blob[i] < 0:
                    blob[i], stack[left] = blobs, i
                    left += 1
    return blobs


@kernel
def _own(
    reading: Floats,
    noise: Floats,
    on: float,
    low: int,
    high: int,
    places: Floats,
    blob: Indices,
    blobs: int,
    label: NDArray[np.int8],
    before: Floats,
    age: NDArray[np.int64],
    apart: NDArray[np.int64],
) -> Bools:
    """(blobs + 1, slots + 1), which contacts each blob belongs to, both from 1; age, apart are brought up to date."""
    slots = len(age)
    votes = np.zeros((blobs + 1, slots + 1))
    is_now, was = np.zeros((blobs + 1, 3)), np.zeros((slots + 1, 3))  # load, then centroid
    peak = np.zeros(blobs + 1)
    for k in range(low, high):
        b, s = blob[k], label[k]
        if s > 0:
            _add(was[s], before[k], places[:, k])
        if b > 0:
            _add(is_now[b], reading[k], places[:, k])
            peak[b] = max(peak[b], reading[k] / noise[k] if noise[k] > 0.0 else 0.0)
            votes[b, s] += before[k] if s > 0 else 0.0
    owner = np.zeros((blobs + 1, slots + 1), dtype=np.bool_)
    for b in range(1, blobs + 1):
        for s in range(1, slots + 1):
            owner[b, s] = votes[b, s] > 0.0 and votes[b, s] >= _SHARE * was[s, 0]
        if not owner[b].any() and votes[b].max() > 0.0:
            owner[b, np.argmax(votes[b])] = True
    for s in range(1, slots + 1):  # one that is nowhere may have moved far
        if was[s, 0] > 0.0 and not owner[:, s].any():
            nearest = _nearest(is_now, was[s], owner, False, _REACH if owner.any() else np.inf)
            owner[nearest, s] = nearest > 0
    _unite(owner, age)
    for s in range(1, slots + 1):
        age[s - 1] = age[s - 1] + 1 if owner[:, s].any() else 0
    _number(owner, is_now[:, 0], peak, on, was[:, 0], age)
    _part(owner, is_now[:, 0], peak, on, was[:, 0], age, apart)
    owned = owner.copy()
    for b in range(1, blobs + 1):  # what is too faint, or one too many, goes to the nearest
        if not owned[b].any():
            nearest = _nearest(is_now, is_now[b], owned, True, np.inf)
            if nearest > 0:
                owner[b, np.argmax(owned[nearest])] = True
    return owner


@kernel
def _add(sums: Floats, load: float, place: Floats) -> None:
    """One more taxel in sums (3,): load, and centroid."""
    sums[0] += load
    sums[1] += load / sums[0] * (place[0] - sums[1]) if sums[0] > 0.0 else 0.0
    sums[2] += load / sums[0] * (place[1] - sums[2]) if sums[0] > 0.0 else 0.0


@kernel
def _nearest(blobs: Floats, place: Floats, owner: Bools, owned: bool, reach: float) -> int:
    """The blob of blobs (blobs + 1, 3) nearest to place (3,), of those that have an owner or of those that have none;
    0 if none is within reach.
    """
    nearest = 0
    for b in range(1, len(blobs)):
        far = np.hypot(blobs[b, 1] - place[1], blobs[b, 2] - place[2])
        if owner[b].any() == owned and far < reach:
            nearest, reach = b, far
    return nearest


@kernel
def _unite(owner: Bools, age: NDArray[np.int64]) -> None:
    """Contacts that meet in a blob while one is young are one: the older one, which takes all of the other's."""
    for b in range(1, len(owner)):
        for s in range(len(age), 0, -1):
            if not owner[b, s] or age[s - 1] >= _YOUNG:
                continue
            for r in range(1, len(age) + 1):
                older = age[r - 1] > age[s - 1] or (age[r - 1] == age[s - 1] and r < s)
                if owner[b, r] and older:
                    owner[:, r] |= owner[:, s]
                    owner[:, s] = False
                    break


@kernel
def _number(owner: Bools, load: Floats, peak: Floats, on: float, was: Floats, age: NDArray[np.int64]) -> None:
    """New blobs become contacts: the most loaded one takes the lowest free number. was: (slots + 1,), loads of the scan
    before; a number that was in use then is of age 0 in this one.
    """
    for s in range(1, len(age) + 1):
        new = 0
        for b in range(1, len(owner)):
            if not owner[b].any() and peak[b] > on and (new == 0 or load[b] > load[new]):
                new = b
        if new > 0 and not owner[:, s].any():
            owner[new, s], age[s - 1] = True, 0 if was[s] > 0.0 else 1


@kernel
def _part(
    owner: Bools, load: Floats, peak: Floats, on: float, was: Floats, age: NDArray[np.int64], apart: NDArray[np.int64]
) -> None:
    """Contacts whose blobs have been apart for long become two, if a number is free: the larger part keeps its own."""
    blobs, slots = owner.shape[0] - 1, owner.shape[1] - 1
    for s in range(1, slots + 1):
        largest = second = 0
        for b in range(1, blobs + 1):
            if owner[b, s] and owner[b].sum() == 1 and peak[b] > on:
                if largest == 0 or load[b] > load[largest]:
                    largest, second = b, largest
                elif second == 0 or load[b] > load[second]:
                    second = b
        apart[s - 1] = apart[s - 1] + 1 if second > 0 else 0
        free = 0
        for r in range(slots, 0, -1):
            free = r if not owner[:, r].any() else free
        if apart[s - 1] >= _APART and free > 0:
            owner[second, s], owner[second, free] = False, True
            age[free - 1], apart[s - 1] = 0 if was[free] > 0.0 else 1, 0


@kernel
def _cut(
    reading: Floats,
    low: int,
    high: int,
    first: Indices,
    beside: Indices,
    blob: Indices,
    owner: Bools,
    label: NDArray[np.int8],
    before: Floats,
) -> bool:
    """Bring label up to date: all of a blob to its only owner; among several, from their cores downhill. Whether there
    was such a blob.
    """
    slots = owner.shape[1] - 1
    top = np.zeros((len(owner), slots + 1))
    for k in range(low, high):
        if label[k] > 0:
            top[blob[k], label[k]] = max(top[blob[k], label[k]], before[k])
    shared = False
    for k in range(low, high):
        b, s = blob[k], label[k]
        owners = owner[b].sum()
        core = s > 0 and owner[b, s] and before[k] >= _CORE * top[b, s]
        shared |= owners > 1
        label[k] = (s if core else 0) if owners > 1 else np.argmax(owner[b])
    while shared:
        best, highest, of = -1, -np.inf, 0
        for k in range(low, high):
            if owner[blob[k]].any() and label[k] == 0 and reading[k] > highest:
                steepest, mine = -np.inf, 0
                for j in beside[first[k] : first[k + 1]]:
                    if label[j] > 0 and blob[j] == blob[k] and reading[j] > steepest:
                        steepest, mine = reading[j], label[j]
                if mine > 0:
                    best, highest, of = k, reading[k], mine
        if best < 0:
            break
        label[best] = of
    return shared


@kernel
def _join_flanks(
    reading: Floats,
    low: int,
    high: int,
    first: Indices,
    beside: Indices,
    label: NDArray[np.int8],
    age: NDArray[np.int64],
    flank: NDArray[np.int64],
) -> None:
    """End contacts whose highest taxel has for long lain beside a higher one of another, which takes theirs."""
    for s in range(1, len(age) + 1):
        top, highest, other = -1, 0.0, 0
        for k in range(low, high):
            if label[k] == s and reading[k] > highest:
                top, highest = k, reading[k]
        if top >= 0:
            for j in beside[first[top] : first[top + 1]]:
                if label[j] > 0 and label[j] != s and reading[j] > highest:
                    other = label[j]
        flank[s - 1] = flank[s - 1] + 1 if other > 0 else 0
        if flank[s - 1] >= _APART:
            age[s - 1] = flank[s - 1] = 0
            for k in range(low, high):
                if label[k] == s:
                    label[k] = other


@kernel
def _surround(
    reading: Floats,
    low: int,
    high: int,
    first: Indices,
    beside: Indices,
    labels: NDArray[np.int8],
    age: NDArray[np.int64],
    room: NDArray[np.int8],
) -> None:
    """Give taxels beside a contact to it, the more loaded one first, and set room (slots,)."""
    for s in range(len(age)):
        room[s] = FREE if age[s] > 0 else ABSENT
    for k in range(low, high):
        if labels[k] == 0:
            most = 0.0
            for j in beside[first[k] : first[k + 1]]:
                if labels[j] > 0 and reading[j] > most:
                    most, labels[k] = reading[j], -labels[j]
    for k in range(low, high):
        if labels[k] > 0:
            for j in beside[first[k] : first[k + 1]]:
                if labels[j] != 0 and abs(labels[j]) != labels[k]:
                    near = TOUCHING if labels[j] > 0 else NEAR
                    room[labels[k] - 1] = min(room[labels[k] - 1], near)


@kernel
def _count(blob: Indices, label: NDArray[np.int8], age: NDArray[np.int64], whole: Bools) -> None:
    """Set whole (slots,) for contacts whose taxels all lie in one blob."""
    only = np.zeros(len(age), dtype=np.int64)
    for s in range(len(age)):
        whole[s] = age[s] > 0
    for k in range(len(blob)):
        s = label[k] - 1
        if s >= 0:
            whole[s] &= only[s] in (0, blob[k])
            only[s] = blob[k]
