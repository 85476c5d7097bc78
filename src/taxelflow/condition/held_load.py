"""Offsets that hold a load: readings fall below them by as much as loads are large.

Without load a taxel reads the least that it ever does, apart from noise, drift, and a skin that relaxes. Readings far
below an offset, on the scale of the loads above it, show that something lay on the pad when the offset was learned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import CERTAIN


class _Fall(NamedTuple):
    """Readings below the offsets that count."""

    taxels: int = 2
    """Taxels that must fall: a single one may be faulty."""
    share: float = 0.25
    """Share of the largest rise above the offsets that they must fall by: a skin that relaxes after a load, or bulges
    beside it, falls by less. A load that moves on falls by about as much as it rises elsewhere."""
    deeper: float = 2.0
    """Factor by which readings must fall deeper than before to be judged again: bounded work."""


_FALL = _Fall()


def holds_load(offset: Floats, windows: Floats, noise: Floats, masked: Bools) -> bool:
    """Whether an offset (taxels,) of a pad holds a load, by windows (windows, scans, taxels) of the pad.

    noise, masked: (taxels,). All readings of a taxel in some window are certainly below its offset, by more than a
    share of what any taxel rises above its own one. Windows in which all readings are equal are left out: they may be
    those of a sensor that has failed for a while.
    """
    live = ~masked
    used = windows[:, :, live]
    most, least = np.fmax.reduce(used, axis=1), np.fmin.reduce(used, axis=1)  # (windows, taxels)
    alive = np.fmax.reduce(most, axis=1, initial=-np.inf) > np.fmin.reduce(least, axis=1, initial=np.inf)
    with np.errstate(over="ignore"):
        fall = offset[live] - np.fmin.reduce(most[alive], axis=0, initial=np.inf)
        rise = float(np.max(np.fmax.reduce(least, axis=0, initial=-np.inf) - offset[live], initial=0.0))
    falls = fall > np.maximum(CERTAIN * noise[live], _FALL.share * rise)
    return int(np.count_nonzero(falls)) >= _FALL.taxels


def withdrawn_note(until_s: dict[str, float]) -> str:
    """A note on pads, by name, whose first offsets counted until these times; empty if there are none."""
    if not until_s:
        return ""
    pads = ", ".join(f"{name} until {t_s:.3f} s" for name, t_s in until_s.items())
    return (
        f"the first offsets were too high by what was read later, so contact may be missing or wrong: {pads}; an object"
        " lay there at the start, or the sensor drifted: start without load, or declare full_scale in the sensor file"
    )


class FallWatch:
    """Finds the windows of a stream whose readings lie deeper below the offsets than any before."""

    def __init__(self) -> None:
        self._offset: Floats | None = None
        self._per_noise = np.zeros(0)
        self._limit = CERTAIN

    def find(self, windows: Floats, offset: Floats, noise: Floats, live: Bools) -> int | None:
        """The first of windows (windows, scans, taxels) that does, if any; it counts as judged.

        offset, noise: (taxels,), another array where they have changed. live: (taxels,), those whose offset is known.
        """
        if offset is not self._offset:
            self._offset, self._limit = offset, CERTAIN
            self._per_noise = np.divide(1.0, noise, where=live, out=np.zeros(len(live)))
        with np.errstate(over="ignore", invalid="ignore"):
            depth = (offset - np.fmax.reduce(windows, axis=1)) * self._per_noise
        deeper = np.flatnonzero(np.count_nonzero(depth > self._limit, axis=1) >= _FALL.taxels)
        if not len(deeper):
            return None
        deepest = np.partition(np.nan_to_num(depth[deeper[0]], nan=0.0), -_FALL.taxels)
        self._limit = _FALL.deeper * float(deepest[-_FALL.taxels])
        return int(deeper[0])
