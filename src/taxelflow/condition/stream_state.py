"""Records of a stream that duplicates and gaps are found by."""

from __future__ import annotations

from typing import Annotated

from taxelflow.messages import Floats

STEPS = 15
"""Time steps whose median is the usual one."""
RUNS = 48
"""Consecutive runs of equal scans that are tested for periodicity."""


class TaxelHistory:
    """Readings of one taxel: the lowest of all, the last one, and the step that led to it.

    loaded_scans: consecutive differing scans in which it was loaded, at most 2. reversals: of the steps, among
    judged_scans: scans in which there could have been one.
    """

    lowest: float
    value: float
    step: float
    loaded_scans: int
    reversals: int
    judged_scans: int


class StreamState:
    """State of a stream.

    last_stamp_s, last_kept_s: time of the last scan, and of the last one kept; NaN before the first. gap_pending: time
    was lost since the last scan kept. dropped_since_kept: scans. kept_is_evidence: a repetition of the last scan kept
    would be recognised. repeats_seen: any scan has been dropped.
    dropped, gaps, longest_gap_s: totals. steps, step_mean_s, step_squares_s2: number, mean, and sum of squared
    deviations of the steps from stamp to stamp. new_steps, new_steps_s: number and sum of the steps between scans whose
    repetition would be recognised.
    run_scans, run_is_loaded: length of the current run of equal scans, less 1, and whether it counts. periodic: runs
    are.
    recent_steps_s, recent_new_steps_s, recent_runs: ring buffers, of which stamps, new_stamps and runs entries have
    been written in all.
    """

    last_stamp_s: float
    last_kept_s: float
    gap_pending: bool
    dropped_since_kept: int
    kept_is_evidence: bool
    repeats_seen: bool
    dropped: int
    gaps: int
    longest_gap_s: float
    steps: int
    step_mean_s: float
    step_squares_s2: float
    new_steps: int
    new_steps_s: float
    run_scans: int
    run_is_loaded: bool
    periodic: bool
    stamps: int
    new_stamps: int
    runs: int
    recent_steps_s: Annotated[Floats, STEPS]
    recent_new_steps_s: Annotated[Floats, STEPS]
    recent_runs: Annotated[Floats, RUNS]
