"""Split covariance intersection of two estimates of one place: by the map, and by the centre of pressure.

Symbols as in `centre_of_pressure`: place p on the map with covariance C, centre of pressure c with covariance D, of
which S has an unknown correlation with p.
"""

from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.numerics.rounding import LEAST_VARIANCE_M2, SIGNIFICANT
from taxelflow.numerics.small_linalg import inverse2
from taxelflow.runtime.compiling import inlined, lean_kernel

_ROUNDS = 4
"""Of the weight and the ratio that minimise the covariance, each with the other held."""


@lean_kernel
def widen(cov: Floats, doubt: tuple[float, float, float], apart: tuple[float, float], along: Floats) -> None:
    """Add to cov (2 or 3, ...) of a place on the map, C, along a unit vector (2,), what of c - p C + D do not explain.

    Others as for `combine`, in the same unit.
    """
    x, y = along[0], along[1]
    distance = x * apart[0] + y * apart[1]
    xx, xy, yy = cov[0, 0] + doubt[0], cov[0, 1] + doubt[1], cov[1, 1] + doubt[2]
    more = max(distance * distance - x * x * xx - 2.0 * x * y * xy - y * y * yy, 0.0)
    cov[0, 0] += more * x * x
    cov[1, 1] += more * y * y
    cov[0, 1] += more * x * y
    cov[1, 0] = cov[0, 1]


@lean_kernel
def combine(
    cov: Floats,
    doubt: tuple[float, float, float],
    common: tuple[float, float, float],
    apart: tuple[float, float],
    is_cut: bool,
    weight: Floats,
) -> None:
    """Fill weight W (2, 2), and replace the covariance (3, 3) of a pose on its map by that of the combined pose.

    doubt, common: D and S, each as xx, xy, yy. apart: c - p. is_cut: whether the border surely cuts the pattern: then S
    is all of D, and W as if it were none. All are in the same unit.
    """
    map_xx, map_xy, map_yy = cov[0, 0] + LEAST_VARIANCE_M2, cov[0, 1], cov[1, 1] + LEAST_VARIANCE_M2
    xx, xy, yy = inverse2(map_xx + doubt[0], map_xy + doubt[1], map_yy + doubt[2])
    chi = 0.5 * (apart[0] * apart[0] * xx + 2.0 * apart[0] * apart[1] * xy + apart[1] * apart[1] * yy)
    wide, ratio, common = 1.0, 0.0, doubt if is_cut else common
    p = q = r = s = 0.0
    own = alone = both = (0.0, 0.0, 0.0)
    for _ in range(1 if is_cut else _ROUNDS):
        a, b, c = wide * map_xx, wide * map_xy, wide * map_yy
        d, e, f = doubt[0] + ratio * common[0], doubt[1] + ratio * common[1], doubt[2] + ratio * common[2]
        xx, xy, yy = inverse2(a + d, b + e, c + f)
        weight[0, 0], weight[0, 1] = a * xx + b * xy, a * xy + b * yy
        weight[1, 0], weight[1, 1] = b * xx + c * xy, b * xy + c * yy
        p, q, r, s = 1.0 - weight[0, 0], -weight[0, 1], -weight[1, 0], 1.0 - weight[1, 1]
        own = transformed(p, q, r, s, (map_xx, map_xy, map_yy))
        alone = transformed(weight[0, 0], weight[0, 1], weight[1, 0], weight[1, 1], doubt)
        both = transformed(weight[0, 0], weight[0, 1], weight[1, 0], weight[1, 1], common)
        moved, shared = own[0] + own[2] + LEAST_VARIANCE_M2, both[0] + both[2]
        ratio, wide = np.sqrt(moved / (shared + LEAST_VARIANCE_M2)), 1.0 + np.sqrt(shared / moved)
    scale = max(chi, 1.0)
    cov[0, 0] = scale * (wide * own[0] + alone[0] + ratio * both[0])
    cov[1, 1] = scale * (wide * own[2] + alone[2] + ratio * both[2])
    cov[0, 1] = cov[1, 0] = scale * (wide * own[1] + alone[1] + ratio * both[1])
    x, y = cov[0, 2], cov[1, 2]
    cov[0, 2] = cov[2, 0] = p * x + q * y
    cov[1, 2] = cov[2, 1] = r * x + s * y


@lean_kernel
def surely(shift: tuple[float, float], doubt: tuple[float, float, float]) -> float:
    """The share of a shift of c by the border that the errors of c and p do not explain at 3 standard deviations.

    doubt: their covariance C + D as xx, xy, yy.
    """
    (x, y), (xx, xy, yy) = shift, doubt
    square = xx * yy - xy * xy
    chi = yy * x * x - 2.0 * xy * x * y + xx * y * y
    return float(1.0 - SIGNIFICANT**2 * square / chi) if chi > SIGNIFICANT**2 * square else 0.0


@inlined
def transformed(p: float, q: float, r: float, s: float, m: tuple[float, float, float]) -> tuple[float, float, float]:
    """T m T^T as xx, xy, yy, with T = [[p, q], [r, s]] and m a symmetric matrix as xx, xy, yy."""
    xx, xy, yy = m
    return (
        p * p * xx + 2.0 * p * q * xy + q * q * yy,
        p * r * xx + (p * s + q * r) * xy + q * s * yy,
        r * r * xx + 2.0 * r * s * xy + s * s * yy,
    )
