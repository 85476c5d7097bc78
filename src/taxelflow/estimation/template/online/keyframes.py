"""Keyframes of a stream: the scans that its map is estimated from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.online.track_state import KEYFRAMES
from taxelflow.numerics.bspline import pose_part, states_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_GROWN = 0.05
"""Range of the sizes' logarithm."""


@dataclass(slots=True, eq=False)
class Keyframes:
    """Scans that the pattern is learned from, oldest first, with their states (n, 5).

    angled: (n, 5), where they would be if the object turned, as long as nobody knows whether it does.
    """

    scanned: Scanned
    states: Floats
    angled: Floats

    def __len__(self) -> int:
        return len(self.states)

    @property
    def grown(self) -> bool:
        """Whether their sizes differ."""
        return bool(np.ptp(states_of(self.states).size) > _GROWN)

    def spread(self, radius: float) -> float:
        """How far the keyframes lie from one another, in pitches."""
        extent = np.ptp(self.states[:, :2], axis=0)
        return float(max(extent.max(), radius * np.ptp(states_of(self.states).theta)))

    def with_scan(self, t_s: float, reading: Floats, variance: Floats, bend: Floats, state: Floats) -> Keyframes:
        """One more; if there are too many, the one in the most crowded place goes, never the first."""
        old = self.scanned
        states = np.concatenate([self.states, state[np.newaxis]])
        angled = np.concatenate([self.angled, state[np.newaxis]])
        states_of(angled).theta[-1] = states_of(self.angled).theta[-1]
        readings = np.concatenate([old.readings, reading[np.newaxis]])
        variances = np.concatenate([old.variance, variance[np.newaxis]])
        bends = np.concatenate([old.bends, bend[np.newaxis]])
        times = np.append(old.t_s, t_s)
        keep: NDArray[np.int64] = np.arange(len(states))
        if len(states) > KEYFRAMES.most:
            poses = pose_part(states)
            apart = np.abs(poses[:, np.newaxis] - poses[np.newaxis])
            apart = apart.sum(axis=2) + 1e6 * np.eye(len(states))
            crowded = np.sort(apart, axis=1)[:, :3].sum(axis=1)
            crowded[0] = crowded[-1] = np.inf
            keep = np.delete(keep, int(np.argmin(crowded)))
        scanned = replace(old, t_s=times[keep], readings=readings[keep], variance=variances[keep], bends=bends[keep])
        return Keyframes(scanned, states[keep], angled[keep])


def most_whole(keyframes: Keyframes) -> tuple[int, float]:
    """The keyframe least cut by the pad's border, and which share of its load lies there.

    A round contact that is cut looks as if it had an angle.
    """
    load = keyframes.scanned.load()
    share = load[:, keyframes.scanned.edge].sum(axis=1) / np.maximum(load.sum(axis=1), 1e-300)
    best = len(share) - 1 - int(np.argmin(share[::-1]))
    return best, float(share[best])
