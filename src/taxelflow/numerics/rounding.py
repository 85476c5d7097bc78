"""What rounding may do, up to where an angle is linear, and from where a place is unknown: bounds of several stages."""

ROUNDING = 1e-9
"""Relative: sums that cancel to less of their parts are 0, and two numbers that differ by less are equal."""
LINEAR_RAD = 0.5
"""Standard deviation of an angle up to which places are linear in it; one that is less certain is not reported."""
BLURRED = 0.25
"""Standard deviation of a position, in pitches, above which a scan does not determine it along that direction."""
