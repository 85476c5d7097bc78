"""Runs of scans in which a flag is set."""

import numpy as np

from taxelflow.numerics.spans import spans


def test_runs_at_both_ends_and_between() -> None:
    assert spans(np.array([1, 1, 0, 1, 0, 0, 1], np.bool_)) == [(0, 2), (3, 4), (6, 7)]
    assert spans(np.zeros(3, np.bool_)) == spans(np.zeros(0, np.bool_)) == []
