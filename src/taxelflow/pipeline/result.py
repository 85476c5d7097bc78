"""The result of a run over a recording: arrays, events and summary in memory."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, cast

import msgspec
import numpy as np

from taxelflow.acquire.joints import declared_joints
from taxelflow.errors import ExtraMissing, NameUnknown
from taxelflow.estimation.smoothing.parameters import NOTE
from taxelflow.messages import QUALITY, Bools, Contacts, Event, Floats, LearnedPattern, Motions, Slips, SpatialMotions
from taxelflow.publish.contact_summary import ContactSummary
from taxelflow.publish.contact_table import contact_table
from taxelflow.publish.summary import Summary, Totals
from taxelflow.publish.tables import Tables, slip_columns
from taxelflow.runtime import registry
from taxelflow.sensors.kinematics import hand_model

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pandas

    from taxelflow.acquire.base import Recording
    from taxelflow.condition.baseline import Baseline
    from taxelflow.pipeline.stages import Pipeline, Run
    from taxelflow.sensors.sensor import Sensor

_MOST_FINDINGS = 4
"""Taxels that a note names."""
_MANY_REPEATED = 0.1
"""Share of scans with a repeated stamp above which a note reports them."""


@dataclass(frozen=True, slots=True, eq=False)
class PadResult:
    """What one pad, group or separate contact gave: arrays over scans, in its frame; NaN where unknown.

    name: of the pad. t_s: (scans,), s. contact, slipping: (scans,). border: (scans, 2), whether the contact reaches a
    border that faces x, y. displacement, pose, velocity: (scans, 3), x, y, theta in m, m, rad (per s). covariance:
    (scans, 3, 3) of the pose. lag_s: (scans,), age of the pose. load: (scans,), Pa or counts. evidence: (scans,), log
    odds of a slip by the change of the pattern. quality: (scans,), of the pose, as text. events, contacts and
    patterns are those of the pad.
    """

    name: str
    t_s: Floats
    contact: Bools
    slipping: Bools
    border: Bools
    displacement: Floats
    pose: Floats
    velocity: Floats
    covariance: Floats
    lag_s: Floats
    load: Floats
    evidence: Floats
    quality: np.ndarray[Any, np.dtype[np.str_]]
    events: list[Event]
    contacts: list[ContactSummary]
    patterns: list[LearnedPattern]

    def __repr__(self) -> str:
        return f"<PadResult {self.name}: {len(self.t_s)} scans, {_counted(self.contacts)}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Result:
    """Everything that a recording gave, in memory. `result["palm"]` has the arrays of one pad.

    sensor: with the layout. slips: arrays (scans, pads), with `pads` in that order: pads, groups, and contacts that are
    separated; slipping: (scans, pads). `motions` is the object's motion per scan, `contacts` what each pad's contact is
    like, `patterns` what a method that learns has learned, `summary` what `summary.json` holds, `evidence`
    (scans, pads) the log odds of a slip by the change of the pattern, NaN where unknown. `spatial` is the object's
    motion in space, None where the places of the pads in space are unknown.
    """

    sensor: Sensor
    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]
    patterns: list[LearnedPattern]
    summary: Summary
    contacts: Contacts
    evidence: Floats
    spatial: SpatialMotions | None = None

    @property
    def pads(self) -> tuple[str, ...]:
        """Names along the second axis of the arrays."""
        return self.sensor.layout.pads

    def __getitem__(self, pad: str) -> PadResult:
        """One pad, group or separate contact. Raises NameUnknown."""
        if pad not in self.pads:
            raise NameUnknown("pad", pad, self.pads)
        number, slips = self.pads.index(pad), self.slips
        return PadResult(
            name=pad,
            t_s=slips.t_s,
            contact=slips.contact[:, number],
            slipping=self.slipping[:, number],
            border=slips.border[:, number],
            displacement=slips.displacement[:, number],
            pose=slips.pose[:, number],
            velocity=slips.velocity[:, number],
            covariance=slips.covariance[:, number],
            lag_s=slips.lag_s[:, number],
            load=slips.load[:, number],
            evidence=self.evidence[:, number],
            quality=np.array(QUALITY)[slips.quality[:, number]],
            events=[event for event in self.events if event.pad == pad],
            contacts=[contact for contact in self.summary.contacts if contact.pad == pad],
            patterns=[pattern for pattern in self.patterns if pattern.pad == pad],
        )

    def __iter__(self) -> Iterator[str]:
        """Names of the pads."""
        return iter(self.pads)

    def __repr__(self) -> str:
        own = set(self.pads[: self.sensor.layout.pad_count])
        contacts = [contact for contact in self.summary.contacts if contact.pad in own]
        return f"<Result {self._title()}, {_counted(contacts)}>"

    def _repr_html_(self) -> str:
        """Title and contacts as notebooks show them."""
        table = contact_table(self.summary)
        head = "".join(f"<th>{escape(heading.rstrip(':')).replace(chr(10), '<br>')}</th>" for heading in table.headings)
        rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
        more = f"<p>{table.hidden} more contacts in result.summary.contacts</p>" if table.hidden else ""
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.summary.notes)
        return f"<p>{escape(self._title())}</p><table><tr>{head}</tr>{rows}</table>{more}{notes}"

    def to_dataframe(self) -> pandas.DataFrame:
        """The columns of `slips.csv` as a pandas DataFrame, a row per scan and pad. Raises ExtraMissing."""
        try:
            import pandas
        except ImportError as error:
            raise ExtraMissing("tables", "pandas") from error
        return pandas.DataFrame(slip_columns(self.slips, self.slipping, self.evidence, self.pads))

    def save(self, directory: str | Path) -> Path:
        """Write what `taxelflow estimate --out` writes, and return the directory. Raises OSError."""
        directory = Path(directory)
        with Tables(directory, self.pads) as tables:
            tables.write(self.slips, self.slipping, self.motions, self.events, self.contacts, self.evidence)
            if self.spatial is not None:
                tables.write_spatial(self.spatial)
            tables.write_patterns(self.patterns)
            tables.write_summary(self.summary)
        return directory

    def plot(self, directory: str | Path, format: Literal["svg", "png", "pdf"] = "svg") -> list[Path]:  # noqa: A002
        """Draw what `taxelflow plot` draws into a directory, and return the files.

        Truth and scans are drawn where the recording is a file. Raises ResultMissing where no position is known,
        ParameterInvalid, ExtraMissing.
        """
        draw = registry.find("drawing", "results")
        with TemporaryDirectory() as saved:
            return cast("list[Path]", draw([self.save(saved)], Path(directory), format))

    def _title(self) -> str:
        return f"{self.summary.method}: {len(self.slips)} scans of {self.summary.sensor}"


def _counted(contacts: list[ContactSummary]) -> str:
    """Contacts, their slips and the path in words."""
    slips = sum(contact.slips for contact in contacts)
    paths = [contact.path_m for contact in contacts if contact.path_m]
    path = f" over {1e3 * sum(paths):.1f} mm" if paths else ""
    return f"{len(contacts)} contact{'' if len(contacts) == 1 else 's'}, {slips} slip{'' if slips == 1 else 's'}{path}"


def summarise(method: str, pipeline: Pipeline, run: Run, totals: Totals) -> Summary:
    """What a finished run amounts to."""
    recording, learned = run.recording, run.learned
    layout = recording.layout
    pads = {}
    contacts = totals.contacts()
    masked: list[int] = []
    notes = list(run.reading.notes)
    if learned is not None:
        masked = [int(taxel) for taxel in np.flatnonzero(learned.masked)]
        for number, name in enumerate(totals.pads):
            live = learned.noise[layout.source[layout.of_pad(number)]]
            live = live[live > 0]
            noise = float(np.median(live)) if len(live) else None
            home = int(np.searchsorted(layout.starts, layout.source[layout.starts[number]], side="right")) - 1
            tared, scatter = bool(learned.tared[home]), float(run.scatter[number])
            pads[name] = totals.of_pad(number, contacts, tared=tared, noise=noise, scatter=scatter)
    notes += run.likely_faults(touched=bool(totals.contact_scans.any()))
    untared = [name for name, pad in pads.items() if not pad.tared and pad.contact_scans]
    if untared and pipeline.condition.tare == "auto":
        notes.append(f"not tared, because no idle scans were found: {', '.join(untared)}")
    if pipeline.calibration is not None:
        known = {pad.name for pad in pipeline.calibration.pads}
        own = totals.pads[: layout.pad_count]
        if bare := [name for name in own if name in pads and pads[name].contact_scans and name not in known]:
            notes.append(f"not in the calibration, so at gain 1: {', '.join(bare)}")
    if learned is not None:
        notes += _of_taxels(recording, learned)
    counts = run.counts
    rate_hz = 1 / counts.usual_s if counts.usual_s > 0 else None
    if counts.repeated:
        notes.append(
            f"dropped {counts.repeated} scans that repeat the one before bit for bit: {rate_hz:.4g} scans/s are new"
        )
    if run.reading.repeated > _MANY_REPEATED * totals.scans:
        notes.append(
            f"dropped {run.reading.repeated} scans with the time stamp of the one before, {totals.scans} are left: if"
            " their readings differ, the stamps are too coarse"
        )
    if counts.gaps:
        gaps = "1 gap" if counts.gaps == 1 else f"{counts.gaps} gaps, the longest"
        notes.append(f"{gaps} of {counts.longest_gap_s:.3g} s: no motion is followed across it")
    if run.lag_s:
        notes.append(f"filtered over time: every lag_s is {1e3 * run.lag_s:.3g} ms longer for it")
    notes += run.notes
    if pipeline.smooth.acceleration_m_s2:
        notes.append(NOTE)
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
        masked_taxels=masked,
        pads=pads,
        events=dict(totals.events),
        notes=notes,
        layout=recording.sensor,
        loss=str(run.reading.loss) if run.reading.loss else None,
        repeated_values_dropped=counts.repeated,
        rate_hz=rate_hz,
        gaps=counts.gaps,
        contacts=contacts,
        joints=_joint_ranges(recording, totals.t_first_s, totals.t_last_s),
    )


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
