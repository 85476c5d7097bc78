"""Terminal output of a live run: a screen while it runs, and its totals at the end."""

from __future__ import annotations

import math
import sys
import time
from typing import IO, TYPE_CHECKING

import numpy as np
from rich.console import Console, Group
from rich.live import Live as Screen
from rich.text import Text

from taxelflow.messages import QUALITY
from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

    from rich.table import Table

    from taxelflow.pipeline.live.loop import Report

_ARROWS = "→↗↑↖←↙↓↘"
_SAME_CLOCK_S = 1e6
"""Clocks farther apart have different zeros: the offset means nothing."""


class StatusScreen:
    """A screen on stderr that is redrawn several times a second; nothing where nobody watches."""

    def __init__(self, *, quiet: bool) -> None:
        self._screen: Screen | None = None
        if not quiet and sys.stderr.isatty():
            self._screen = Screen(console=Console(stderr=True), auto_refresh=False, transient=True)
        self._rate = Rate()

    def __enter__(self) -> Self:
        if self._screen is not None:
            self._screen.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._screen is not None:
            self._screen.__exit__(kind, error, trace)

    def show(self, report: Report) -> None:
        """Draw."""
        if self._screen is None:
            return
        self._screen.update(drawn(report, self._rate.of(report)), refresh=True)


class Rate:
    """Scans a second, counted over each second."""

    def __init__(self) -> None:
        self._scans, self._at_s = 0, time.monotonic()
        self._rate_hz = math.nan

    def of(self, report: Report) -> float:
        """Hz; NaN within the first second."""
        now = time.monotonic()
        if now - self._at_s >= 1.0:
            self._rate_hz = (report.intake.scans_in - self._scans) / (now - self._at_s)
            self._scans, self._at_s = report.intake.scans_in, now
        return self._rate_hz


def drawn(report: Report, rate_hz: float) -> Group:
    """The screen of a run."""
    head = f"{report.source.recording.source}: {intake_words(report, rate_hz)}"
    parts: list[Text | Table] = [Text(head, no_wrap=True)]
    if report.latest is not None:
        parts.append(_pads(report))
        parts.append(Text(f"latency to the estimate: {report.estimated.words()}"))
    parts += [
        Text(_sink_line(worker.label, worker.published, worker.dropped, worker.ended)) for worker in report.workers
    ]
    parts += [Text(f"{event.t_s:10.3f} s  {event.pad}: {event.event}") for event in report.events]
    faults = ", ".join(f"{kind} {count}" for kind, count in report.source.faults.counts.items())
    if faults:
        parts.append(Text(faults, style="yellow"))
    return Group(*parts)


def intake_words(report: Report, rate_hz: float) -> str:
    """What the source sends, and what of it is lost."""
    intake = report.intake
    step, jitter = intake.timeline.usual_s, intake.timeline.jitter_s
    return (
        f"{intake.scans_in} scans"
        + ("" if math.isnan(rate_hz) else f", {rate_hz:.1f} Hz")
        + ("" if math.isnan(step) else f", step {1e3 * step:.2f} ms, jitter {1e3 * jitter:.2f} ms")
        + f", {intake.timeline.gaps} gaps, {intake.dropped} dropped, {intake.waiting} waiting"
    )


def _pads(report: Report) -> Table:
    """Contact and motion of each pad; an arrow for the way it slips."""
    table = quiet_table("pad:", "contact:", "x mm", "y mm", "mm/s", "slip:", "quality:")
    slips, slipping = report.latest.output.slips, report.latest.output.slipping  # type: ignore[union-attr]
    for pad, name in enumerate(report.pads):
        velocity = slips.velocity[-1, pad]
        speed = 1e3 * math.hypot(*velocity[:2].tolist())
        arrow = ""
        if slipping[-1, pad] and math.isfinite(speed):
            arrow = _ARROWS[round(math.atan2(velocity[1], velocity[0]) / (math.pi / 4)) % 8]
        place = ["" if np.isnan(m) else f"{1e3 * m:+.2f}" for m in slips.pose[-1, pad, :2].tolist()]
        moved = "" if math.isnan(speed) else f"{speed:.1f}"
        quality = QUALITY[slips.quality[-1, pad]]
        table.add_row(Text(name), "●" if slips.contact[-1, pad] else "", *place, moved, arrow, quality)
    return table


def _sink_line(label: str, published: int, dropped: int, ended: bool) -> str:
    return f"{label}: {published} published, {dropped} dropped" + (", ended" if ended else "")


def totals(report: Report) -> list[str]:
    """The totals of a run as lines `what: number, ...`."""
    intake = report.intake
    published = ", ".join(f"{worker.label} {worker.published}" for worker in report.workers) or "nothing"
    dropped = ", ".join(f"{worker.label} {worker.dropped}" for worker in report.workers if worker.dropped)
    faults = ", ".join(f"{kind} {count}" for kind, count in sorted(report.source.faults.counts.items())) or "none"
    lines = [
        f"scans in: {intake.scans_in}",
        f"dropped: {intake.dropped}" + (f" (sinks: {dropped})" if dropped else ""),
        *([f"repeated: {report.repeated} (bit for bit the scan before)"] if report.repeated else []),
        f"published: {published}",
        f"gaps: {intake.timeline.gaps}",
        f"faults: {faults}",
    ]
    if len(report.estimated):
        lines.append(f"latency to the estimate: {report.estimated.words()}")
    lines += [
        f"latency to {worker.label}: {worker.latencies.words()}" for worker in report.workers if len(worker.latencies)
    ]
    offset_s, drift = intake.timeline.offset_s, intake.timeline.skew.drift_ppm
    if math.isfinite(offset_s):
        lines.append(clock_words(offset_s, drift))
    return lines


def clock_words(offset_s: float, drift_ppm: float) -> str:
    """The sensor's clock against the computer's. drift_ppm: by how much it is slow; NaN if unknown."""
    pace = "slow" if drift_ppm > 0 else "fast"
    drift = "" if math.isnan(drift_ppm) else f", {abs(drift_ppm):.1f} ppm {pace} against it"
    if abs(offset_s) >= _SAME_CLOCK_S:
        return f"sensor's clock: counts from a time of its own{drift}"
    side = "behind" if offset_s > 0 else "ahead of"
    return f"sensor's clock: {abs(offset_s):.6f} s {side} the computer's{drift}"


def say_totals(report: Report, file: IO[str]) -> None:
    """Print the totals."""
    for line in totals(report):
        print(line, file=file)
