"""Bounds that several stages share: of rounding, of an angle that is linear, of a position that is known."""

ROUNDING = 1e-9
"""Relative error: a sum that cancels to less than this share of its terms is 0, and closer numbers are equal."""
LINEAR_RAD = 0.5
"""Standard deviation of an angle up to which positions are linear in it; an angle with a larger one is not reported."""
BLURRED = 0.25
"""Standard deviation of a position, in pitches, above which a scan does not determine it along that direction."""
