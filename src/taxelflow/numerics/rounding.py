"""Bounds that several stages share: of rounding, of noise, of an angle that is linear, of a position that is known."""

from typing import NamedTuple

ROUNDING = 1e-9
"""Relative error: a sum that cancels to less than this share of its terms is 0, and closer numbers are equal."""
LEAST_VARIANCE_M2 = 1e-18
"""Added to the variance of a place, which may be 0: a nanometre, squared."""
NEGLIGIBLE = 1e-12
"""Relative size of what rounding makes of 0: added to what may be 0, such as a singular matrix."""
SIGNIFICANT = 3.0
"""Standard deviations beyond which noise does not explain a difference."""
CERTAIN = 6.0
"""Standard deviations that noise never exceeds, however many readings there are."""
PARALLEL = 1e-3
"""Curvature, over that of a sphere, below which normals are parallel: they have no common point."""
LINE_POINTS = 3
"""Fewest points that determine a straight line and its error."""


class _Reach(NamedTuple):
    """Which taxels of a pad are near each other, pitches."""

    neighbour: float = 1.6
    """Pitches within which taxels are neighbours: beyond the diagonal of a square grid (1.41), short of the second ring
    of a triangular one (1.73) and of every second taxel in a row (2)."""
    second_ring: float = 1.8
    """Pitches within which a triangular taxel has another within 30 degrees of every direction. Only three are next to
    it; six more are at 1.73 pitches."""
    second_slope: float = 0.6
    """Tangent of 31 degrees: less than that of a diagonal of a square grid, so that the grid is as before."""


REACH = _Reach()
OBSERVABLE = 4.0
"""A turn is observable if the information on it is this many times what noise alone would pretend."""
LINEAR_RAD = 0.5
"""Standard deviation of an angle up to which positions are linear in it."""
BLIND_M = 0.005
"""Standard deviation of a position, m, beyond which it is not observable along that direction."""
BLURRED = 0.25
"""Standard deviation of a position, in pitches, above which a scan does not determine it along that direction."""
