"""Limits of observability of the object's motion: from where a direction counts as unknown, and how unknown it is."""

BLIND_M_S, BLIND_M = 0.02, 0.005
"""Standard deviations of velocity and position, m/s and m, beyond which a direction is not observable."""
BLIND = 10.0
"""Standard deviation of a direction that is not observable, over that limit."""
