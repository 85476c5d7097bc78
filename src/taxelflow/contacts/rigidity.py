"""Rigidity check: whether contacts on one pad move relative to each other.

The feet of a rigid object keep their distances. So the contacts of a pad are tracked (`segmentation.py`), and the
distance between the centroids of any two is compared with what it was at first. If it has changed for some scans by
more than noise, sampling and the flattening of the pad explain, the contacts are not parts of one rigid object, for as
long as the pad is touched.

Centroids also move where feet merge, part, are cut by the border, lift while others touch down, or where load shifts
within them. So a pair starts again where one of the two is not one component, does not overlap its previous self, or
comes near another contact. A distance counts only where neither contact touches the border and both are as wide as they
were, and its change only if it is large compared with their widths.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.contacts.pairs import CheckedPad, Memory, Pair, Place, Shape
from taxelflow.contacts.segmentation import NEAR, ContactState, ContactTracker, Labels
from taxelflow.messages import Bools, Floats, cut, no_scans
from taxelflow.numerics.records import Records, records
from taxelflow.numerics.rounding import CERTAIN
from taxelflow.runtime.compiling import announced, kernel, routine

if TYPE_CHECKING:
    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout

_SLOTS = 4
"""Contacts tracked on a pad at most: 6 pairs."""


class _Distance(NamedTuple):
    """When the distance of two contacts has changed."""

    scans: int = 5
    """Scans whose mean is the reference distance of a pair, and for which in a row it must have changed: a load that
    shifts for a moment moves a centroid too."""
    pitches: float = 0.5
    widths: float = 0.25
    """A distance has changed if it differs certainly, by this many pitches (sampling moves centroids by less), and by
    this share of the sum of the two widths. On the rig, feet of any size, noise and growth stay below 0.13 of it."""
    width_ratio: float = 1.25
    """Largest ratio of two widths (radius of gyration) that count as the same: a contact that grows moves its
    centroid."""


_DISTANCE = _Distance()


class RigidityMonitor:
    """Checks all pads, as the rows of a pad are of all its load, also where its contacts are split; while none has
    several components there is nothing to check.
    """

    def __init__(self, layout: Layout, on: float, off: float, *, at_once: bool = False) -> None:
        """on, off: see `Conditioner.contact_on` and `contact_off`. at_once: compile what several components need now,
        not when they come.
        """
        self._layout = layout
        self._single = True
        self._scans = np.zeros(len(layout.pads), dtype=np.int64)
        pads = np.arange(layout.pad_count)
        self._tracker = ContactTracker(layout, pads, np.full(len(pads), _SLOTS), on, off) if len(pads) else None
        self._memory = Memory(
            pads=records(CheckedPad, len(pads)),
            pairs=records(Pair, len(pads), _SLOTS, _SLOTS),
            places=records(Place, layout.taxels),
            shapes=records(Shape, _SLOTS),
        )
        own, places = self._memory.pads, self._memory.places
        own["pad"], own["start"], own["stop"] = pads, layout.starts[pads], layout.starts[pads + 1]
        own["pitch_m"], own["stretch"] = layout.pitch_m[pads].max(axis=1), layout.stretch[pads]
        places["x"], places["y"] = layout.x_m[: layout.taxels], layout.y_m[: layout.taxels]
        places["border"] = layout.border[: layout.taxels].any(axis=1)
        nothing = no_scans(layout.entries, len(layout.pads))
        self.step(nothing)  # compiles
        if at_once and self._tracker is not None:
            self._check(self._tracker, nothing, self.step(nothing))

    @property
    def notes(self) -> list[str]:
        """A sentence for each pad on which contacts that are not split have moved apart, with the number of its scans
        since.
        """
        own = self._memory.pads[self._memory.pads["change_m"] > 0.0]
        own = own[~np.isin(own["pad"], self._layout.contact_of)]
        return [
            f"{name}: contacts moved apart or together by {1e3 * change_m:.2g} mm, which feet of one rigid object do "
            f"not: {scans} scans without an ok pose; if they move independently, --contacts {name}=2 separates them"
            for name, change_m, scans in zip(
                [self._layout.pads[pad] for pad in own["pad"]], own["change_m"], self._scans[own["pad"]], strict=True
            )
        ]

    def step(self, scans: Scans) -> Bools:
        """(scans, pads, groups and contacts), where contacts have moved apart since the pad was touched; these scans
        follow those of the last call.
        """
        moved_apart = np.zeros(scans.contact.shape, dtype=np.bool_)
        if self._tracker is None:
            return moved_apart
        start = self._tracker.step_single(scans, self._memory.places) if self._single else 0
        self._single = self._single and start == len(scans)
        if not self._single:
            with announced():
                self._check(self._tracker, cut(scans, start, len(scans)) if start else scans, moved_apart[start:])
                self._single = self._tracker.is_single() and not has_pairs(self._memory)
        return moved_apart

    def _check(self, tracker: ContactTracker, scans: Scans, moved_apart: Bools) -> None:
        found = tracker.step(scans)
        pressure, noise, contact, complete = scans.pressure, scans.noise, scans.contact, scans.complete
        check_rigidity(pressure, noise, contact, complete, found.labels, found.contacts, self._memory, moved_apart)
        if np.count_nonzero(moved_apart):
            self._scans += np.count_nonzero(moved_apart, axis=0)


@kernel
def check_rigidity(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    labels: Labels,
    contacts: Records,
    memory: Memory,
    moved_apart: Bools,
) -> None:
    """Set moved_apart (scans, pads), which comes in False; bring memory up to date.

    pressure: (scans, entries). noise: (entries,). contact, complete: (scans, pads). labels, contacts: see
    `Segmentation`.
    """
    for scan in range(len(pressure)):
        for number in range(len(memory.pads)):
            pad: CheckedPad = memory.pads[number]
            if not contact[scan, pad.pad]:
                _reset(number, memory)
            elif complete[scan, pad.pad]:
                _measure_contacts(pressure[scan], noise, labels[scan], contacts[scan, number], number, memory)
                _compare_pairs(number, memory)
            else:
                _interrupt_all(memory.pairs[number])
            moved_apart[scan, pad.pad] = pad.moved_apart


@kernel
def has_pairs(memory: Memory) -> bool:
    """Whether any pair is being compared, or contacts of a pad that is touched have moved apart."""
    for number in range(len(memory.pads)):
        apart: bool = memory.pads[number].moved_apart
        for k in range(_SLOTS * _SLOTS):
            apart |= memory.pairs[number, k // _SLOTS, k % _SLOTS].scans > 0
        if apart:
            return True
    return False


@routine
def _reset(number: int, memory: Memory) -> None:
    """The pad is not in contact."""
    pad: CheckedPad = memory.pads[number]
    pad.moved_apart = False
    for k in range(pad.start, pad.stop):
        memory.places[k].last_label = 0
    for slot in range(_SLOTS):
        _forget(slot, memory.pairs[number])


@routine
def _forget(slot: int, pairs: Records) -> None:
    """The pairs of one contact start again. pairs: (slots, slots), the later slot first."""
    for other in range(_SLOTS):
        pair: Pair = pairs[max(slot, other), min(slot, other)]
        pair.scans = pair.changed_scans = 0
        pair.distance_m = pair.width_m = pair.other_width_m = 0.0


@routine
def _interrupt_all(pairs: Records) -> None:
    """No contact can be measured in this scan: every pair's change must last again."""
    for slot in range(_SLOTS):
        _interrupt(slot, pairs)


