"""Runs of scans in which a flag is set."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Bools


def spans(flags: Bools) -> list[tuple[int, int]]:
    """Runs of True in flags (n,), as first index and index after the last."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]
