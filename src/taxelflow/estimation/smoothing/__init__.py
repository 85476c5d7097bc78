"""Poses under a constant-velocity prior: filter and smoother."""
