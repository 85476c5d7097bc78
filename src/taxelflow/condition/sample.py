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
        self._open = np.zeros((0, taxels))

    @property
    def windows(self) -> Floats:
        """(windows, WINDOW_SCANS, taxels), in the order drawn; at most MOST_WINDOWS."""
        return self._windows[: min(self.seen, MOST_WINDOWS)]

    @property
    def wanted(self) -> int:
        """Scans until the next window is full."""
        return WINDOW_SCANS - len(self._open)

    def add(self, values: Floats) -> None:
        """Take (scans, taxels) in time order."""
        values = np.concatenate([self._open, values]) if len(self._open) else values
        full = len(values) // WINDOW_SCANS
        for window in values[: full * WINDOW_SCANS].reshape(full, WINDOW_SCANS, values.shape[1]):
            self._keep(window)
        self._open = values[full * WINDOW_SCANS :].copy()

    def close(self) -> None:
        """No more scans: a recording shorter than one window becomes one that ends in NaN."""
        if not self.seen and len(self._open):
            self._keep(np.concatenate([self._open, np.full((self.wanted, self._open.shape[1]), np.nan)]))

    def _keep(self, window: Floats) -> None:
        if not self.seen:
            self.first = window.copy()
        place = self.seen
        if self.seen >= MOST_WINDOWS:
            place = int(self._random.integers(self.seen + 1))
        elif self.seen >= len(self._windows):
            room = np.zeros((max(16, len(self._windows)), *window.shape))
            self._windows = np.concatenate([self._windows, room])
        if place < MOST_WINDOWS:
            self._windows[place] = window
        self.seen += 1
