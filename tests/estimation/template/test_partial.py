from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from rigged import rigged
from taxelflow.evaluation.nees import consistency
from taxelflow.evaluation.pose_errors import without_frame
from taxelflow.messages import OK
from taxelflow.pipeline import api
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.messages import Bytes, Floats


def followed(**changes: object) -> tuple[Floats, Floats, Bytes]:
    """Errors (scans, 3), m and rad, covariances (scans, 3, 3) and quality (scans,) of a batch's poses."""
    recording = simulate(rigged("feet-lift", sensing={"rate_hz": 20.0}, **changes))
    slips = api.estimate(recording, "template").slips
    own = np.isfinite(slips.pose[:, 0, 0])
    pose, truth = slips.pose[own, 0], recording.known_truth.pose[own]
    return without_frame(pose, truth, np.ones(pose.shape)), slips.covariance[own, 0], slips.quality[own, 0]


@pytest.mark.long
def test_feet_that_lift_do_not_move_the_others() -> None:
    error, covariance, quality = followed()
    assert np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))) < 0.2e-3
    nees = consistency([(error, covariance)], 1).nees
    assert nees is not None
    assert nees < 2.0
    assert (quality == OK).mean() > 0.8
