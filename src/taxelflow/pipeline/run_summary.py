"""The summary of a run: what `summary.json` holds, with notes on what a user should know."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import msgspec
import numpy as np

from taxelflow.acquire.columns import Columns
from taxelflow.acquire.joints import declared_joints
from taxelflow.errors import ExtraMissing
from taxelflow.estimation.smoothing.parameters import NOTE
from taxelflow.publish.contact_summary import ContactSummary
from taxelflow.publish.summary import PadSummary, Summary, Totals
from taxelflow.sensors.kinematics import hand_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.acquire.base import Recording
    from taxelflow.condition.baseline import Baseline
    from taxelflow.pipeline.stages import Pipeline, Run

_MOST_FINDINGS = 4
"""Taxels that a note names."""
_MANY_REPEATED = 0.1
"""Share of scans with a repeated stamp above which a note reports them."""


def summarise(method: str, pipeline: Pipeline, run: Run, totals: Totals) -> Summary:
    """What a finished run amounts to."""
    recording, learned, counts = run.recording, run.learned, run.counts
    contacts = totals.contacts()
    pads = {} if learned is None else _summaries_of_pads(run, learned, totals, contacts)
    return Summary(
        taxelflow=version("taxelflow"),
        input=str(recording.source.absolute() if isinstance(recording.source, Path) else recording.source),
        format=recording.format,
        sensor=recording.sensor.name,
        unit=recording.sensor.si_unit,
        method=method,
        mode=pipeline.mode,
        parameters={
            "method": asdict(cast("Any", pipeline.estimator)),
            "condition": asdict(pipeline.condition),
            "monitor": asdict(pipeline.monitor),
            "fusion": asdict(pipeline.fusion),
            "features": asdict(pipeline.features),
            "smooth": asdict(pipeline.smooth),
            "spatial": asdict(pipeline.spatial),
        }
        | ({} if pipeline.calibration is None else {"calibration": msgspec.to_builtins(pipeline.calibration)}),
        scans=totals.scans,
        repeated_scans_dropped=run.reading.repeated,
        t_first_s=totals.t_first_s,
        t_last_s=totals.t_last_s,
        contact=bool(totals.contact_scans.any()),
        masked_taxels=[] if learned is None else np.flatnonzero(learned.masked).tolist(),
        pads=pads,
        events=dict(totals.events),
        notes=[
            *run.reading.notes,
            *run.likely_faults(touched=bool(totals.contact_scans.any())),
            *_of_pads(pipeline, pads, totals.pads[: recording.layout.pad_count]),
            *([] if learned is None else _of_taxels(recording, learned)),
            *_of_times(run, totals.scans),
            *run.notes,
            *([NOTE] if pipeline.smooth.acceleration_m_s2 else []),
        ],
        layout=recording.sensor,
        asked={
            name: value.recorded() if isinstance(value, Columns) else value for name, value in recording.asked.items()
        },
        loss=str(run.reading.loss) if run.reading.loss else None,
        repeated_values_dropped=counts.repeated,
        rate_hz=1 / counts.usual_s if counts.usual_s > 0 else None,
        gaps=counts.gaps,
        contacts=contacts,
        joints=_joint_ranges(recording, totals.t_first_s, totals.t_last_s),
    )


def _summaries_of_pads(
    run: Run, learned: Baseline, totals: Totals, contacts: list[ContactSummary]
) -> dict[str, PadSummary]:
    """By name, of all pads, groups and separate contacts. contacts: of all of them."""
    layout, found = run.recording.layout, {}
    for number, name in enumerate(totals.pads):
        live = learned.noise[layout.source[layout.of_pad(number)]]
        live = live[live > 0]
        noise = float(np.median(live)) if len(live) else None
        home = int(np.searchsorted(layout.starts, layout.source[layout.starts[number]], side="right")) - 1
        tared, scatter = bool(learned.tared[home]), float(run.scatter[number])
        found[name] = totals.of_pad(number, contacts, tared=tared, noise=noise, scatter=scatter)
    return found


def _of_pads(pipeline: Pipeline, pads: dict[str, PadSummary], own: Sequence[str]) -> list[str]:
    """Notes on pads with contact that have no tare, or, of those of the sensor itself (own), no calibration."""
    notes, touched = [], {name: pad for name, pad in pads.items() if pad.contact_scans}
    untared = [name for name, pad in touched.items() if not pad.tared]
    if untared and pipeline.condition.tare == "auto":
        notes.append(
            f"not tared, because no idle scans were found: {', '.join(untared)}; if nothing touched the sensor at the"
            " start, add --condition.tare start"
        )
    if pipeline.calibration is not None:
        known = {pad.name for pad in pipeline.calibration.pads}
        if bare := [name for name in own if name in touched and name not in known]:
            notes.append(f"not in the calibration, so at gain 1: {', '.join(bare)}")
    return notes


def _of_times(run: Run, scans: int) -> list[str]:
    """Notes on repeated scans and stamps, gaps, and what filters add to the lag. scans: those that are left."""
    counts, notes = run.counts, []
    if counts.repeated:
        rate = f"{1 / counts.usual_s:.4g} scans/s are new"
        notes.append(f"dropped {counts.repeated} scans that repeat the one before bit for bit: {rate}")
    if run.reading.repeated > _MANY_REPEATED * scans:
        notes.append(
            f"dropped {run.reading.repeated} scans with the time stamp of the one before, {scans} are left: if"
            " their readings differ, the stamps are too coarse"
        )
    if counts.gaps:
        gaps = "1 gap" if counts.gaps == 1 else f"{counts.gaps} gaps, the longest"
        notes.append(f"{gaps} of {counts.longest_gap_s:.3g} s: no motion is followed across it")
    if run.lag_s:
        notes.append(f"filtered over time: every lag_s is {1e3 * run.lag_s:.3g} ms longer for it")
    return notes


def _joint_ranges(recording: Recording, first_s: float, last_s: float) -> dict[str, list[float]]:
    """Smallest and largest angle of each joint of the hand between two times, rad (m for a slide)."""
    joints, hand = recording.joints or declared_joints(recording.sensor), recording.sensor.hand
    if joints is None or hand is None or all(pad.link is None for pad in recording.sensor.pads):
        return {}
    names = joints.names
    with suppress(ExtraMissing):
        names = hand_model(hand.urdf, hand.base, recording.sensor.name).joints
    t_s = joints.t_s[(joints.t_s > first_s) & (joints.t_s < last_s)]
    angles = joints.at(np.array([first_s, *t_s, last_s]), names)
    known = [(name, column[np.isfinite(column)]) for name, column in zip(names, angles.T, strict=True)]
    return {name: [float(column.min()), float(column.max())] for name, column in known if len(column)}


def _of_taxels(recording: Recording, learned: Baseline) -> list[str]:
    """Notes on masked taxels and on those that are faulty."""
    judged = {finding.taxel for finding in learned.findings}
    silent = np.flatnonzero(learned.masked & ~recording.masked)
    asked = [int(taxel) for taxel in silent if taxel not in judged]
    sensor = recording.sensor
    notes = [f"masked besides what the recording declares off: taxels {', '.join(map(str, asked))}"] if asked else []
    for masked, what in (
        (True, "masked"),
        (False, "faulty, and still used (leave them out with --condition.mask auto)"),
    ):
        found = [finding for finding in learned.findings if learned.masked[finding.taxel] == masked]
        if found:
            words = "; ".join(finding.words(sensor) for finding in found[:_MOST_FINDINGS])
            rest = len(found) - _MOST_FINDINGS
            notes.append(f"{what}: {words}" + (f"; and {rest} more, see `taxelflow info`" if rest > 0 else ""))
    return notes
