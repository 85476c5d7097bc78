"""Every kernel of the pattern run once on a made-up contact, so that none is compiled while scans go by."""

from __future__ import annotations

from functools import cache

import numpy as np

from taxelflow.estimation.template.batch.model_selection import solve_contact
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.online.map_update import first_pattern, learn
from taxelflow.estimation.template.online.relocalization import recognised


@cache
def compile_kernels() -> None:
    """Batch and stream, once in a process."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(6.0), np.arange(6.0)))
    places = np.stack([x - 2.5, y - 2.5])
    moved = 0.4 * np.arange(5.0)[:, np.newaxis]
    readings = 100.0 * np.exp(-0.5 * ((places[0] - moved + 1.0) ** 2 + places[1] ** 2))
    variance, never, at_once = np.ones_like(readings), np.full(36, np.inf), np.zeros(36)
    t_s = np.arange(5.0)
    solve_contact(Scanned.of(t_s, places, readings, variance, never, at_once), np.ones(2))
    learned = first_pattern(0.0, places, readings[0], variance[0], never, at_once)
    keyframes = learned.keyframes
    for k in range(1, 5):
        keyframes = keyframes.with_scan(
            t_s[k], readings[k], variance[k], np.zeros((3, 0)), np.array([moved[k, 0] - 1.0, 0.0, 0.0, 1.0, 0.0])
        )
    learned.keyframes, learned.fresh = keyframes, 4
    learned = learn(learned)
    recognised(learned, np.zeros(2), places, readings[0], variance[0], never)
