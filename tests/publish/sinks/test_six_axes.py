"""What a filter reads of a motion that is known in part."""

from __future__ import annotations

import numpy as np

from taxelflow.publish.sinks.six_axes import UNKNOWN, over_skin, usable

CORRELATED = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]])


def test_axes_out_of_the_skin_are_unknown_and_never_certain() -> None:
    motion, covariance = usable(*over_skin(np.array([1.0, 2.0, 3.0]), CORRELATED))
    assert motion.tolist() == [1, 2, 0, 0, 0, 3]
    assert np.array_equal(covariance[np.ix_([0, 1, 5], [0, 1, 5])], CORRELATED)
    assert covariance.diagonal().tolist() == [4, 3, UNKNOWN, UNKNOWN, UNKNOWN, 2]


def test_an_unknown_turn_or_variance_leaves_a_covariance_that_a_filter_can_invert() -> None:
    unknown = CORRELATED.copy()
    unknown[2, :] = np.nan
    motion, covariance = usable(*over_skin(np.array([1.0, 2.0, np.nan]), unknown))
    assert motion[5] == 0.0
    assert np.linalg.eigvalsh(covariance).min() > 1.0
    assert np.array_equal(covariance, covariance.T)