@routine
def _interrupt(slot: int, pairs: Records) -> None:
    """The distances of one contact do not count in this scan."""
    for other in range(_SLOTS):
        pairs[max(slot, other), min(slot, other)].changed_scans = 0


@routine
def _measure_contacts(
    reading: Floats, noise: Floats, labels: Labels, contacts: Records, number: int, memory: Memory
) -> None:
    """Measure the contacts of one pad whose distances count; the pairs of others are interrupted or start again."""
    pad, pairs = memory.pads[number], memory.pairs[number]
    for slot in range(_SLOTS):
        state: ContactState = contacts[slot]
        shape: Shape = memory.shapes[slot]
        overlaps, cut = _find_overlap(slot + 1, labels, pad, memory.places)
        same = state.connected and state.clearance >= NEAR and overlaps
        shape.measured = same and not cut
        if shape.measured:
            _measure(slot + 1, reading, noise, labels, pad, memory.places, shape)
        elif same:
            _interrupt(slot, pairs)
        else:
            _forget(slot, pairs)
    for k in range(pad.start, pad.stop):
        memory.places[k].last_label = labels[k]


@routine
def _find_overlap(label: int, labels: Labels, pad: CheckedPad, places: Records) -> tuple[bool, bool]:
    """Whether a contact loads a taxel that it loaded in the previous scan, and whether it reaches the pad's border."""
    overlaps = cut = False
    for k in range(pad.start, pad.stop):
        if labels[k] == label:
            overlaps |= places[k].last_label == label
            cut |= places[k].border
    return overlaps, cut


