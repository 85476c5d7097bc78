"""A slip faster than the scans: the object breaks away, almost loses touch, and is held again elsewhere.

A load that leaps is another contact to `watch`, which forgets where the object was; a hand that opens and closes looks
no different scan by scan. But no hand does so within half a second. A contact that was never let go entirely, whose
load fell at once and rose again in that time, and which then rests too far away for what load does to a place, has
slipped.

Places are absolute poses: a method that lost its pattern on the way knows no displacement.
"""

from __future__ import annotations

import numpy as np

from taxelflow.compiling import kernel
from taxelflow.messages import LOST, Floats

# Memory per pad. BEFORE_S: time of the last pose of an object that rested. BEFORE: it (x, y) and its covariance
# (xx, yy, xy). HELD: its load's logarithm. FALLEN: whether its load has fallen at once since. LEAST: the least load's
# logarithm since. ARRIVED_S, STRIDE, LATEST: when the place made its largest step, its size, and the last place (x, y).
BEFORE_S, BEFORE, HELD, FALLEN, LEAST, ARRIVED_S, STRIDE, LATEST, LEAP = 0, 1, 6, 7, 8, 9, 10, 11, 13
JUMP = 0.7
"""A load that grows or falls by more than e to this power from one scan to the next is another contact."""
_LONGEST = 5.0
"""How many times longer than a contact takes to settle, at least, a hand takes to let go, hold again, and settle."""


@kernel
def rests_at(t: float, place: Floats, noise: Floats, load: float, m: Floats) -> None:
    """The object rests here: pose (3,) and its covariance (6: xx, yy, tt, xy, xt, yt), logarithm of the load."""
    m[BEFORE_S], m[HELD] = t, load
    m[BEFORE], m[BEFORE + 1] = place[0], place[1]
    m[BEFORE + 2], m[BEFORE + 3], m[BEFORE + 4] = noise[0], noise[1], noise[3]


@kernel
def load_falls(load: float, m: Floats) -> None:
    """The load of an object that rested so far falls at once to this logarithm."""
    m[FALLEN], m[LEAST], m[STRIDE] = 1.0, load, 0.0
    m[LATEST], m[LATEST + 1] = m[BEFORE], m[BEFORE + 1]


@kernel
def goes_by(t: float, pose: Floats, quality: int, load: float, m: Floats) -> None:
    """One more pose (3,) on the way, if the load has fallen and the pose can be believed."""
    if m[FALLEN] > 0.0:
        m[LEAST] = min(m[LEAST], load)
        stride = np.hypot(pose[0] - m[LATEST], pose[1] - m[LATEST + 1])
        if quality != LOST and not np.isnan(stride):
            m[LATEST], m[LATEST + 1] = pose[0], pose[1]
            if stride > m[STRIDE]:
                m[STRIDE], m[ARRIVED_S] = stride, t


@kernel
def by_chance(t: float, noise: Floats, load: float, load_m: float, settle_s: float, m: Floats) -> float:
    """How probable it is that noise and load alone put an object that rests so far from where it rested before.

    1 as long as it is not held again. Asked once: then, or when it takes so long that it may have been let go, FALLEN
    is over. noise: (6,), as in `rests_at`. load: its logarithm. load_m, settle_s: as in `SlipMonitor`.
    """
    if m[FALLEN] == 0.0:
        return 1.0
    late = t - m[BEFORE_S] > _LONGEST * settle_s
    held = load - m[LEAST] > JUMP
    if late or held:
        m[FALLEN] = 0.0
    if late or not held:
        return 1.0
    by_load = (load_m * (max(m[HELD], load) - m[LEAST])) ** 2
    x, y = m[LATEST] - m[BEFORE], m[LATEST + 1] - m[BEFORE + 1]
    xx, yy = m[BEFORE + 2] + noise[0] + by_load, m[BEFORE + 3] + noise[1] + by_load
    xy = m[BEFORE + 4] + noise[3]
    return float(np.exp(-0.5 * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)))
