"""Covariance of a contact's poses by the error of its map, which is estimated from the same scans.

The information of a scan takes the map as known. With the map's error, the covariance of the states is the inverse of
their Schur complement B - E H^-1 E^T, of the blocks B of the states, the information H of the map's coefficients with
their priors, and E between both. With Cholesky factors B = b b^T, H = h h^T and X = h^-1 E^T b^-T it is

    b^-T (1 - X^T X)^-1 b^-1 = B^-1 + b^-T M^T M b^-1,

a square: M = c^-1 X with c c^T = 1 - X X^T (Woodbury's identity), or, by a smaller matrix where the states are fewer
than the knots, X above c^-1 X^T X with c c^T = 1 - X^T X. The object's frame, which nothing determines, is that in
which the mean of the poses stays, as in the fit.

This error changes slowly, as the object moves: consecutive scans share it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from taxelflow.estimation.template.normal_equations import Normal
from taxelflow.messages import Floats
from taxelflow.numerics.banded import Factor, add_diagonal
from taxelflow.numerics.bspline import STATE, add_around, pose_part
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.runtime.compiling import long_kernel

if TYPE_CHECKING:
    from taxelflow.estimation.template.bundle_adjustment import Linear

_MOST = 2_000_000
"""Scans times knots at most: beyond, the map's error is neglected, because many scans determine it well."""


def of_map(linear: Linear, precision: Floats) -> Floats:
    """(scans, 5, 5), the part of the states' covariance by the error of the map.

    linear: from `linearised` with this precision; the equations of its map get their priors, and serve once.
    """
    scans, knots = len(linear.normal.blocks), len(linear.normal.right)
    if scans * knots > _MOST:
        return np.zeros((scans, STATE, STATE))
    free, pattern = np.isfinite(precision), linear.pattern
    linear.regularise()
    normal = linear.normal
    add_diagonal(normal.stencil, NEGLIGIBLE * normal.stencil.max())
    whitening = np.asarray(np.linalg.inv(np.linalg.cholesky(normal.blocks)), np.float64)[:, free]
    whitening[:, :, ~free] = 0.0
    crossed = np.zeros((scans, STATE, knots))
    _add_crossed(normal, pattern.shape[1], crossed)
    white = (whitening @ crossed).reshape(-1, knots).T
    white_frame = pose_part(whitening)  # a change of the frame moves poses only
    blocks, moved = _excess(Factor(normal.stencil, pattern.shape[1]).whitened(white), white_frame)
    back = whitening.transpose(0, 2, 1)
    frame = back @ (white_frame + moved)
    fixed_frame = frame @ np.linalg.pinv(frame.sum(axis=0)[: frame.shape[2]]) @ frame.transpose(0, 2, 1)
    found: Floats = back @ blocks @ whitening - fixed_frame
    return found


def _excess(x: Floats, along: Floats) -> tuple[Floats, Floats]:
    """Of G = (1 - X^T X)^-1 - 1 the blocks (scans, free, free) on the diagonal, and G times along (scans, free, n).

    x: (knots, scans free). With L L^T = 1 - X X^T, G is S^T S of S = L^-1 X. The same of X^T X instead of X is G less
    X^T X: the smaller of the two matrices is factored.
    """
    few_knots = len(x) <= x.shape[1]
    square = x @ x.T if few_knots else x.T @ x
    lower = cholesky(np.eye(len(square)) - square, lower=True, overwrite_a=True, check_finite=False)
    root = solve_triangular(lower, x if few_knots else square, lower=True, check_finite=False)
    scans, free, _ = along.shape
    parts = root.T.reshape(scans, free, -1)
    blocks, flat = parts @ parts.transpose(0, 2, 1), along.reshape(scans * free, -1)
    product = root.T @ (root @ flat)
    if not few_knots:
        own = np.arange(scans)
        blocks += square.reshape(scans, free, scans, free)[own, :, own]
        product += square @ flat
    return blocks, product.reshape(along.shape)


@long_kernel
def _add_crossed(normal: Normal, nx: int, out: Floats) -> None:
    """Add to out (scans, 5, knots) the information between states and coefficients. nx: knots in a row."""
    for k in range(len(out)):
        for i in range(normal.start[k], normal.start[k + 1]):
            for a in range(STATE):
                add_around(normal.pull[i, a], normal.weight[i], normal.first[i], nx, out[k, a])
