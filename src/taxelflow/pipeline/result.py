"""The result of a run over a recording: arrays, events and summary in memory."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from taxelflow.errors import ExtraMissing, NameUnknown
from taxelflow.messages import QUALITY, Bools, Contacts, Event, Floats, LearnedPattern, Motions, Slips, SpatialMotions
from taxelflow.publish.columns import slip_columns
from taxelflow.publish.contact_summary import ContactSummary
from taxelflow.publish.contact_table import contact_table
from taxelflow.publish.summary import Summary
from taxelflow.publish.tables import Tables
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pandas

    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class PadResult:
    """Results of one pad, group or separate contact: arrays over scans, in its frame; NaN where unknown.

    name: of the pad. t_s: (scans,), s. contact, slipping: (scans,), bool. border: (scans, 2), whether the contact
    reaches a border that faces x, y. displacement, pose, velocity: (scans, 3), x, y, theta in m, m, rad (per s).
    covariance: (scans, 3, 3) of the pose. lag_s: (scans,), age of the pose. load: (scans,), Pa or counts. evidence:
    (scans,), log odds of a slip by the change of the pattern. quality: (scans,), of the pose: `ok`, `ambiguous`,
    `unresolved`, `lost`, or empty without a pose. events, contacts and patterns are those of the pad.
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
    """All results from one recording, in memory. `result["palm"]` has the arrays of one pad.

    sensor: with the layout. slips: arrays (scans, pads), with `pads` in that order: pads, groups, and contacts that are
    separated; slipping: (scans, pads). `motions` is the object's motion per scan, `contacts` the features of each pad's
    contact, `patterns` the learned pressure maps, `summary` the content of `summary.json`, `evidence`
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
