"""A sample of a recording that is small whatever its length: windows of consecutive scans, drawn evenly."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats

WINDOW_SCANS = 12
"""Long enough for noise and a steady mean, short enough that an object at rest between motions fills some."""
MOST_WINDOWS = 512


class Sample:
    """Reservoir of windows: each window of the stream is kept with equal probability (Vitter's algorithm R)."""

    def __init__(self, taxels: int) -> None:
        self.seen = 0
        self._random = np.random.default_rng(0)  # a replay draws the same windows
        self.first = np.zeros((0, taxels))
        """The first window of all, (WINDOW_SCANS, taxels), whatever else is kept."""
        self._windows = np.zeros((0, WINDOW_SCANS, taxels))
        self._starts_s = np.zeros(0)
        self._open, self._open_s = np.zeros((0, taxels)), 0.0

    @property
    def windows(self) -> Floats:
        """(windows, WINDOW_SCANS, taxels), in the order drawn; at most MOST_WINDOWS."""
        return self._windows[: min(self.seen, MOST_WINDOWS)]

    @property
    def starts_s(self) -> Floats:
        """(windows,) time of each window's first scan."""
        return self._starts_s[: len(self.windows)]

    @property
    def tail(self) -> tuple[float, Floats]:
        """Scans since the last window, fewer than make one, and the time of the first of them."""
        return self._open_s, self._open

    @property
    def wanted(self) -> int:
        """Scans until the next window is full."""
        return WINDOW_SCANS - len(self._open)

    def add(self, t_s: Floats, values: Floats) -> None:
        """Take (scans, taxels) in time order."""
        if len(self._open):
            t_s = np.concatenate([np.full(len(self._open), self._open_s), t_s])
            values = np.concatenate([self._open, values])
        full = len(values) // WINDOW_SCANS
        for number, window in enumerate(values[: full * WINDOW_SCANS].reshape(full, WINDOW_SCANS, values.shape[1])):
            self._keep(float(t_s[number * WINDOW_SCANS]), window)
        self._open = values[full * WINDOW_SCANS :].copy()
        if len(self._open):
            self._open_s = float(t_s[full * WINDOW_SCANS])

    def close(self) -> None:
        """No more scans: a recording shorter than one window becomes one that ends in NaN."""
        if not self.seen and len(self._open):
            patched = np.concatenate([self._open, np.full((self.wanted, self._open.shape[1]), np.nan)])
            self._keep(self._open_s, patched)
            self._open = self._open[:0]

    def _keep(self, start_s: float, window: Floats) -> None:
        if not self.seen:
            self.first = window.copy()
        place = self.seen
        if self.seen >= MOST_WINDOWS:
            place = int(self._random.integers(self.seen + 1))
        elif self.seen >= len(self._windows):
            room = np.zeros((max(16, len(self._windows)), *window.shape))
            self._windows = np.concatenate([self._windows, room])
            self._starts_s = np.concatenate([self._starts_s, room[:, 0, 0]])
        if place < MOST_WINDOWS:
            self._windows[place], self._starts_s[place] = window, start_s
        self.seen += 1
