"""Numerics that several stages share, one copy of each: small matrices, robust losses, B-splines, banded systems."""
