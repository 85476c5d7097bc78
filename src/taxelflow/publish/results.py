"""Reads the results that `taxelflow estimate --out` has written."""

from __future__ import annotations

import csv
import io
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO

import msgspec
import numpy as np

from taxelflow.errors import ResultMissing
from taxelflow.messages import OK, QUALITY, Event
from taxelflow.publish.columns import EVENTS
from taxelflow.publish.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from taxelflow.messages import Bools, Floats

# fmt: off
_COLUMNS = (
    "t_s", "x_m", "y_m", "theta_rad", "dx_m", "dy_m", "vx_m_s", "vy_m_s", "omega_rad_s", "std_x_m", "std_y_m",
    "std_theta_rad", "lag_s", "load_pa",
)
# fmt: on
_EVENT_NUMBERS = tuple(name for name in EVENTS if name not in ("t_s", "pad", "event", "quality"))
_FLAGS = ("contact", "slipping")
_PIECE = 1 << 24
"""Characters of a table that are parsed at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What one method saw on one pad: arrays over scans, columns of slips.csv by name, NaN where unknown.

    flags: contact, slipping, and ok, where the quality of the pose is ok.
    """

    method: str
    pad: str
    numbers: dict[str, Floats]
    flags: dict[str, Bools]

    @property
    def t_s(self) -> Floats:
        """When the pose was true: the scan's time less the method's lag."""
        when: Floats = self.numbers["t_s"] - np.nan_to_num(self.numbers["lag_s"])
        return when

    @property
    def position_m(self) -> Floats:
        """(scans, 2) in the pad's frame."""
        return np.stack([self.numbers["x_m"], self.numbers["y_m"]], axis=1)


def drawn_once(ran: Summary) -> list[str]:
    """Names of which none repeats another: of a pad with contacts that were split these, if several of them were seen,
    else the pad itself.
    """
    layout = ran.layout.layout
    seen = [
        of for name, of in zip(layout.pads, layout.contact_of.tolist(), strict=True) if ran.pads[name].contact_scans
    ]
    several = {of for of in seen if of >= 0 and seen.count(of) > 1}
    return [
        name
        for number, (name, of) in enumerate(zip(layout.pads, layout.contact_of.tolist(), strict=True))
        if (number not in several if of < 0 else of in several)
    ]


def counted_once(ran: Summary) -> list[str]:
    """`drawn_once` without groups, which lie on pads: whose motions add up."""
    groups = {group.name for group in ran.layout.groups}
    return [name for name in drawn_once(ran) if name not in groups]


def with_arrows(ran: Summary) -> Bools:
    """(pads,): those whose slip vectors are drawn, see `Layout.independent`; contacts that were split for their pad."""
    layout, once = ran.layout.layout, set(drawn_once(ran))
    shown: Bools = layout.independent.copy()
    for number, of in enumerate(layout.contact_of.tolist()):
        if of >= 0 and layout.pads[number] in once:
            shown[of], shown[number] = False, True
    return shown


def read_summary(directory: Path) -> Summary:
    """What `summary.json` holds. Raises ResultMissing."""
    summary = directory / "summary.json"
    if not summary.is_file():
        raise ResultMissing(directory, summary.name)
    try:
        return msgspec.json.decode(summary.read_bytes(), type=Summary)
    except msgspec.DecodeError as error:
        raise ResultMissing(directory, f"readable summary.json ({error})") from error


