"""Records that the centroid methods share: a pad, a place on it, and what a method estimates of one scan.

Lengths in m, angles in rad, in the pad's frame (y up, against the row index). NaN is unknown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.numerics.records import Records, records

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats
    from taxelflow.sensors.layout import Layout

_LONG_ROW = 16
"""Taxels in a row from which on a loop over each row is faster than one over the pad."""


class ScanBlock(NamedTuple):
    """Scans as a kernel gets them: t (scans,), s; pressure (scans, taxels); noise (taxels,); contact and complete
    (scans, pads).
    """

    t: Floats
    pressure: Floats
    noise: Floats
    contact: Bools
    complete: Bools


class Pad:
    """Constants of a pad: which entries of a scan are its own, its pitch, and the gain on its positions."""

    begin: int
    end: int
    pitch_x: float
    pitch_y: float
    gain_x: float
    gain_y: float
    row_length: int
    """Taxels in a row of a full grid whose rows are long, else 0; see `weighted_sums`."""


class Place:
    """A position on the pad in one scan, and its covariance."""

    t_s: float
    x: float
    y: float
    var_x: float
    var_y: float
    cov_xy: float


class Estimate:
    """A pose, or a displacement, and its covariance."""

    x: float
    y: float
    theta: float
    var_x: float
    var_y: float
    var_theta: float
    cov_xy: float
    cov_x_theta: float
    cov_y_theta: float


class Row:
    """What a method estimates of one scan on one pad; fields as in `Estimates`."""

    pose: Estimate
    displacement: Estimate
    lag_s: float
    span_s: float
    disturbance: float


def pads_of(layout: Layout, gains: Floats) -> Records:
    """(pads,) records of `Pad`. gains: (pads, 2) along x, y."""
    held = records(Pad, len(layout.pads))
    held["begin"], held["end"] = layout.starts[:-1], layout.starts[1:]
    held["pitch_x"], held["pitch_y"] = layout.pitch_m.T
    held["gain_x"], held["gain_y"] = gains.T
    rows, cols = np.array(layout.shapes).T
    is_full = rows * cols == np.diff(layout.starts)
    held["row_length"] = np.where(is_full & (cols >= _LONG_ROW), cols, 0)
    return held
