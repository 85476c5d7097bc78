"""Scans of slips that go on, in bounded memory: neighbours of a long slip are averaged."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import LOST, Bools, Bytes, Floats
from taxelflow.numerics.records import Records, Vector
from taxelflow.runtime.compiling import kernel, routine

MOST_ROWS = 512
"""Rows of a slip that are held. Of a longer slip neighbours are averaged, so that memory and time are bounded."""


class Row:
    """What is held of a scan: time of the pose, the pose, the displacement."""

    t_s: float
    pose: Vector
    covariance: Annotated[Floats, 3, 3]
    displacement: Vector
    displacement_covariance: Annotated[Floats, 3, 3]


_SEEN = ("pose", "covariance", "displacement", "displacement_covariance")
"""Fields of a row that `hold_scans` copies, in its order."""


class Progress:
    """Of the slip of a pad. held: rows. last_s: time of its last scan. lost: its poses are in more than one frame."""

    held: int
    last_s: float
    lost: bool


def hold_block(
    times: tuple[Floats, Floats],
    seen: tuple[Floats, Floats, Floats, Floats],
    marks: tuple[Bools, Bytes],
    pads: NDArray[np.int64],
    scans: tuple[int, int],
    progress: Records,
    room: Records,
) -> None:
    """`hold_scans` in NumPy, while no rows are averaged."""
    begin, end = scans
    slipping, quality = marks
    for pad in pads.tolist():
        count = int(np.max(np.flatnonzero(slipping[begin:end, pad]), initial=-1)) + 1
        held = int(progress["held"][pad])
        if held + count >= MOST_ROWS:
            hold_scans(times, seen, marks, np.array([pad]), scans, progress, room)
        elif count:
            own, rows = slice(begin, begin + count), room[pad, held : held + count]
            rows["t_s"] = times[0][own] - np.where(np.isnan(times[1][own, pad]), 0.0, times[1][own, pad])
            for name, array in zip(_SEEN, seen, strict=True):
                rows[name] = array[own, pad]
            progress["held"][pad] += count
            progress["last_s"][pad] = times[0][begin + count - 1]
            progress["lost"][pad] |= (quality[own, pad] == LOST).any()


@kernel
def hold_scans(
    times: tuple[Floats, Floats],
    seen: tuple[Floats, Floats, Floats, Floats],
    marks: tuple[Bools, Bytes],
    pads: NDArray[np.int64],
    scans: tuple[int, int],
    progress: Records,
    room: Records,
) -> None:
    """Add to the slips of these pads the scans from the first up to the last before the end that slips.

    The result does not depend on how scans are cut into blocks. times: scans (scans,) and lags (scans, pads), s. seen:
    pose and displacement (scans, pads, 3), each with its covariance (scans, pads, 3, 3). marks: slipping and quality
    (scans, pads). progress: (pads,) of `Progress`. room: (pads, MOST_ROWS) of `Row`.
    """
    t_s, lag_s = times
    slipping, quality = marks
    for pad in pads:
        begin, end = scans
        while end > begin and not slipping[end - 1, pad]:
            end -= 1
        own: Progress = progress[pad]
        for scan in range(begin, end):
            lag = lag_s[scan, pad]
            row: Row = room[pad, own.held]
            row.t_s = t_s[scan] - (0.0 if np.isnan(lag) else lag)
            _write(seen, scan, pad, row)
            own.last_s, own.lost = t_s[scan], own.lost or quality[scan, pad] == LOST
            own.held += 1
            if own.held == MOST_ROWS:
                _average(room[pad])
                own.held = MOST_ROWS // 2


@routine
def _average(rows: Records) -> None:
    """Put the means of neighbours into the first half of the rows."""
    for k in range(MOST_ROWS // 2):
        _pair(rows[2 * k], rows[2 * k + 1], rows[k])


@routine
def _write(seen: tuple[Floats, Floats, Floats, Floats], scan: int, pad: int, row: Row) -> None:
    pose, covariance, displacement, displacement_covariance = seen
    for a in range(3):
        row.pose[a], row.displacement[a] = pose[scan, pad, a], displacement[scan, pad, a]
        for b in range(3):
            row.covariance[a, b] = covariance[scan, pad, a, b]
            row.displacement_covariance[a, b] = displacement_covariance[scan, pad, a, b]


@routine
def _pair(one: Row, other: Row, pair: Row) -> None:
    """Fill the mean of neighbouring poses, with its covariance, and the sum of displacements; pair may be one itself.

    A pose alone stays as it is.
    """
    known, also = np.isfinite(one.pose[0]), np.isfinite(other.pose[0])
    alone = 0 if known == also else (1 if known else 2)
    pair.t_s = _mean(one.t_s, other.t_s, alone, 0.5)
    for a in range(3):
        pair.pose[a] = _mean(one.pose[a], other.pose[a], alone, 0.5)
        pair.displacement[a] = _sum(one.displacement[a], other.displacement[a])
        for b in range(3):
            pair.covariance[a, b] = _mean(one.covariance[a, b], other.covariance[a, b], alone, 0.25)
            pair.displacement_covariance[a, b] = _sum(
                one.displacement_covariance[a, b], other.displacement_covariance[a, b]
            )


@routine
def _mean(one: float, other: float, alone: int, share: float) -> float:
    """Of two; alone: 1 or 2 if that one is the only known one."""
    if alone:
        return one if alone == 1 else other
    return share * (one + other)


@routine
def _sum(one: float, other: float) -> float:
    """Of the known ones."""
    if np.isnan(one):
        return other
    return one + (0.0 if np.isnan(other) else other)
