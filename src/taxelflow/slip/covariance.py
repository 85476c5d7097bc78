"""Covariance of a pose (x, y, theta) of which some coordinates may be unknown, and its Cholesky factor."""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.records import Vector
from taxelflow.numerics.rounding import NEGLIGIBLE
from taxelflow.runtime.compiling import routine


class Covariance:
    """Symmetric 3 x 3 covariance of (x, y, theta), m and rad."""

    variance: Vector
    """Diagonal; NaN where the coordinate is unknown."""
    xy: float
    xt: float
    yt: float


class Cholesky:
    """Lower triangular factor L of a covariance, L L' = R."""

    xx: float
    yx: float
    yy: float
    tx: float
    ty: float
    tt: float


@routine
def multiply(covariance: Covariance, factor: float) -> None:
    """Multiply every entry by a factor, in place."""
    for axis in range(3):
        covariance.variance[axis] *= factor
    covariance.xy *= factor
    covariance.xt *= factor
    covariance.yt *= factor


@routine
def translation_variance(covariance: Covariance) -> float:
    """Mean variance of the known ones of x and y, m^2."""
    xx, yy = covariance.variance[0], covariance.variance[1]
    if np.isnan(xx):
        return float(yy)
    return float(xx if np.isnan(yy) else 0.5 * (xx + yy))


@routine
def translation_axes(covariance: Covariance) -> int:
    """How many of x and y are known; one of them always is."""
    return 1 if np.isnan(covariance.variance[0]) or np.isnan(covariance.variance[1]) else 2


@routine
def factorize(covariance: Covariance, factor: Cholesky) -> bool:
    """Fill the Cholesky factor; True if theta is known.

    The diagonal entry of an unknown coordinate is infinite, so that whitening makes its residual 0. Of a singular
    covariance rounding may leave less than 0.
    """
    xx, yy, tt = covariance.variance[0], covariance.variance[1], covariance.variance[2]
    factor.xx = np.inf if np.isnan(xx) else np.sqrt(xx)
    factor.yx = covariance.xy / factor.xx
    factor.yy = np.inf if np.isnan(yy) else np.sqrt(max(yy - factor.yx * factor.yx, NEGLIGIBLE * yy))
    if np.isnan(tt):
        factor.tx, factor.ty, factor.tt = 0.0, 0.0, np.inf
        return False
    factor.tx = covariance.xt / factor.xx
    factor.ty = (covariance.yt - factor.tx * factor.yx) / factor.yy
    factor.tt = np.sqrt(max(tt - factor.tx * factor.tx - factor.ty * factor.ty, NEGLIGIBLE * tt))
    return True


@routine
def whiten(factor: Cholesky, residual: Floats) -> float:
    """Replace a residual e (3,) by inv(L) e (forward substitution) and return its squared length."""
    residual[0] /= factor.xx
    residual[1] = (residual[1] - factor.yx * residual[0]) / factor.yy
    residual[2] = (residual[2] - factor.tx * residual[0] - factor.ty * residual[1]) / factor.tt
    return float(residual[0] * residual[0] + residual[1] * residual[1] + residual[2] * residual[2])
