"""Whether contacts on one pad move apart, where nobody has asked to tell them apart.

However a rigid object moves, its feet keep their distances. So the blobs of a pad (`blobs.py`) are followed, and the
distance between the centroids of any two is held against what it was at first. If it has changed for some scans by
more than noise, sampling and the pad's map explain, they are no parts of one rigid object, for as long as the pad is
touched.

Centroids also move where feet merge, part, are cut by the border, lift while others come down, or where load shifts
within them. So a pair begins anew where one of the two is not one blob that overlaps what it was, or touches another.
A distance counts only where neither touches the border and both are as wide as they were, and a change of it only if
it is large beside them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.contacts.segmentation import NEAR, Follower
from taxelflow.messages import Bools, Floats, no_scans

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout

_SLOTS = 4
_FIRST, _LASTING = 5, 5
"""Scans whose mean is a pair's distance at first, and for which another one must last."""
_SIGMAS, _PITCHES, _WIDTHS = 6.0, 0.5, 0.25
"""A distance has changed if it differs by so many standard deviations, so many pitches, and so much of the sum of the
two widths. Feet on the rig, whatever their size, noise and growth, stay below 0.13 of it."""
_SAME = 1.25
"""Factor within which a width (radius of gyration) is the same."""
_COUNT, _MEAN, _LONG, _WIDE, _OTHER, _PAIR = range(6)
_VARIANCE, _WIDTH = 2, 3


class Watch:
    """Watches the pads whose contacts are not told apart."""

    def __init__(self, layout: Layout, on: float, off: float) -> None:
        """on, off: see `Conditioner.contact_on` and `contact_off`."""
        self._layout = layout
        self._pads = np.setdiff1d(np.arange(layout.pad_count), layout.contact_of)
        slots = np.full(len(self._pads), _SLOTS)
        self._follower = Follower(layout, self._pads, slots, on, off) if len(self._pads) else None
        self._places = np.stack([layout.x_m[: layout.taxels], layout.y_m[: layout.taxels]])
        self._border: Bools = np.asarray(layout.border[: layout.taxels].any(axis=1))
        self._memory = np.zeros((len(self._pads), _SLOTS, _SLOTS, _PAIR))
        self._before = np.zeros(layout.taxels, dtype=np.int8)
        self._apart_m = np.zeros(len(self._pads))
        self._parted = np.zeros(len(self._pads), dtype=np.bool_)
        self.step(no_scans(layout.entries, len(layout.pads)))  # compiles

    @property
    def notes(self) -> list[str]:
        """A sentence for each pad on which contacts have moved apart."""
        names = [self._layout.pads[pad] for pad in self._pads]
        return [
            f"{name}: contacts moved apart or together by {1e3 * apart_m:.2g} mm, which feet of one rigid object do "
            f"not; if they move independently, --contacts {name}=2 tells them apart"
            for name, apart_m in zip(names, self._apart_m.tolist(), strict=True)
            if apart_m > 0
        ]

    def step(self, scans: Scans) -> Bools:
        """(scans, pads, groups and contacts), where contacts have moved apart since the pad was touched; these scans
        follow those of the last call.
        """
        parted = np.zeros(scans.contact.shape, dtype=np.bool_)
        if self._follower is None:
            return parted
        followed = self._follower.step(scans)
        watch(
            scans.pressure,
            scans.noise,
            scans.contact,
            scans.complete,
            followed.labels,
            followed.room,
            followed.whole,
            self._pads,
            self._layout.starts,
            self._places,
            self._border,
            self._layout.pitch_m,
            self._layout.stretch,
            self._memory,
            self._before,
            self._apart_m,
            self._parted,
            parted,
        )
        return parted