def read_result(directory: Path) -> tuple[Summary, list[Track]]:
    """Summary and tracks of all pads. Raises ResultMissing."""
    ran, slips = read_summary(directory), directory / "slips.csv"
    if not slips.is_file():
        raise ResultMissing(directory, slips.name)
    try:
        tracks = _tracks(slips, ran)
    except (ValueError, KeyError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
        raise ResultMissing(directory, f"readable slips.csv ({error})") from error
    if {track.pad for track in tracks} != set(ran.pads):
        raise ResultMissing(directory, "slips.csv of the pads that its summary.json names")
    return ran, tracks


def read_events(directory: Path) -> list[Event]:
    """Events of a result in the order of its file. Raises ResultMissing."""
    with _rows(directory, "events.csv") as rows:
        return [
            Event(
                float(row["t_s"]),
                row["pad"],
                row["event"],
                **{name: _number(row[name]) for name in _EVENT_NUMBERS},
                quality=row["quality"],
            )
            for row in rows
        ]


def read_motions(directory: Path) -> Floats:
    """(scans, 5): velocity, rate of turn and centre of rotation of the whole object, NaN where unknown.

    Raises ResultMissing.
    """
    names = ("vx_m_s", "vy_m_s", "omega_rad_s", "cx_m", "cy_m")
    with _rows(directory, "object.csv") as rows:
        return np.array([[_number(row[name]) for name in names] for row in rows]).reshape(-1, len(names))


def read_orientations(directory: Path, pad: str) -> list[tuple[float, float]]:
    """Time and direction of a contact's long axis, s and rad; none where a result has no contacts.csv.

    Raises ResultMissing.
    """
    if not (directory / "contacts.csv").exists():
        return []
    with _rows(directory, "contacts.csv") as rows:
        known = [row for row in rows if row["pad"] == pad and row["orientation_rad"]]
        return [(float(row["t_s"]), float(row["orientation_rad"])) for row in known]


@contextmanager
def _rows(directory: Path, name: str) -> Iterator[Iterable[dict[str, str]]]:
    """Rows of a table by column. Raises ResultMissing for one that is not there, or whose rows cannot be used."""
    try:
        with (directory / name).open(newline="", encoding="utf-8") as file:
            yield csv.DictReader(file)
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise ResultMissing(directory, f"readable {name} ({error})") from error


def _number(field: str) -> float:
    return float(field or "nan")


def _tracks(slips: Path, ran: Summary) -> list[Track]:
    """Each scan has a row per pad, in one order. Pieces are parsed in C: an hour of a hand has a million rows."""
    names = [*_COLUMNS, *_FLAGS, "quality"]
    with slips.open(newline="", encoding="utf-8") as file:
        heading = next(csv.reader([file.readline()]), [])
        if lacking := {*names, "pad"} - set(heading):
            raise KeyError(", ".join(sorted(lacking)))
        first = file.tell()
        pads = _first_scan(file, heading.index("pad"))
        if not pads:
            return []
        file.seek(first)
        used = [heading.index(name) for name in names]
        pieces = []
        while text := file.read(_PIECE):
            rows = io.StringIO(_numeric(text + file.readline()))
            pieces.append(np.loadtxt(rows, delimiter=",", usecols=used, comments=None, ndmin=2))
    columns = np.concatenate(pieces).reshape(-1, len(pads), len(names)).transpose(1, 2, 0)
    by_pad = [dict(zip(names, own, strict=True)) for own in columns]
    return [
        Track(
            ran.method,
            pad,
            {name: np.ascontiguousarray(own[name]) for name in _COLUMNS},
            {name: own[name] > 0 for name in _FLAGS} | {"ok": own["quality"] == OK},
        )
        for pad, own in zip(pads, by_pad, strict=True)
    ]


def _first_scan(file: TextIO, column: int) -> list[str]:
    """Names of the pads in the rows of the first scan; a name holds neither comma nor quote."""
    pads: list[str] = []
    while (row := file.readline().split(","))[column:] and row[column] not in pads:
        pads.append(row[column])
    return pads


def _numeric(text: str) -> str:
    """Rows with nan in empty fields, and qualities by their number in `QUALITY`."""
    for number, word in enumerate(QUALITY[1:], 1):
        text = text.replace(f",{word},", f",{number},")
    return text.replace(",,", ",nan,").replace(",,", ",nan,").replace(",\n", ",nan\n")
