"""Latencies of a run of any length in constant memory: a histogram with logarithmic bins."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats


@dataclass(frozen=True, slots=True)
class _Bins:
    """Bins of the histogram."""

    least_s: float = 1e-6
    most_s: float = 1e3
    """Range of the histogram; times outside count in its first and last bin."""
    per_decade: int = 40
    """Bins of 6 %."""


_BINS = _Bins()
_MANY = 8
"""From here on NumPy is quicker."""


class Latencies:
    """Counts of durations in s."""

    def __init__(self) -> None:
        self._counts = np.zeros(math.ceil(_BINS.per_decade * math.log10(_BINS.most_s / _BINS.least_s)) + 1, np.int64)
        self.longest_s = 0.0

    def add(self, seconds: float) -> None:
        """One more."""
        place = _BINS.per_decade * math.log10(max(seconds, _BINS.least_s) / _BINS.least_s)
        self._counts[min(int(place), len(self._counts) - 1)] += 1
        self.longest_s = max(self.longest_s, seconds)

    def add_all(self, seconds: Floats) -> None:
        """Those of several scans."""
        if len(seconds) < _MANY:
            for one in seconds.tolist():
                self.add(one)
            return
        place = _BINS.per_decade * np.log10(np.maximum(seconds, _BINS.least_s) / _BINS.least_s)
        np.add.at(self._counts, np.minimum(place.astype(np.int64), len(self._counts) - 1), 1)
        self.longest_s = max(self.longest_s, float(seconds.max()))

    def __len__(self) -> int:
        return int(self._counts.sum())

    def quantile_s(self, share: float) -> float:
        """Upper edge of the bin in which this share of all is reached; NaN if there is none."""
        if not len(self):
            return math.nan
        number = int(np.searchsorted(np.cumsum(self._counts), share * len(self)))
        return min(_BINS.least_s * 10 ** ((number + 1) / _BINS.per_decade), self.longest_s)

    def decades(self) -> list[tuple[float, float, int]]:
        """From, to in s and count, for thirds of decades that are not empty at the ends."""
        third = _BINS.per_decade // 4
        sums = np.add.reduceat(self._counts, np.arange(0, len(self._counts), third))
        used = np.flatnonzero(sums)
        if not len(used):
            return []
        edge = [_BINS.least_s * 10 ** (k * third / _BINS.per_decade) for k in range(len(sums) + 1)]
        return [(edge[k], edge[k + 1], int(sums[k])) for k in range(int(used[0]), int(used[-1]) + 1)]

    def words(self) -> str:
        """Median, 99th percentile and largest, in ms."""
        if not len(self):
            return "unknown"
        p50, p99 = (1e3 * self.quantile_s(share) for share in (0.5, 0.99))
        return f"p50 {_short(p50)} ms, p99 {_short(p99)} ms, max {_short(1e3 * self.longest_s)} ms"


def _short(number: float) -> str:
    """Three digits, or all before the point."""
    return f"{number:.0f}" if number >= 1e3 else f"{number:.3g}"
