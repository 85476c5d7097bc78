"""Results as CSV files: rows stand in `*.csv.part` while a run lasts, and are renamed at its end."""

from __future__ import annotations

import csv
from contextlib import ExitStack, suppress
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from taxelflow.errors import TaxelflowError, written_at
from taxelflow.messages import QUALITY
from taxelflow.publish.patterns import NAME as PATTERNS
from taxelflow.publish.patterns import write_patterns
from taxelflow.publish.spatial import COLUMNS, spatial_rows
from taxelflow.publish.spatial import NAME as SPATIAL
from taxelflow.publish.summary import to_json
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from io import TextIOBase

    from taxelflow.messages import Bools, Contacts, Event, Floats, LearnedPattern, Motions, Slips, SpatialMotions
    from taxelflow.publish.summary import Summary

# fmt: off
SLIPS = (
    "t_s", "pad", "contact", "dx_m", "dy_m", "dtheta_rad", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s",
    "omega_rad_s", "std_x_m", "std_y_m", "std_theta_rad", "slipping", "border_x", "border_y", "lag_s",
    "load_pa", "cov_xy", "cov_xtheta", "cov_ytheta", "quality", "evidence",
)
OBJECT = (
    "t_s", "vx_m_s", "vy_m_s", "omega_rad_s", "rotor_1_s", "cx_m", "cy_m", "x_m", "y_m", "theta_rad", "pads",
    "std_vx_m_s", "std_vy_m_s", "std_omega_rad_s", "std_rotor_1_s", "std_cx_m", "std_cy_m",
    "std_x_m", "std_y_m", "std_theta_rad",
)
CONTACTS = (
    "t_s", "pad", "force_n", "area_m2", "peak_pa", "x_m", "y_m", "major_m", "minor_m", "eccentricity",
    "orientation_rad", "std_force_n", "std_orientation_rad",
)
EVENTS = (
    "t_s", "pad", "event", "onset_s", "direction_rad", "speed_m_s", "turn_rad_s", "evidence", "quality",
    "path_m", "turn_rad", "duration_s", "std_speed_m_s", "std_path_m", "std_turn_rad", "std_duration_s",
)
# fmt: on
_MOTION = EVENTS[EVENTS.index("path_m") :]
_TABLES = {"slips": SLIPS, "object": OBJECT, "events": EVENTS, "contacts": CONTACTS}
FILES = (*(f"{name}.csv" for name in (*_TABLES, SPATIAL)), PATTERNS, "summary.json")
"""Names of all files of a run."""


class Tables:
    """Writes a run's messages to a directory, block by block; a context that renames the files if all went well.

    If it ends by an exception, the rows written so far stay in the `.part` files. opened: how these are opened.
    flushes_first: write the headers at once, so that a full disk is found before the work; not for files that wait for
    room.
    """

    def __init__(
        self,
        directory: Path,
        pads: tuple[str, ...],
        opened: Callable[[Path], TextIOBase] | None = None,
        *,
        flushes_first: bool = True,
    ) -> None:
        self.directory, self._pads = directory, pads
        self._opened, self._flushes_first = opened or _opened, flushes_first
        self._files: dict[str, Any] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self.directory.mkdir(parents=True, exist_ok=True)
        try:
            with written_at(self.directory):
                self._open()
        except (OSError, TaxelflowError):
            with suppress(OSError):  # closing a file on a full disk fails again
                self._stack.close()
            raise
        for older in FILES:
            (self.directory / older).unlink(missing_ok=True)  # what stands here after a failure is of this run
        return self

    def _open(self) -> None:
        for name, columns in _TABLES.items():
            self._begin(name, columns)
        if self._flushes_first:
            self._flush()

    def _begin(self, name: str, columns: Sequence[str]) -> None:
        self._files[name] = file = self._stack.enter_context(self._opened(self.directory / f"{name}.csv.part"))
        csv.writer(file, lineterminator="\n").writerow(columns)

    def __exit__(self, kind: type[BaseException] | None, *_details: object) -> None:
        with written_at(self.directory):
            self._stack.close()
            for name in self._files if kind is None else ():
                part = self.directory / f"{name}.csv.part"
                part.replace(part.with_suffix(""))

    def write(
        self,
        slips: Slips,
        slipping: Bools,
        motions: Motions,
        events: list[Event],
        contacts: Contacts,
        evidence: Floats,
    ) -> None:
        """Append one block; it is on disk when this returns."""
        with written_at(self.directory):
            self._append("slips", _slip_rows(slips, slipping, evidence, self._pads))
            self._append("object", _motion_rows(motions))
            self._append("events", map(_event_row, events))
            self._append("contacts", _contact_rows(contacts, self._pads))
            self._flush()

    def write_spatial(self, motions: SpatialMotions) -> None:
        """Append one block to `object3d.csv`, which there is only where the pads' places in space are known."""
        with written_at(self.directory):
            if SPATIAL not in self._files:
                self._begin(SPATIAL, COLUMNS)
            self._append(SPATIAL, spatial_rows(motions, self._pads))
            self._flush()

    def write_summary(self, summary: Summary) -> None:
        """Write `summary.json`, whole or not at all."""
        with whole_file(self.directory / "summary.json") as part:
            part.write_bytes(to_json(summary))

    def write_patterns(self, patterns: Sequence[LearnedPattern]) -> None:
        """Write `patterns.npz`, if there are any, whole or not at all."""
        if patterns:
            write_patterns(patterns, self.directory / PATTERNS)

    def _append(self, name: str, rows: Iterable[Iterable[str]]) -> None:
        csv.writer(self._files[name], lineterminator="\n").writerows(rows)

    def _flush(self) -> None:
        for file in self._files.values():
            file.flush()