@routine
def _measure(
    label: int, reading: Floats, noise: Floats, labels: Labels, pad: CheckedPad, places: Records, shape: Shape
) -> None:
    """Centroid, its variance by noise, and width of one contact."""
    total = x = y = variance = spread = 0.0
    for k in range(pad.start, pad.stop):
        if labels[k] == label:
            total += reading[k]
            x += reading[k] * places[k].x
            y += reading[k] * places[k].y
    shape.x, shape.y = x / total, y / total
    for k in range(pad.start, pad.stop):
        if labels[k] == label:
            arm2 = (places[k].x - shape.x) ** 2 + (places[k].y - shape.y) ** 2
            variance += 0.5 * arm2 * (noise[k] / total) ** 2
            spread += arm2 * reading[k] / total
    shape.variance, shape.width_m = variance, np.sqrt(spread)


@routine
def _compare_pairs(number: int, memory: Memory) -> None:
    pad: CheckedPad = memory.pads[number]
    for slot in range(_SLOTS):
        for other in range(slot):
            if memory.shapes[slot].measured and memory.shapes[other].measured:
                pair = memory.pairs[number, slot, other]
                change_m = _significant_change(memory.shapes[slot], memory.shapes[other], pad, pair)
                pad.change_m = max(pad.change_m, change_m)
                pad.moved_apart |= change_m > 0.0


@routine
def _significant_change(one: Shape, other: Shape, pad: CheckedPad, pair: Pair) -> float:
    """How much the distance of two contacts has changed, m; 0 if noise, sampling or load may explain it."""
    distance_m = np.hypot(one.x - other.x, one.y - other.y)
    if pair.scans < _DISTANCE.scans:
        pair.scans += 1
        pair.distance_m += (distance_m - pair.distance_m) / pair.scans
        pair.width_m += (one.width_m - pair.width_m) / pair.scans
        pair.other_width_m += (other.width_m - pair.other_width_m) / pair.scans
        return 0.0
    same = _same_width(one.width_m, pair.width_m) and _same_width(other.width_m, pair.other_width_m)
    change_m = abs(distance_m - pair.distance_m)
    by_noise_m = CERTAIN * np.sqrt(one.variance + other.variance)
    by_width_m = _DISTANCE.widths * (pair.width_m + pair.other_width_m)
    least_m = max(by_noise_m, _DISTANCE.pitches * pad.pitch_m, by_width_m) + pad.stretch * pair.distance_m
    pair.changed_scans = pair.changed_scans + 1 if same and change_m > least_m else 0
    return change_m if pair.changed_scans >= _DISTANCE.scans else 0.0


@routine
def _same_width(one: float, other: float) -> bool:
    return bool(one <= _DISTANCE.width_ratio * other and other <= _DISTANCE.width_ratio * one)
