"""Gravity, of controllers and of the simulation."""

G_M_S2 = 9.81
"""Standard gravity. It is the load over the mass of an object that hangs in a grip."""
