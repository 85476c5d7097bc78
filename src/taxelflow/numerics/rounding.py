"""What rounding may do, and up to where an angle is linear: bounds that several stages share."""

ROUNDING = 1e-9
"""Relative: sums that cancel to less of their parts are 0, and two numbers that differ by less are equal."""
LINEAR_RAD = 0.5
"""Standard deviation of an angle up to which places are linear in it; one that is less certain is not reported."""
