"""A ring: an array of fixed length that holds the newest values, number `k` of them at `k` modulo its length."""

from __future__ import annotations

from taxelflow.messages import Floats
from taxelflow.runtime.compiling import routine


@routine
def put(ring: Floats, number: int, value: float) -> None:
    """Write value `number`, in place of the oldest."""
    ring[number % len(ring)] = value


@routine
def at(ring: Floats, number: int) -> float:
    """Value `number`, which must be one of the newest."""
    value: float = ring[number % len(ring)]
    return value
