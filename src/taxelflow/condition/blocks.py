"""The conditioner's kernels in NumPy, for a block of scans, without compilation.

Recordings are read in blocks, and many are short: compiling would take longer than all other work. The kernels are used
for streams, whose scans come one by one, and after the first scans of a long recording. Both forms keep their state in
the same records.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from taxelflow.condition.contact import Conditioned
from taxelflow.condition.deduplicate import MIN_LOADED_TAXELS, end_run, is_recognised
from taxelflow.condition.gaps import GAP, add_gap, add_step, judge_new_step
from taxelflow.condition.stream_state import STEPS, StreamState
from taxelflow.numerics.ring import at, put

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.condition.contact import Zeroed
    from taxelflow.messages import Bools, Floats
    from taxelflow.numerics.records import Records

_PIECE = 1 << 18
"""Readings at a time: bounds the memory of intermediate arrays, 2 MB each."""

_MOST_SCANS = 50_000
"""Scans after which the kernel is used: NumPy takes about as long for them as compiling does."""


class Blockwise:
    """A kernel whose first argument is (scans, ...), replaced by its block form for the first scans."""

    def __init__(self, block: Callable[..., Any], kernel: Callable[..., Any]) -> None:
        self._block, self._kernel, self._scans = block, kernel, 0

    def __call__(self, *arguments: Any) -> Any:
        """Call one of both."""
        form = self._block if self._scans < _MOST_SCANS else self._kernel
        self._scans += len(arguments[0])
        return form(*arguments)


def deduplicate_block(
    t: Floats,
    values: Floats,
    ceiling: Floats,
    drop: bool,
    histories: Records,
    streams: Records,
    keep: Bools,
    gap: Bools,
) -> int:
    """As `deduplicate`, to the bit but for the rounding of the sum of squared steps."""
    stream = _unpacked(streams[0])
    step = max(_PIECE // max(values.shape[1], 1), 1)
    for start in range(0, len(t), step):
        own = slice(start, start + step)
        _deduplicate_piece(t[own], values[own], (ceiling, drop), histories, stream, (keep[own], gap[own]))
    _pack(stream, streams[0])
    return int(np.count_nonzero(keep))


def _unpacked(record: Any) -> Any:
    """A record as an object of Python's numbers and lists, which are quicker to read and write one by one."""
    return SimpleNamespace(**{name: record[name].tolist() for name in record.dtype.names})


def _pack(stream: Any, record: Any) -> None:
    for name in record.dtype.names:
        record[name] = getattr(stream, name)


def _deduplicate_piece(
    t: Floats,
    values: Floats,
    limits: tuple[Floats, bool],
    histories: Records,
    stream: StreamState,
    found: tuple[Bools, Bools],
) -> None:
    """limits: ceiling (taxels,), and whether to drop. found: keep and gap, to be filled."""
    (ceiling, drop), (keep, gap) = limits, found
    repeats = _repeats(values, histories["value"])
    repeats[0] &= not np.isnan(stream.last_stamp_s)
    taxels = _Taxels(values[~repeats], ceiling, histories)
    jumps = _jumps(t, stream)
    number = 0
    for scan, (t_s, again) in enumerate(zip(t.tolist(), repeats.tolist(), strict=True)):
        if not np.isnan(stream.last_stamp_s):
            step_s = t_s - stream.last_stamp_s
            if jumps[scan]:
                add_gap(step_s, stream)
            else:
                add_step(step_s, stream)
            stream.run_scans += 1
            if drop and again and taxels.recognise(values[scan], number, stream.periodic):
                stream.last_stamp_s = t_s
                stream.dropped_since_kept += 1
                stream.dropped += 1
                stream.repeats_seen = True
                keep[scan] = False
                continue
        evidence = stream.repeats_seen and taxels.recognise(values[scan], number, stream.periodic)
        if evidence and stream.kept_is_evidence:
            judge_new_step(t_s - stream.last_kept_s, stream)
        gap[scan] = stream.gap_pending
        stream.last_stamp_s = stream.last_kept_s = t_s
        stream.gap_pending, stream.dropped_since_kept, stream.kept_is_evidence = False, 0, evidence
        if not again:
            end_run(stream, gap[scan])
            stream.run_is_loaded = taxels.loaded_taxels[number] >= MIN_LOADED_TAXELS
            number += 1
    taxels.store(histories)


def _repeats(values: Floats, last: Floats) -> Bools:
    """(scans,): whether all readings equal those of the scan before; a missing one equals a missing one."""
    before = np.concatenate([last[np.newaxis], values[:-1]])
    same: Bools = ((values == before) | (np.isnan(values) & np.isnan(before))).all(axis=1)
    return same


