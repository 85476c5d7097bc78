"""A random sample of a recording, of bounded size: windows of consecutive scans, drawn uniformly."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np

from taxelflow.messages import Floats


class _Windows(NamedTuple):
    """Windows of consecutive scans that are kept."""

    scans: int = 12
    """Long enough for noise and a steady mean, short enough that an object at rest between motions fills some."""
    most: int = 512
    """Windows kept at most: enough for the quantiles of noise, and 1 MB for 20 taxels."""


WINDOWS = _Windows()
_MOST_BYTES = 1 << 26
"""Memory that the windows take at most: from 1400 taxels on there are fewer than WINDOWS.most."""


class Sample:
    """Reservoir of windows: each window of the stream is kept with equal probability.

    Algorithm R of J. S. Vitter, Random Sampling with a Reservoir, ACM Transactions on Mathematical Software 11, 1985.
    """

    def __init__(self, taxels: int, *, forgets: bool = False) -> None:
        """forgets: while no reading has ever changed, hold the first window only: the others show nothing more."""
        self.windows_seen = self._doubled_from = 0
        self._alike = forgets
        self._most = max(2, min(WINDOWS.most, _MOST_BYTES // (8 * WINDOWS.scans * max(taxels, 1))))
        self._random = np.random.default_rng(0)  # a replay draws the same windows
        self.first = np.zeros((0, taxels))
        """The first window of all, (WINDOWS.scans, taxels), kept in any case."""
        self._windows: list[Floats] = []  # none is written to: a copy shares them, and a longer list costs nothing
        self._starts_s: list[float] = []
        self._room = np.empty((WINDOWS.scans, taxels))
        self._open, self._open_s = self._room[:0], 0.0
        self._newest = 0.0, self._room

    @property
    def windows(self) -> Floats:
        """(windows, WINDOWS.scans, taxels), in the order drawn; at most WINDOWS.most. Each call copies them."""
        return np.stack(self._windows) if self._windows else self._room[np.newaxis][:0]

    def __len__(self) -> int:
        """Number of windows held."""
        return len(self._windows)

    @property
    def starts_s(self) -> Floats:
        """(windows,) time of each window's first scan."""
        return np.array(self._starts_s)

    @property
    def tail(self) -> tuple[float, Floats]:
        """Scans since the last window, fewer than make one, and the time of the first of them."""
        return self._open_s, self._open

    @property
    def remaining(self) -> int:
        """Scans until the next window is full."""
        return WINDOWS.scans - len(self._open)

    @property
    def until_doubled(self) -> int:
        """Scans until there will have been 1, 2, 4, 8, ... windows, since the last restart if there was any.

        While windows are alike, only the first counts.
        """
        seen = self.windows_seen - self._doubled_from
        return ((1 << seen.bit_length()) - seen - 1) * WINDOWS.scans + self.remaining

    def add(self, t_s: Floats, values: Floats) -> None:
        """Take (scans, taxels) in time order."""
        if len(values) == 1 and 0 < len(self._open) < WINDOWS.scans - 1:
            self._room[len(self._open)] = values[0]
            self._open = self._room[: len(self._open) + 1]
            return
        if len(self._open):
            t_s = np.concatenate([np.full(len(self._open), self._open_s), t_s])
            values = np.concatenate([self._open, values])
        full = len(values) // WINDOWS.scans
        whole = full * WINDOWS.scans
        windows = values[:whole].reshape(full, WINDOWS.scans, values.shape[1])
        for since_s, window in zip(t_s[: whole : WINDOWS.scans].tolist(), windows, strict=True):
            self._keep(since_s, window)
        left = values[whole:]
        self._room = np.empty((WINDOWS.scans, values.shape[1]))  # a new one, as a window or a copy may be part of it
        self._room[: len(left)] = left
        self._open = self._room[: len(left)]
        if len(self._open):
            self._open_s = float(t_s[whole])

    def completed(self, values: Floats) -> tuple[Floats, int]:
        """The windows that scans (scans, taxels) would complete, and how many of their scans are here already."""
        held = len(self._open)
        full = (held + len(values)) // WINDOWS.scans
        joined = np.concatenate([self._open, values[: full * WINDOWS.scans - held]])
        return joined.reshape(full, WINDOWS.scans, values.shape[1]), held

    def restart(self) -> None:
        """Double from 1 again, and hold the newest full window, whether or not it was drawn: it shows a change."""
        self._doubled_from = self.windows_seen
        start_s, window = self._newest
        if self._windows and not any(one is window for one in self._windows):
            place = int(self._random.integers(len(self._windows)))
            self._windows[place], self._starts_s[place] = window, start_s

    def snapshot(self) -> Sample:
        """A copy that later scans leave as it is, made at once however much it holds."""
        held = copy(self)
        held._windows, held._starts_s = self._windows.copy(), self._starts_s.copy()
        return held

    def close(self) -> None:
        """No more scans: a recording shorter than one window becomes one that ends in NaN."""
        if not self.windows_seen and len(self._open):
            patched = np.concatenate([self._open, np.full((self.remaining, self._open.shape[1]), np.nan)])
            self._keep(self._open_s, patched)
            self._open = self._open[:0]

    def _keep(self, start_s: float, window: Floats) -> None:
        if not self.windows_seen:
            self.first = window.copy()
        self._alike = self._alike and np.array_equal(window, np.tile(self.first[0], (len(window), 1)), equal_nan=True)
        if self._alike and self.windows_seen:
            return
        place = self.windows_seen
        window = window.copy()
        self._newest = start_s, window
        if self.windows_seen >= self._most:
            place = int(self._random.integers(self.windows_seen + 1))
        if place < len(self._windows):
            self._windows[place], self._starts_s[place] = window, start_s
        elif place < self._most:
            self._windows.append(window)
            self._starts_s.append(start_s)
        self.windows_seen += 1
