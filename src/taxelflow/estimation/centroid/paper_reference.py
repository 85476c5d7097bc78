"""Equations (1) to (6) of the paper to the letter: slow, and the reference for the fast form.

Alcazar & Barajas, "Estimating object grasp sliding via pressure array sensing", ICRA 2012.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import convolve2d

from taxelflow.messages import Floats


def convolution_matrix(before: Floats, now: Floats) -> Floats:
    """C[T] of equation (1) from two scans of a pad, each (M, N): (2M-1, 2N-1). NaN counts as 0."""
    C: Floats = convolve2d(np.nan_to_num(before), np.nan_to_num(now), mode="full")
    return C


def convolution_index(before: Floats, now: Floats) -> tuple[float, float]:
    """Index (i, j) of the convolution of two scans of a pad, each (M, N), with the zero offset taken off.

    i grows along columns and j along rows (downwards); both are 0 for two identical scans centred on the pad.
    NaN where the convolution sums to 0.
    """
    M, N = now.shape
    C = convolution_matrix(before, now)  # (1)
    column_means, row_means = C.mean(axis=0), C.mean(axis=1)  # E[C, 1] and E[C, 2]
    A, B = np.arange(1, 2 * N), np.arange(1, 2 * M)  # (4) and (5): a column of A, a row of B, has its number
    with np.errstate(divide="ignore", invalid="ignore"):
        i = (A @ column_means) / column_means.sum()  # (2)
        j = (B @ row_means) / row_means.sum()  # (3)
    return float(i - N), float(j - M)


def slip_vector(first: Floats, second: Floats, third: Floats) -> tuple[float, float]:
    """S[T] of equation (6) in index units from the scans T-2, T-1 and T, each (M, N)."""
    i_before, j_before = convolution_index(first, second)
    i, j = convolution_index(second, third)
    return i - i_before, j - j_before