def _jumps(t: Floats, stream: StreamState) -> list[bool]:
    """For each scan, whether the step of its stamp is a gap. Brings the ring of recent steps up to date."""
    first = np.isnan(stream.last_stamp_s)
    steps = np.diff(t, prepend=t[0] if first else stream.last_stamp_s)[int(first) :]
    known = min(stream.stamps, STEPS)
    ring = [at(stream.recent_steps_s, k) for k in range(stream.stamps - known, stream.stamps)]
    ordered = np.array([*ring, *steps])
    usual = np.full(len(steps), np.inf)
    short = min(max(STEPS - known, 0), len(steps))
    for k in range(short):
        if known + k >= GAP.steps:
            usual[k] = np.median(ordered[: known + k])
    if len(steps) > short:
        windows = np.lib.stride_tricks.sliding_window_view(ordered[known + short - STEPS : -1], STEPS)
        usual[short:] = np.median(windows, axis=1)
    stream.stamps += len(steps)
    newest = steps[-STEPS:].tolist()
    for number, step_s in enumerate(newest, stream.stamps - len(newest)):
        put(stream.recent_steps_s, number, step_s)
    return [False] * int(first) + cast("list[bool]", (steps > GAP.ratio * usual).tolist())


class _Taxels:
    """Histories of all taxels before and after each of the scans that differ from the one before them.

    loaded_taxels: of each of these scans.
    """

    def __init__(self, values: Floats, ceiling: Floats, histories: Records) -> None:
        """values: (differing scans, taxels)."""
        self._ceiling, self._histories, self._values = ceiling, histories, values
        self._lowest = np.fmin.accumulate(np.concatenate([histories["lowest"][np.newaxis], values]))
        loaded = (self._lowest[:-1] < values) & (values < ceiling)
        self.loaded_taxels: list[int] = np.count_nonzero(loaded, axis=1).tolist()
        before = histories["loaded_scans"]
        self._loaded = np.concatenate([[before >= 2, before >= 1], loaded])
        self._judged = self._loaded[2:] & self._loaded[1:-1] & self._loaded[:-2]
        with np.errstate(over="ignore"):  # of absurd readings
            step = np.diff(np.concatenate([histories["value"][np.newaxis], values]), axis=0)
            self._steps = np.concatenate([histories["step"][np.newaxis], step])
            self._reversed = self._judged & (self._steps[1:] * self._steps[:-1] < 0.0)

    def recognise(self, values: Floats, number: int, periodic: bool) -> bool:
        """Whether a scan (taxels,), if it equals the last one, is no new one: `number` differing scans came before."""
        lowest = self._lowest[number]
        own = np.flatnonzero((lowest < values) & (values < self._ceiling))
        if not len(own):
            return False
        held = self._histories[own]
        judged = held["judged_scans"] + np.count_nonzero(self._judged[:number, own], axis=0)
        reversals = held["reversals"] + np.count_nonzero(self._reversed[:number, own], axis=0)
        return periodic or is_recognised(reversals, judged)

    def store(self, histories: Records) -> None:
        """Bring the histories up to date."""
        histories["lowest"] = self._lowest[-1]
        histories["judged_scans"] += np.count_nonzero(self._judged, axis=0)
        histories["reversals"] += np.count_nonzero(self._reversed, axis=0)
        histories["step"] = self._steps[-1]
        histories["loaded_scans"] = np.where(self._loaded[-1], 1 + self._loaded[-2], 0)
        if len(self._values):
            histories["value"] = self._values[-1]


def condition_block(values: Floats, gap: Bools, entries: Zeroed, pads: Records, out: Conditioned) -> None:
    """As `condition`."""
    step = max(_PIECE // max(values.shape[1], 1), 1)
    for start in range(0, len(values), step):
        own = slice(start, start + step)
        with np.errstate(over="ignore", invalid="ignore"):
            piece = Conditioned(out.pressure[own], out.contact[own], out.complete[own])
            _condition_piece(values[own], entries, pads, piece)
    np.logical_and(out.complete, ~gap[:, np.newaxis], out=out.complete)


def _condition_piece(values: Floats, entries: Zeroed, pads: Records, out: Conditioned) -> None:
    (offset, noise, last), (pressure, contact, complete) = entries, out
    live, starts = noise > 0.0, pads["start"]
    np.subtract(values, offset, out=pressure)
    known = np.isfinite(pressure) & live
    pressure[~known] = 0.0
    complete[:] = True
    for k in np.flatnonzero((~known & live).any(axis=0)):
        pad = int(np.searchsorted(starts, k, side="right")) - 1
        lost = ~known[:, k] & (_held(pressure[:, k], known[:, k], last[k]) > pads["off"][pad] * noise[k])
        complete[:, pad] &= ~lost
    if len(values):
        newest = len(values) - 1 - np.argmax(known[::-1], axis=0)
        last[:] = np.where(known.any(axis=0), pressure[newest, np.arange(len(last))], last)
    total = np.add.reduceat(pressure, starts, axis=1)
    std = np.sqrt(np.add.reduceat(np.where(pressure != 0.0, noise**2, 0.0), starts, axis=1))
    peak = np.maximum.reduceat(np.divide(pressure, noise, where=live, out=np.zeros_like(pressure)), starts, axis=1)
    begins, lasts = ((peak > pads[level]) & (total > pads[level] * std) for level in ("on", "off"))
    lasts |= np.logical_or.reduceat(live, starts) & ~np.logical_or.reduceat(known, starts, axis=1)
    in_contact = pads["in_contact"]
    for scan in range(len(values)):
        in_contact = np.where(in_contact, lasts[scan], begins[scan])
        contact[scan] = in_contact
    pads["in_contact"] = in_contact


def _held(readings: Floats, known: Bools, last: float) -> Floats:
    """(scans,) of one taxel: its last known reading."""
    newest = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    return np.where(newest < 0, last, readings[newest])
