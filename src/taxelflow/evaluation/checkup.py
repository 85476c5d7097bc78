"""`taxelflow info`: content of a recording and faults of its sensor, from one pass over the file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.condition.converter import UNKNOWN_NOISE
from taxelflow.condition.parameters import Conditioner
from taxelflow.condition.units import full_scale, in_si
from taxelflow.errors import RecordingError
from taxelflow.evaluation.statistics import finite

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from taxelflow.acquire.base import Reading, Recording
    from taxelflow.condition.baseline import Baseline
    from taxelflow.condition.health import Finding
    from taxelflow.condition.session import ConditionSession
    from taxelflow.messages import RawScans
    from taxelflow.sensors.sensor import Sensor

_FEWEST_IDLE = 5
"""Fewest idle windows from which a drift is estimated."""


class TaxelFinding(msgspec.Struct, frozen=True):
    """A taxel that is faulty."""

    taxel: int
    row: int
    col: int
    fault: str
    """silent, stuck, noisy, offset, gain or line."""
    value: float
    """The reading (stuck, offset) or noise (noisy) in the sensor's unit, the share of readings missing (silent), the
    factor to its neighbours (gain, line)."""
    ratio: float | None
    """To what the pad's other taxels do."""
    scans: int
    """How many it was judged on."""
    words: str


class PadCheckup(msgspec.Struct, frozen=True):
    """One pad. Values in the sensor's unit; taxels by their number in the scan."""

    name: str
    table: bool
    """Its taxels are scattered: rows and cols are those of the picture."""
    rows: int
    cols: int
    taxels: int
    masked: int
    lowest: float | None
    highest: float | None
    noise: float | None
    tared: bool
    contact_scans: int
    """Counted in a sample of at most 512 windows of 12 scans, and scaled up where that is not all of them."""
    idle_taxels: list[int]
    """Never read above the contact threshold."""
    saturated_taxels: list[int]
    """Reached full scale, if the sensor declares one."""
    missing_readings: int
    idle_drift: float | None
    """Change of the idle pad's mean from the first scan to the last, by a straight line; None where the pad was idle
    too seldom, or is clipped while it is."""
    idle_drift_std: float | None
    """Standard error of the drift."""
    load_n: float | None
    """Largest force in the sample, N; None for a sensor without a scale."""
    findings: list[TaxelFinding]
    picture: list[list[float | None]]
    """Highest reading of each taxel less its offset, row by row from the top; None where there is no taxel, or no
    reading was known."""
    marks: list[str]
    """One letter a place, row by row: o well, . never loaded, F reached full scale, ! faulty, x masked; blank where
    there is no taxel."""

    @property
    def faults(self) -> list[str]:
        """The findings in words, one for each taxel, or one for a pad that is silent as a whole."""
        silent = [found for found in self.findings if found.fault == "silent"]
        if len(silent) < max(self.taxels, 2):
            return [found.words for found in self.findings]
        share, scans = min(found.value for found in silent), silent[0].scans
        return [f"all {self.taxels} taxels of {self.name} silent in {100 * share:.0f} % or more of {scans} scans"]


class Checkup(msgspec.Struct, frozen=True):
    """A whole recording."""

    file: str
    format: str
    sensor: str
    unit: str
    scans: int
    scans_promised: int | None
    repeated_scans: int
    """Scans with the stamp of the one before."""
    repeated_values: int
    """Scans with a stamp of their own that repeat the one before bit for bit, though they are too noisy to."""
    duration_s: float
    rate_hz: float | None
    """Of stamps, gaps left out."""
    new_rate_hz: float | None
    """Of scans that are new: below the rate of stamps if a logger repeats scans."""
    jitter_s: float | None
    """Standard deviation of the time steps, gaps left out."""
    gaps: int
    longest_gap_s: float
    pads: list[PadCheckup]
    notes: list[str]
    loss: str | None = None


