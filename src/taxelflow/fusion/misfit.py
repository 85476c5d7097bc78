"""How contacts that disagree widen the covariance: the memory of their misfit, in the plane and in space alike."""

MEMORY = 0.98
"""What is left of misfit and degrees of freedom after a scan: they reach back over about 50 scans."""
LEAST_FREEDOM = 20.0
"""Degrees of freedom from which the misfit is significant: its relative standard deviation is then below 0.32."""
