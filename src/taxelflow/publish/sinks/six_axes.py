"""Motions as ROS messages carry them: x, y, z and the rotations about them, with a covariance that a filter can use.

What is unknown, of a motion over the skin all that leads out of it, is 0 with a variance of 1e6 and no covariances. ROS
states no way to mark it: a filter treats a variance of 0 as certain, and robot_localization one of -1 as 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Floats

UNKNOWN = 1e6
"""Variance of what is unknown, in the unit of the axis, squared: that of many drivers of wheels for z."""
_OVER_SKIN = [0, 1, 5]
"""Axes of a motion over the skin."""


def over_skin(motion: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """(6,) and (6, 6) of a motion (3,) in x, y and about z, and of its covariance (3, 3), NaN where unknown."""
    six, whole = np.full(6, np.nan), np.full((6, 6), np.nan)
    six[_OVER_SKIN], whole[np.ix_(_OVER_SKIN, _OVER_SKIN)] = motion, covariance
    return six, whole


def usable(motion: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """A motion (6,) and its covariance (6, 6), NaN where unknown, as numbers."""
    unknown = np.isnan(motion) | np.isnan(covariance.diagonal())
    whole = np.nan_to_num(covariance)
    whole[unknown], whole[:, unknown] = 0.0, 0.0
    whole[unknown, unknown] = UNKNOWN
    return np.nan_to_num(motion), whole