def check_up(
    recording: Recording,
    watched: Callable[[Iterable[RawScans]], Iterable[RawScans]] = iter,
    condition: Conditioner | None = None,
) -> Checkup:
    """Read a recording once. `watched` may show progress. Raises what reading raises, ParameterInvalid."""
    tally = _Tally(recording)
    condition = condition or Conditioner()
    session = condition.start(recording.sensor, recording.masked, tally.count(watched(tally.reading)))
    if tally.fault is not None:
        raise tally.fault
    counts, learned = session.lookahead_counts, session.baseline
    if counts is None or learned is None:
        raise RuntimeError("a lookahead always teaches")
    seen = _Sampled(session, recording)
    rate_hz = 1 / counts.step_s if counts.step_s > 0 else None
    return Checkup(
        file=str(recording.source),
        format=recording.format,
        sensor=recording.sensor.name,
        unit=recording.sensor.unit,
        scans=tally.reading.scans,
        scans_promised=recording.scans,
        repeated_scans=tally.reading.repeated,
        repeated_values=counts.repeated,
        duration_s=tally.last_s - tally.first_s,
        rate_hz=rate_hz,
        new_rate_hz=1 / counts.usual_s if rate_hz else None,
        jitter_s=counts.step_std_s if rate_hz else None,
        gaps=counts.gaps,
        longest_gap_s=counts.longest_gap_s,
        pads=[
            _pad(pad, recording.sensor, learned, tally, seen, condition.contact_on)
            for pad in range(recording.layout.pad_count)
        ],
        notes=[*tally.reading.notes, *session.likely_faults(touched=bool(seen.contact_share.any()))],
        loss=str(tally.reading.loss) if tally.reading.loss else None,
    )


def _pad(
    number: int, sensor: Sensor, learned: Baseline, tally: _Tally, seen: _Sampled, contact_on: float
) -> PadCheckup:
    """contact_on: in standard deviations of the noise."""
    layout, to_si = sensor.layout, sensor.to_si
    own = layout.of_pad(number)
    live = ~learned.masked[own]
    most, offset, noise = tally.most[own], learned.offset[own], learned.noise[own]
    touched = most - offset > contact_on * noise
    typical = float(np.median(noise[live])) if live.any() else UNKNOWN_NOISE
    saturated = most >= full_scale(sensor)[own]
    findings = [found for found in learned.findings if own.start <= found.taxel < own.stop]
    bad = np.isin(np.arange(own.start, own.stop), [found.taxel for found in findings])
    rows, cols = layout.shapes[number]
    drift, drift_std = seen.drift(number, tally.last_s - tally.first_s)
    picture = layout.grid(number, np.where(np.isfinite(tally.most), tally.most - learned.offset, np.nan) / to_si)
    marks = np.full((rows, cols), " ")
    place = layout.row[own], layout.col[own]
    marks[place] = np.select([bad, ~live, saturated, touched], ["!", "x", "F", "o"], ".")
    return PadCheckup(
        name=layout.pads[number],
        table=bool(layout.tables[number]),
        rows=rows,
        cols=cols,
        taxels=len(live),
        masked=int(np.sum(~live)),
        lowest=finite(tally.lowest[own].min() + 0.0),  # never -0
        highest=finite(tally.highest[own].max() + 0.0),
        noise=typical / to_si if typical > UNKNOWN_NOISE else None,
        tared=bool(learned.tared[number]),
        contact_scans=round(seen.contact_share[number] * tally.reading.scans),
        idle_taxels=[own.start + int(k) for k in np.flatnonzero(live & ~touched)],
        saturated_taxels=[own.start + int(k) for k in np.flatnonzero(saturated)],
        missing_readings=int(tally.missing[own].sum()),
        idle_drift=None if drift is None else drift / to_si,
        idle_drift_std=None if drift_std is None else drift_std / to_si,
        load_n=finite(seen.load_n[number]),
        findings=[_finding(found, sensor) for found in findings],
        picture=[[finite(value) for value in row] for row in picture],
        marks=["".join(row) for row in marks],
    )