def _opened(path: Path) -> TextIOBase:
    return path.open("w", newline="", encoding="utf-8")


_JUDGED = np.array([judged or None for judged in QUALITY], dtype=object)
"""Words of quality by number; None where there is no pose to judge."""


def slip_columns(slips: Slips, slipping: Bools, evidence: Floats, pads: tuple[str, ...]) -> dict[str, Any]:
    """The columns of `slips.csv`, each (scans * pads,): flags as bool, quality as text or None, NaN where
    unknown.
    """
    std = np.sqrt(np.diagonal(slips.covariance, axis1=2, axis2=3))
    vectors = [slips.displacement, slips.pose, slips.velocity, std]
    covariance = slips.covariance
    of_pads = [
        slips.contact,
        *(vector[..., axis] for vector in vectors for axis in range(3)),
        slipping,
        slips.border[..., 0],
        slips.border[..., 1],
        slips.lag_s,
        slips.load,
        covariance[..., 0, 1],
        covariance[..., 0, 2],
        covariance[..., 1, 2],
        _JUDGED[slips.quality],
        evidence,
    ]
    times, names = np.repeat(slips.t_s, len(pads)), np.tile(np.array(pads), len(slips))
    return dict(zip(SLIPS, [times, names, *(column.reshape(-1) for column in of_pads)], strict=True))


def _slip_rows(slips: Slips, slipping: Bools, evidence: Floats, pads: tuple[str, ...]) -> Iterable[list[str]]:
    count = len(slips) * len(pads)
    std = np.sqrt(np.diagonal(slips.covariance, axis1=2, axis2=3))
    numbers = np.concatenate([slips.displacement, slips.pose, slips.velocity, std], axis=2).reshape(count, 12)
    flags = [flag.reshape(count) for flag in (slips.contact, slipping, slips.border[..., 0], slips.border[..., 1])]
    times = [f"{t:.6f}" for t in slips.t_s]
    covariance = slips.covariance
    mixed = [covariance[..., 0, 1], covariance[..., 0, 2], covariance[..., 1, 2]]
    last = np.stack([slips.lag_s, slips.load, *mixed, evidence], axis=2).reshape(count, 6)
    quality = slips.quality.reshape(count).tolist()
    for row, (values, contact, slips_now, border_x, border_y, ends, judged) in enumerate(
        zip(numbers.tolist(), *(flag.tolist() for flag in flags), last.tolist(), quality, strict=True)
    ):
        scan, pad = divmod(row, len(pads))
        yield [
            times[scan],
            pads[pad],
            _FLAG[contact],
            *map(_number, values),
            _FLAG[slips_now],
            _FLAG[border_x],
            _FLAG[border_y],
            *map(_number, ends[:-1]),
            QUALITY[judged],
            _number(ends[-1]),
        ]


def motion_columns(motions: Motions) -> Iterable[list[float]]:
    """Rows of `OBJECT` as numbers; the number of pads is whole."""
    known, doubt = np.empty((len(motions), 9)), np.empty((len(motions), 9))
    known[:, :3], known[:, 3], known[:, 4:6] = motions.velocity, motions.rotor, motions.centre
    known[:, 6:] = motions.pose
    np.sqrt(motions.velocity_covariance.diagonal(axis1=1, axis2=2), out=doubt[:, :3])
    doubt[:, 3], doubt[:, 4:6] = motions.rotor_std, motions.centre_std
    np.sqrt(motions.pose_covariance.diagonal(axis1=1, axis2=2), out=doubt[:, 6:])
    for t, values, pads, std in zip(
        motions.t_s.tolist(), known.tolist(), motions.pads.tolist(), doubt.tolist(), strict=True
    ):
        yield [t, *values, pads, *std]


def _motion_rows(motions: Motions) -> Iterable[list[str]]:
    for t, *numbers in motion_columns(motions):
        yield [f"{t:.6f}", *map(_number, numbers)]


def event_columns(events: list[Event]) -> dict[str, Any]:
    """The columns of `events.csv`, a list per column: NaN where unknown, None where no pose is judged."""
    columns: dict[str, Any] = {name: [getattr(event, name) for event in events] for name in EVENTS}
    return columns | {"quality": [judged or None for judged in columns["quality"]]}


def _event_row(event: Event) -> list[str]:
    onset = "" if isnan(event.onset_s) else f"{event.onset_s:.6f}"
    motion = map(_number, (event.direction_rad, event.speed_m_s, event.turn_rad_s, event.evidence))
    whole = (_number(getattr(event, name)) for name in _MOTION)
    return [f"{event.t_s:.6f}", event.pad, event.event, onset, *motion, event.quality, *whole]


def _contact_rows(contacts: Contacts, pads: tuple[str, ...]) -> Iterable[list[str]]:
    """Of pads in contact only."""
    scan, pad = np.nonzero(contacts.contact)
    single = [contacts.eccentricity, contacts.orientation, contacts.force_std, contacts.orientation_std]
    size = np.stack([contacts.force, contacts.area, contacts.peak], axis=2)
    numbers = np.concatenate([size, contacts.centroid, contacts.axes, np.stack(single, axis=2)], axis=2)[scan, pad]
    for t, number, values in zip(contacts.t_s[scan].tolist(), pad.tolist(), numbers.tolist(), strict=True):
        yield [f"{t:.6f}", pads[number], *map(_number, values)]


_FLAG = {False: "0", True: "1"}


def _number(value: float) -> str:
    """Nine significant digits; empty where unknown."""
    return f"{value:.9g}" if value == value else ""  # noqa: PLR0124  NaN alone differs from itself
