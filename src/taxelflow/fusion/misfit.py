"""How contacts that disagree widen the covariance: the memory of their misfit, in the plane and in space alike."""

from typing import NamedTuple


class _Misfit(NamedTuple):
    """Misfit and degrees of freedom of past scans."""

    memory: float = 0.98
    """What is left of misfit and degrees of freedom after a scan: they reach back over about 50 scans."""
    least_freedom: float = 20.0
    """Degrees of freedom from which the misfit is significant: its relative standard deviation is then below 0.32."""


MISFIT = _Misfit()
