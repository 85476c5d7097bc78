"""A pattern in a stream, and what goes with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.hypotheses import FIRST_GAIN_STD
from taxelflow.estimation.template.observations import COARSE, strength

if TYPE_CHECKING:
    from taxelflow.estimation.template.anchor import Anchor
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.online.keyframes import Keyframes
    from taxelflow.messages import Floats

FIRST_SLACK = (0.0025, 0.0025)
"""Before anything is known of how good a pattern is: pitches^2, rad^2."""
_NOTHING, _CLEARLY = 10.0, 3.0
"""Scans of less strength may be noise; one that is stronger by this factor is not."""
_MATURE, _SETTLED = 10, 0.05
"""Keyframes, and variance in pitches^2, from and up to which a pattern is known well."""


@dataclass(slots=True, eq=False)
class Learned:
    """A pattern and what goes with it.

    keyframes: it was learned from, their states in its frame. gains: (taxels,), of the pad's taxels. usual: chi-square
    per reading of a scan that fits. slack: (2,) how wrong poses on the pattern before have been, variance of x and y
    (pitches^2) and of theta (rad^2). tilt, rival: variance of x and y, pitches^2, that a tilt of the load, and another
    hypothesis, may explain. fresh: how many of the last keyframes were registered on the pattern before. taken: scans
    that have ever been keyframes. looked: how many had been when the hypotheses were last compared. turned: by how much
    its theta differs from that of the pattern before. error: see `Scanned.with_error`. gain_std: from scan to scan.
    turns, grows, shown: see `Solved`. reports_turn: whether fits have agreed well enough on it. changing: it does not
    stay the same, and only the last keyframes count. unseen_error: see `Layout`. origin: (2,) in pitches, added to what
    is reported: the frame of a pattern that grows is at the point that stays. arm: (3, 2), see `arm_on_map`, when
    its contact ended. anchor: of the keyframes, see `anchor_of`. hidden: see `Solved`; decided: whether it is known.
    """

    pattern: Pattern
    keyframes: Keyframes
    radius: float
    gains: Floats
    error: float = COARSE
    usual: float = 1.0
    gain_std: float = FIRST_GAIN_STD
    turns: bool = False
    grows: bool = False
    shown: bool = True
    reports_turn: bool = False
    changing: bool = False
    turned: float = 0.0
    slack: Floats = field(default_factory=lambda: np.array(FIRST_SLACK))
    unseen_error: float = 0.0
    tilt: float = 0.0
    rival: float = 0.0
    origin: Floats = field(default_factory=lambda: np.zeros(2))
    arm: Floats = field(default_factory=lambda: np.zeros((3, 2)))
    anchor: Anchor | None = None
    hidden: Floats = field(default_factory=lambda: np.zeros(2))
    decided: bool = False
    fresh: int = 0
    taken: int = 1
    looked: int = 0

    @property
    def scanned(self) -> Scanned:
        """The keyframes' scans, divided by the taxels' gains."""
        scanned = self.keyframes.scanned
        return scanned.divided(self.gains) if (self.gains != 1.0).any() else scanned

    @property
    def undecided(self) -> bool:
        """Whether there may be a direction in which no reading shows a motion: only a map shows that there is none."""
        return self.unseen_error > 0.0 and not self.decided

    @property
    def unseen(self) -> float:
        """Variance of x and y, in pitches^2, that does not show in the residuals."""
        return self.tilt + self.rival

    @property
    def mature(self) -> bool:
        """Whether the pattern is known well enough to look for it elsewhere."""
        known = len(self.keyframes) >= _MATURE and self.slack[0] < _SETTLED
        return not self.changing and known and self.error <= COARSE

    def is_noise_beside(self, reading: Floats, variance: Floats) -> bool:
        """Whether it was learned from hardly more than noise, and a scan (taxels,) is clearly more."""
        before = strength(self.keyframes.scanned.readings, variance).max()  # noise may have been known badly then
        now = strength(reading, variance)
        return bool(before < min(_NOTHING, now / _CLEARLY))
