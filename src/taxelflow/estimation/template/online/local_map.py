"""The local map of a stream: a pattern, its keyframes, and what is known of their errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.estimation.template.initialization import FIRST_GAIN_STD
from taxelflow.estimation.template.observations import COARSE, strength
from taxelflow.estimation.template.online.track_state import FAINT
from taxelflow.estimation.template.solution import ALL_SHOWN

if TYPE_CHECKING:
    from taxelflow.estimation.template.centre_of_pressure import Anchor
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.estimation.template.online.keyframes import Keyframes
    from taxelflow.estimation.template.solution import Hidden
    from taxelflow.messages import Floats


class _Slack(NamedTuple):
    """Slack of a map: the variance of poses by its error, pitches^2 and rad^2."""

    first: float = 0.0025
    """Of a map that is not known yet."""
    reported: float = 0.1
    """Share of the first slack from which on a turn is reported: that of a pattern on which two more fits have
    agreed."""
    cut: float = 0.5
    """What is added to the first slack, times the share of the load that lies at the border."""
    most: tuple[float, float] = (1.0, 0.3)
    forget: float = 0.2
    """Largest slack; and what stays of that before when keyframes have hardly moved."""


SLACK = _Slack()
_NOTHING = 10.0
"""Scans of less strength may be noise; one that is stronger by `FAINT` is not."""


class _Known(NamedTuple):
    """When a pattern is known well."""

    keyframes: int = 10
    variance: float = 0.05
    """Keyframes, and variance in pitches^2, from and up to which a pattern is known well."""


_KNOWN = _Known()


@dataclass(slots=True, eq=False)
class LocalMap:
    """A pattern, its keyframes, and what has been estimated with it; lengths in pitches."""

    pattern: Pattern
    keyframes: Keyframes
    """Those that the pattern was estimated from, with states in its frame."""
    radius: float
    """Of gyration of the pattern."""
    gains: Floats
    """(taxels,), of the pad's taxels; infinite if dead."""
    error: float = COARSE
    """See `Scanned.with_error`."""
    usual: float = 1.0
    """Chi-square per reading of a scan that fits."""
    gain_std: float = FIRST_GAIN_STD
    """Standard deviation of the scans' gains."""
    turns: bool = False
    grows: bool = False
    shown: bool = True
    """See `Solved`."""
    reports_turn: bool = False
    """Whether fits have agreed well enough on the turn, while no other hypothesis that explains as much was far."""
    changing: bool = False
    """Whether the pattern does not stay the same: only the last keyframes count."""
    turned: float = 0.0
    """Angle of this frame from that of the map before."""
    slack: Floats = field(default_factory=lambda: np.full(2, SLACK.first))
    """(2,), variance of x and y, and of theta, by the error of the map: how far poses on the map before were off."""
    unseen_error: float = 0.0
    """See `Layout`."""
    tilt: Floats = field(default_factory=lambda: np.zeros(3))
    """Covariance of x and y that a tilt of the load may explain, xx, xy and yy where the object is at angle 0, ..."""
    rival: Floats = field(default_factory=lambda: np.zeros(2))
    """(2,), ... and of x and y, and of theta, that another hypothesis may."""
    origin: Floats = field(default_factory=lambda: np.zeros(2))
    """(2,), added to what is reported: the frame of a pattern that grows is at its fixed point."""
    arm: Floats = field(default_factory=lambda: np.zeros((3, 2)))
    """(3, 2), see `arm_on_map`, at the end of the contact."""
    anchor: Anchor | None = None
    """Of the keyframes, see `anchor_of`."""
    hidden: Hidden = ALL_SHOWN
    decided: bool = False
    """See `Solved`, and whether it is known, ..."""
    tested: int = 0
    """... and how many scans had been keyframes when it was found."""
    fresh: int = 0
    """Number of the last keyframes that were registered to the map before."""
    until_s: float = -inf
    """Time of the newest scan that it was learned from, though that is no keyframe any more."""
    taken: int = 1
    """Scans that have ever been keyframes, ..."""
    looked: int = 0
    """... and how many of them when the hypotheses were last compared."""

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
    def loose_gain_std(self) -> float:
        """How far the gain may move from scan to scan, as a share of it."""
        return 3.0 * self.gain_std

    @property
    def mature(self) -> bool:
        """Whether the pattern is known well enough to look for it elsewhere."""
        known = len(self.keyframes) >= _KNOWN.keyframes and self.slack[0] < _KNOWN.variance
        return not self.changing and known and self.error <= COARSE

    def is_noise_beside(self, reading: Floats, variance: Floats) -> bool:
        """Whether the keyframes are hardly more than noise, and a scan (taxels,) is clearly more."""
        before = strength(self.keyframes.scanned.readings, variance).max()  # noise may have been known badly then
        now = strength(reading, variance)
        return bool(before < min(_NOTHING, now / FAINT))
