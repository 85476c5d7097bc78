"""How much `taxelflow bench` measures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Numbers of repetitions; fewer show whether everything runs."""

    rounds: int = 300
    """Timed steps of a hand at most."""
    budget_s: float = 4.0
    """What the literal equations, the slowest of them, may take in all rounds."""
    strokes: int = 140
    """Of the simulated recording: about as long as the longest real one."""
    readings: int = 3
    """Of each file, of which the fastest counts."""
    batch_bytes: int = 256_000_000
    """Size of the scans that are estimated at once, far larger than caches."""
    batch_rounds: int = 7
    """Estimates of these, of which the fastest counts."""
    large: tuple[tuple[int, int, int], ...] = ((16, 16, 200), (34, 34, 76), (22, 34, 400))
    """Rows, columns and scans of contacts that cover a pad."""
    large_rounds: int = 2
    """Batches of each, of which the fastest counts."""
    peer_rounds: int = 1000
    """Timed steps beside other software, one scan each."""
    peer_warm: int = 100
    """Steps before these, in which patterns are learned and caches filled."""


USUAL = Effort()