def _finding(found: Finding, sensor: Sensor) -> TaxelFinding:
    layout = sensor.layout
    in_unit = found.fault in ("stuck", "noisy", "offset")
    return TaxelFinding(
        taxel=found.taxel,
        row=int(layout.row[found.taxel]),
        col=int(layout.col[found.taxel]),
        fault=found.fault,
        value=found.value / sensor.to_si if in_unit else found.value,
        ratio=found.ratio,
        scans=found.scans,
        words=found.words(sensor),
    )


class _Sampled:
    """Contact, load and idle level of each pad in the sample that noise and tare were learned from."""

    def __init__(self, session: ConditionSession, recording: Recording) -> None:
        layout = recording.layout
        pads = layout.pad_count
        contact, scans = np.zeros(pads), 0
        newtons = layout.area_m2 if recording.sensor.si_unit == "Pa" else np.nan  # counts are no force
        self.load_n = np.full(pads, np.nan)
        starts_s, levels = [], []
        for block in filter(len, session.sampled()):
            touching = block.contact[:, :pads]
            contact += touching.sum(axis=0)
            scans += len(block)
            force = np.add.reduceat(block.pressure * newtons, layout.starts[:-1], axis=1)
            loaded = np.where(block.contact & block.complete, force, np.nan)[:, :pads]
            self.load_n = np.fmax(self.load_n, np.fmax.reduce(loaded, axis=0))
            level = np.add.reduceat(block.pressure, layout.starts[:-1], axis=1)[:, :pads].mean(axis=0)
            starts_s.append(block.t_s[0])
            levels.append(np.where(touching.any(axis=0), np.nan, level / np.diff(layout.starts)[:pads]))
        self.contact_share = contact / max(scans, 1)
        self._starts_s = np.array(starts_s)
        self._levels = np.array(levels).reshape(-1, pads)

    def drift(self, pad: int, duration_s: float) -> tuple[float | None, float | None]:
        """Change of the idle level over the whole recording, and its standard error, in SI."""
        idle = np.isfinite(self._levels[:, pad])
        t, level = self._starts_s[idle], self._levels[idle, pad]
        if len(t) < _FEWEST_IDLE or np.ptp(level) == 0.0:
            return None, None
        (slope, _), covariance = np.polyfit(t - t[0], level, 1, cov=True)
        return float(slope) * duration_s, float(np.sqrt(covariance[0, 0])) * duration_s


class _Tally:
    """Extremes and missing readings of all scans as they pass, in constant memory.

    lowest, highest: (taxels,) in the sensor's unit. most: (taxels,) highest in SI.
    """

    def __init__(self, recording: Recording) -> None:
        taxels = recording.layout.taxels
        self.reading: Reading = recording.blocks()
        self.lowest = np.full(taxels, np.inf)
        self.highest = np.full(taxels, -np.inf)
        self.most = np.full(taxels, -np.inf)
        self.missing = np.zeros(taxels, dtype=np.int64)
        self.first_s = self.last_s = float("nan")
        self.fault: RecordingError | None = None
        self._sensor = recording.sensor

    def count(self, blocks: Iterable[RawScans]) -> Iterator[RawScans]:
        """Pass blocks on; note what ends them early."""
        try:
            for block in blocks:
                si = in_si(block.values, self._sensor)
                known = np.isfinite(si)
                self.lowest = np.minimum(self.lowest, np.min(block.values, axis=0, initial=np.inf, where=known))
                self.highest = np.maximum(self.highest, np.max(block.values, axis=0, initial=-np.inf, where=known))
                self.most = np.maximum(self.most, np.max(si, axis=0, initial=-np.inf, where=known))
                self.missing += (~known).sum(axis=0)
                self.first_s = float(block.t_s[0]) if np.isnan(self.first_s) else self.first_s
                self.last_s = float(block.t_s[-1])
                yield block
        except RecordingError as fault:
            self.fault = fault
            raise
