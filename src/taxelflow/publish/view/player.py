"""Playing a recording: a position in it that moves with the clock, and can be set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Floats


@dataclass
class Player:
    """Position at_s between the times first_s and last_s. Plays from the start again at the end.

    following: of a live source; playing then means to show the newest scan.
    """

    first_s: float = 0.0
    last_s: float = 0.0
    at_s: float = 0.0
    speed: float = 1.0
    playing: bool = True
    following: bool = False

    def extend(self, first_s: float, last_s: float) -> None:
        """More of the recording is known."""
        if self.last_s == self.first_s:
            self.at_s = max(self.at_s, first_s)
        self.first_s, self.last_s = first_s, last_s

    def advance(self, elapsed_s: float) -> None:
        """Time has passed."""
        if not self.playing:
            return
        if self.following:
            self.at_s = self.last_s
            return
        self.at_s += self.speed * elapsed_s
        if self.at_s > self.last_s:
            self.at_s = self.first_s

    def seek(self, at_s: float) -> None:
        """Go to a time."""
        self.at_s = min(max(at_s, self.first_s), self.last_s)

    def step(self, times: Floats, scans: int) -> None:
        """Go forward by a number of scans, or back, and stop there."""
        self.playing = False
        if len(times):
            here = int(np.searchsorted(times, self.at_s + 1e-9, side="right")) - 1
            self.at_s = float(times[min(max(here + scans, 0), len(times) - 1)])

    def jump(self, marks: Sequence[float], *, back: bool) -> None:
        """Go to the next, or the last mark before, and stay if there is none."""
        found = [mark for mark in marks if (mark < self.at_s - 1e-6 if back else mark > self.at_s + 1e-6)]
        if found:
            self.at_s = max(found) if back else min(found)
