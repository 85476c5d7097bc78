"""Whether contacts on one pad move apart, where nobody has asked to tell them apart.

However a rigid object moves, its feet keep their distances. So the blobs of a pad (`blobs.py`) are followed, and the
distance between the centroids of any two, while they do not touch each other or the pad's border, is held against
what it was at first. If it has changed for some scans by more than noise, sampling and the pad's map explain, they
are no parts of one rigid object, for as long as the pad is touched.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.condition.blobs import ABSENT, NEAR, Follower
from taxelflow.messages import Bools, Floats, no_scans

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.layout import Layout
    from taxelflow.messages import Scans

_SLOTS = 4
_FIRST, _LASTING = 5, 5
"""Scans whose mean is a pair's distance at first, and for which another one must last."""
_SIGMAS, _PITCHES = 6.0, 0.5
"""A distance has changed if it differs by so many standard deviations, and by so many pitches."""
_COUNT, _MEAN, _LONG, _PAIR = range(4)


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
            self._pads,
            self._layout.starts,
            self._places,
            self._border,
            self._layout.pitch_m,
            self._layout.stretch,
            self._memory,
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
    pads: NDArray[np.int64],
    starts: NDArray[np.int64],
    places: Floats,
    border: Bools,
    pitch_m: Floats,
    stretch: Floats,
    memory: Floats,
    apart_m: Floats,
    moved: Bools,
    parted: Bools,
) -> None:
    """Raise apart_m (pads watched,) where the distance of two contacts has changed, and set parted (scans, pads) from
    there on. Memory: moved (pads watched,), whether it has; memory (pads watched, slots, slots, 3), of each pair how
    many scans its first distance is from, that distance, and how long another one lasts.
    """
    slots = memory.shape[1]
    place, free = np.zeros((slots, 3)), np.zeros(slots, dtype=np.bool_)
    for scan in range(len(pressure)):
        for number in range(len(pads)):
            pad = pads[number]
            if not contact[scan, pad]:
                moved[number] = False
                memory[number, :, :, :] = 0.0
                continue
            parted[scan, pad] = moved[number]
            if (room[scan, number] >= NEAR).sum() < 2:
                memory[number, :, :, _LONG] = 0.0
                continue
            low, high = starts[pad], starts[pad + 1]
            for s in range(slots):
                free[s] = room[scan, number, s] >= NEAR and complete[scan, pad]
                if free[s]:
                    free[s] = _centroid(pressure[scan], noise, labels[scan], s + 1, low, high, places, border, place[s])
                else:
                    memory[number, s, :, _LONG] = memory[number, :, s, _LONG] = 0.0
                    if room[scan, number, s] == ABSENT:
                        memory[number, s, :, _COUNT] = memory[number, :, s, _COUNT] = 0.0
            for s in range(slots):
                for r in range(s):
                    if free[s] and free[r]:
                        far = _compare(place[s], place[r], pitch_m[pad], stretch[pad], memory[number, s, r])
                        apart_m[number] = max(apart_m[number], far)
                        moved[number] |= far > 0.0
            parted[scan, pad] = moved[number]


@kernel
def _centroid(
    reading: Floats,
    noise: Floats,
    labels: NDArray[np.int8],
    label: int,
    low: int,
    high: int,
    places: Floats,
    border: Bools,
    out: Floats,
) -> bool:
    """Fill out (3,) with a contact's centroid and the variance of each of its coordinates; False if it is cut."""
    total = x = y = variance = 0.0
    for k in range(low, high):
        if labels[k] == label:
            if border[k]:
                return False
            total += reading[k]
            x += reading[k] * places[0, k]
            y += reading[k] * places[1, k]
    out[0], out[1] = x / total, y / total
    for k in range(low, high):
        if labels[k] == label:
            arm2 = (places[0, k] - out[0]) ** 2 + (places[1, k] - out[1]) ** 2
            variance += 0.5 * arm2 * (noise[k] / total) ** 2
    out[2] = variance
    return True


@kernel
def _compare(one: Floats, other: Floats, pitch_m: Floats, stretch: float, m: Floats) -> float:
    """How much the distance of two centroids has surely changed, m; 0 if it may be the same. m: (3,), the pair's."""
    distance = np.hypot(one[0] - other[0], one[1] - other[1])
    if m[_COUNT] < _FIRST:
        m[_COUNT] += 1.0
        m[_MEAN] += (distance - m[_MEAN]) / m[_COUNT]
        return 0.0
    changed = abs(distance - m[_MEAN])
    least = max(_SIGMAS * np.sqrt(one[2] + other[2]), _PITCHES * max(pitch_m[0], pitch_m[1])) + stretch * m[_MEAN]
    m[_LONG] = m[_LONG] + 1.0 if changed > least else 0.0
    return changed if m[_LONG] >= _LASTING else 0.0
