"""Covariance of a contact's poses by the error of its map, which is estimated from the same scans.

The information of a scan takes the map as known. With the map's error, the covariance of the states is the inverse of
their Schur complement. By Woodbury's identity it is B^-1 + B^-1 E M^-1 E^T B^-1, M = H - E^T B^-1 E, of the blocks B of
the states, the information H of the map's coefficients with their priors, and E between both. The object's frame, which
nothing determines, is that in which the mean of the poses stays, as in the fit.

This error changes slowly, as the object moves: consecutive scans share it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array

from taxelflow.estimation.template.bundle_adjustment import LEAST_INFORMATION
from taxelflow.estimation.template.normal_equations import Normal, assemble
from taxelflow.numerics.banded import WIDTH, add_diagonal, dense, smoothness
from taxelflow.numerics.bspline import KNOTS, STATE, pose_part

if TYPE_CHECKING:
    from taxelflow.estimation.template.map import Pattern
    from taxelflow.estimation.template.observations import Scanned
    from taxelflow.messages import Floats

_MOST = 2_000_000
"""Scans times knots at most: beyond, the map's error is neglected, because many scans determine it well."""


def of_map(
    pattern: Pattern, scanned: Scanned, states: Floats, error: float, precision: Floats, level: float = 0.0
) -> Floats:
    """(scans, 5, 5), the part of the states' covariance by the error of the map. Arguments as for `refine`."""
    scans, knots = len(states), pattern.coefficients.size
    if scans * knots > _MOST:
        return np.zeros((scans, STATE, STATE))
    fixed = np.isinf(precision)
    readings = scanned.with_error(error)
    normal = Normal.empty(scans, len(scanned.delay_s), knots)
    assemble(pattern.surface, readings, states, np.where(fixed, 0.0, 1.0), level, normal)
    normal.stencil[:] += pattern.smoothing * smoothness(pattern.shape)
    add_diagonal(normal.stencil, pattern.prior)
    pull = np.diag(np.where(fixed, 1.0, precision) + LEAST_INFORMATION)
    held = np.asarray(np.linalg.inv(normal.blocks + pull), np.float64)
    held[:, fixed] = held[:, :, fixed] = 0.0
    crossed = _crossed(normal, pattern.shape[1])
    moved = held @ crossed
    information = dense(normal.stencil, pattern.shape[1]) - crossed.reshape(-1, knots).T @ moved.reshape(-1, knots)
    of_knots = np.linalg.inv(information)
    frame = pose_part(held)  # a change of the frame moves poses only
    by_frame = of_knots @ np.einsum("kac,kab->cb", crossed, frame)
    frame = frame + moved @ by_frame
    own = moved @ of_knots @ moved.transpose(0, 2, 1)
    found: Floats = own - frame @ np.linalg.pinv(frame.sum(axis=0)[: frame.shape[2]]) @ frame.transpose(0, 2, 1)
    return found


def _crossed(normal: Normal, nx: int) -> Floats:
    """(scans, 5, knots), information between states and coefficients."""
    scan, taxel = np.nonzero(normal.w)
    count, scans, knots = len(scan), len(normal.w), len(normal.right)
    around = np.arange(KNOTS)
    columns = normal.first[scan, taxel][:, np.newaxis] + around // WIDTH * nx + around % WIDTH
    row = np.repeat(np.arange(count), KNOTS)
    by_knot = csr_array((normal.weight[scan, taxel].ravel(), (row, columns.ravel())), shape=(count, knots))
    weighted = normal.slope[scan, taxel] * normal.w[scan, taxel][:, np.newaxis]
    state = scan[:, np.newaxis] * STATE + np.arange(STATE)
    row = np.repeat(np.arange(count), STATE)
    by_state = csr_array((weighted.ravel(), (row, state.ravel())), shape=(count, scans * STATE))
    product: Floats = (by_state.T @ by_knot).toarray()
    return product.reshape(scans, STATE, knots)
