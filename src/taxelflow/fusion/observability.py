"""Limits of observability of the object's motion: from where a direction counts as unknown, and how unknown it is."""

from typing import NamedTuple


class _Blind(NamedTuple):
    """Directions that are not observable."""

    m_s: float = 0.02
    """Standard deviation of a velocity, m/s, beyond which a direction is not observable; of a position: `BLIND_M`."""
    far: float = 10.0
    """Standard deviation of a direction that is not observable, over that limit."""


BLIND = _Blind()