@kernel
def watch(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    labels: NDArray[np.int8],
    room: NDArray[np.int8],
    whole: Bools,
    pads: NDArray[np.int64],
    starts: NDArray[np.int64],
    places: Floats,
    border: Bools,
    pitch_m: Floats,
    stretch: Floats,
    memory: Floats,
    before: NDArray[np.int8],
    apart_m: Floats,
    moved: Bools,
    parted: Bools,
) -> None:
    """Raise apart_m (pads watched,) where the distance of two contacts has changed, and set parted (scans, pads) from
    there on. Memory: before (taxels,), labels of the last scan; moved (pads watched,), whether it has; memory (pads
    watched, slots, slots, 5), of each pair how many scans its first distance is from, that distance, how long another
    one lasts, and how wide the two were at first.
    """
    slots = memory.shape[1]
    place, free = np.zeros((slots, 4)), np.zeros(slots, dtype=np.bool_)
    for scan in range(len(pressure)):
        for number in range(len(pads)):
            pad = pads[number]
            low, high = starts[pad], starts[pad + 1]
            if not contact[scan, pad]:
                moved[number] = False
                memory[number, :, :, :] = 0.0
                before[low:high] = 0
                continue
            parted[scan, pad] = moved[number]
            if not complete[scan, pad]:
                memory[number, :, :, _LONG] = 0.0
                continue
            for s in range(slots):
                same = whole[scan, number, s] and room[scan, number, s] >= NEAR
                overlaps, cut = _look(labels[scan], before, s + 1, low, high, border)
                same &= overlaps
                free[s] = same and not cut
                if free[s]:
                    _measure(pressure[scan], noise, labels[scan], s + 1, low, high, places, place[s])
                elif same:
                    memory[number, s, :, _LONG] = memory[number, :, s, _LONG] = 0.0
                else:
                    memory[number, s] = memory[number, :, s] = 0.0
            before[low:high] = labels[scan, low:high]
            for s in range(slots):
                for r in range(s):
                    if free[s] and free[r]:
                        far = _compare(place[s], place[r], pitch_m[pad], stretch[pad], memory[number, s, r])
                        apart_m[number] = max(apart_m[number], far)
                        moved[number] |= far > 0.0
            parted[scan, pad] = moved[number]


@kernel
def _look(
    labels: NDArray[np.int8], before: NDArray[np.int8], label: int, low: int, high: int, border: Bools
) -> tuple[bool, bool]:
    """Whether a contact loads a taxel that it loaded before, and whether it reaches the pad's border."""
    overlaps = cut = False
    for k in range(low, high):
        if labels[k] == label:
            overlaps |= before[k] == label
            cut |= border[k]
    return overlaps, cut


@kernel
def _measure(
    reading: Floats,
    noise: Floats,
    labels: NDArray[np.int8],
    label: int,
    low: int,
    high: int,
    places: Floats,
    out: Floats,
) -> None:
    """Fill out (4,) with a contact's centroid, the variance of each of its coordinates, and its radius of gyration."""
    total = x = y = variance = spread = 0.0
    for k in range(low, high):
        if labels[k] == label:
            total += reading[k]
            x += reading[k] * places[0, k]
            y += reading[k] * places[1, k]
    out[0], out[1] = x / total, y / total
    for k in range(low, high):
        if labels[k] == label:
            arm2 = (places[0, k] - out[0]) ** 2 + (places[1, k] - out[1]) ** 2
            variance += 0.5 * arm2 * (noise[k] / total) ** 2
            spread += arm2 * reading[k] / total
    out[_VARIANCE], out[_WIDTH] = variance, np.sqrt(spread)


@kernel
def _compare(one: Floats, other: Floats, pitch_m: Floats, stretch: float, m: Floats) -> float:
    """How much the distance of two contacts (4,) has surely changed, m; 0 if it may be the same. m: the pair's (5,)."""
    distance = np.hypot(one[0] - other[0], one[1] - other[1])
    if m[_COUNT] < _FIRST:
        m[_COUNT] += 1.0
        m[_MEAN] += (distance - m[_MEAN]) / m[_COUNT]
        m[_WIDE] += (one[_WIDTH] - m[_WIDE]) / m[_COUNT]
        m[_OTHER] += (other[_WIDTH] - m[_OTHER]) / m[_COUNT]
        return 0.0
    same = _alike(one[_WIDTH], m[_WIDE]) and _alike(other[_WIDTH], m[_OTHER])
    changed = abs(distance - m[_MEAN])
    noise = _SIGMAS * np.sqrt(one[_VARIANCE] + other[_VARIANCE])
    least = max(noise, _PITCHES * max(pitch_m[0], pitch_m[1]), _WIDTHS * (m[_WIDE] + m[_OTHER])) + stretch * m[_MEAN]
    m[_LONG] = m[_LONG] + 1.0 if same and changed > least else 0.0
    return changed if m[_LONG] >= _LASTING else 0.0


@kernel
def _alike(one: float, other: float) -> bool:
    return bool(one <= _SAME * other and other <= _SAME * one)
