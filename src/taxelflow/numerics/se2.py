"""Rotations of the plane for kernels, written out; `taxelflow.numerics.geometry` has them for whole arrays.

cos, sin: of the angle, anticlockwise from the x axis of the outer frame.
"""

from __future__ import annotations

from taxelflow.runtime.compiling import inlined


@inlined
def rotate(cos: float, sin: float, x: float, y: float) -> tuple[float, float]:
    """R(theta) (x, y): from the turned frame to the outer one."""
    return cos * x - sin * y, sin * x + cos * y


@inlined
def rotate_back(cos: float, sin: float, x: float, y: float) -> tuple[float, float]:
    """R(theta)^T (x, y): from the outer frame to the turned one."""
    return cos * x + sin * y, cos * y - sin * x
