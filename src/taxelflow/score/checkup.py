"""What a recording holds, and whether its sensor is well: the numbers of `taxelflow info`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.condition.conditioner import Conditioner

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from taxelflow.acquire.base import Reading, Recording
    from taxelflow.messages import Floats, RawScans

_GAP = 2.5
"""A time step longer than so many usual ones is a gap."""


class PadCheckup(msgspec.Struct, frozen=True):
    """One pad. Values in the sensor's unit; taxels by their number in the scan."""

    name: str
    rows: int
    cols: int
    taxels: int
    masked: int
    lowest: float | None
    highest: float | None
    noise: float | None
    tared: bool
    contact_scans: int
    idle_taxels: list[int]
    """Never read above the contact threshold."""
    saturated_taxels: list[int]
    """Reached full scale, if the sensor declares one."""
    missing_readings: int


class Checkup(msgspec.Struct, frozen=True):
    """A whole recording."""

    file: str
    format: str
    sensor: str
    unit: str
    scans: int
    scans_promised: int | None
    repeated_scans: int
    duration_s: float
    rate_hz: float | None
    jitter_s: float | None
    """Standard deviation of the time steps, gaps left out."""
    gaps: int
    longest_gap_s: float
    pads: list[PadCheckup]
    notes: list[str]
    loss: str | None = None


def check_up(recording: Recording, watched: Callable[[Iterable[RawScans]], Iterable[RawScans]] = iter) -> Checkup:
    """Read a recording twice: once for its values and noise, once for contact. `watched` may show progress."""
    tally = _Tally(recording)
    session = Conditioner().start(recording.sensor, recording.masked, tally.count(watched(tally.reading)))
    learned = session.learned
    if learned is None:
        raise RuntimeError("a lookahead always teaches")
    layout, full_scale = recording.layout, recording.sensor.full_scale
    contact = np.zeros(layout.pad_count, dtype=np.int64)
    touched = np.zeros(layout.taxels, dtype=np.bool_)
    for raw in recording.blocks():
        for scans in session.step(raw):
            contact += scans.contact[:, : layout.pad_count].sum(axis=0)
            loaded = scans.pressure[:, : layout.taxels] > Conditioner.contact_on * scans.noise[: layout.taxels]
            touched |= loaded.any(axis=0)
    saturated = tally.highest >= full_scale if full_scale else np.zeros(layout.taxels, dtype=np.bool_)
    pads = []
    for number, name in enumerate(layout.pads[: layout.pad_count]):
        own = layout.of_pad(number)
        live = ~learned.masked[own]
        noise = learned.noise[own][live] / recording.sensor.to_si
        rows, cols = layout.shapes[number]
        pads.append(
            PadCheckup(
                name=name,
                rows=rows,
                cols=cols,
                taxels=len(live),
                masked=int(np.sum(~live)),
                lowest=_finite(tally.lowest[own].min()),
                highest=_finite(tally.highest[own].max()),
                noise=float(np.median(noise)) if len(noise) else None,
                tared=bool(learned.tared[number]),
                contact_scans=int(contact[number]),
                idle_taxels=[own.start + int(k) for k in np.flatnonzero(live & ~touched[own])],
                saturated_taxels=[own.start + int(k) for k in np.flatnonzero(saturated[own])],
                missing_readings=int(tally.missing[own].sum()),
            )
        )
    return Checkup(
        file=str(recording.source),
        format=recording.format,
        sensor=recording.sensor.name,
        unit=recording.sensor.unit,
        scans=tally.reading.scans,
        scans_promised=recording.scans,
        repeated_scans=tally.reading.repeated,
        duration_s=tally.last_s - tally.first_s,
        rate_hz=1 / tally.mean_step_s if tally.steps else None,
        jitter_s=tally.jitter_s if tally.steps else None,
        gaps=tally.gaps,
        longest_gap_s=tally.longest_gap_s,
        pads=pads,
        notes=tally.reading.notes,
        loss=str(tally.reading.loss) if tally.reading.loss else None,
    )


class _Tally:
    """Counts blocks as they pass, in constant memory; gaps are judged by the usual step of the first block."""

    def __init__(self, recording: Recording) -> None:
        taxels = recording.layout.taxels
        self.reading: Reading = recording.blocks()
        self.lowest = np.full(taxels, np.inf)
        self.highest = np.full(taxels, -np.inf)
        self.missing = np.zeros(taxels, dtype=np.int64)
        self.first_s = self.last_s = float("nan")
        self.steps = self.gaps = 0
        self.longest_gap_s = 0.0
        self.mean_step_s = self._squares = 0.0
        self._usual_s: float | None = None

    @property
    def jitter_s(self) -> float:
        return float(np.sqrt(max(self._squares / self.steps - self.mean_step_s**2, 0.0)))

    def count(self, blocks: Iterable[RawScans]) -> Iterator[RawScans]:
        for block in blocks:
            known = np.isfinite(block.values)
            self.lowest = np.minimum(self.lowest, np.min(block.values, axis=0, initial=np.inf, where=known))
            self.highest = np.maximum(self.highest, np.max(block.values, axis=0, initial=-np.inf, where=known))
            self.missing += (~known).sum(axis=0)
            before = block.t_s[:1] if np.isnan(self.last_s) else [self.last_s]
            self._time(np.diff(np.concatenate([before, block.t_s])))
            self.first_s = float(block.t_s[0]) if np.isnan(self.first_s) else self.first_s
            self.last_s = float(block.t_s[-1])
            yield block

    def _time(self, steps_s: Floats) -> None:
        steps_s = steps_s[steps_s > 0]
        if not len(steps_s):
            return
        if self._usual_s is None:
            self._usual_s = float(np.median(steps_s))
        gap = steps_s > _GAP * self._usual_s
        self.gaps += int(gap.sum())
        self.longest_gap_s = max(self.longest_gap_s, float(steps_s[gap].max(initial=0.0)))
        regular = steps_s[~gap]
        total = self.steps + len(regular)
        if len(regular):
            self.mean_step_s = (self.mean_step_s * self.steps + float(regular.sum())) / total
            self._squares += float(np.sum(regular**2))
            self.steps = total


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
