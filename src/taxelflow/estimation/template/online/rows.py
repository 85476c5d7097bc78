"""Estimates as the kernels of a stream fill them in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template.online.track_state import Rows
from taxelflow.messages import Estimates

if TYPE_CHECKING:
    from taxelflow.messages import Scans


def rows_of(estimates: Estimates) -> Rows:
    """Estimates as kernels fill them in."""
    return Rows(
        estimates.pose,
        estimates.covariance,
        estimates.displacement,
        estimates.displacement_covariance,
        estimates.span_s,
        estimates.lag_s,
        estimates.disturbance,
        estimates.quality,
    )


def room_for(scans: Scans) -> Estimates:
    """Estimates to be filled in, row by row."""
    shape = scans.contact.shape
    vectors, matrices = (*shape, 3), (*shape, 3, 3)
    return Estimates(
        t_s=scans.t_s,
        displacement=np.empty(vectors),
        pose=np.empty(vectors),
        covariance=np.empty(matrices),
        displacement_covariance=np.empty(matrices),
        span_s=np.empty(shape),
        lag_s=np.empty(shape),
        disturbance=np.empty(shape),
        quality=np.empty(shape, np.uint8),
    )
