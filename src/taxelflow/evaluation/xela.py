"""Score xela: slip and stillness of a real skin against a marker on the object.

A scan moves if the marker is fast at the time of its pose, and is still if it is slow; scans in between, at begin and
end of a contact, or without the marker are not judged. Slip detection was tuned
on every other recording, by name; the others test it.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec
import numpy as np
from rich.console import Console
from tyro.conf import Positional

from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.base import Mode
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import caption, number, percent, shown
from taxelflow.evaluation.marker_recordings import marked_recordings, open_marked
from taxelflow.evaluation.statistics import resampled
from taxelflow.messages import OK
from taxelflow.numerics.spans import spans
from taxelflow.pipeline import api
from taxelflow.runtime.checks import not_negative

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table as Shown

    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.evaluation.marker_recordings import Marked
    from taxelflow.messages import Bools, Floats
    from taxelflow.pipeline.result import Result

Half = Literal["tune", "test"]
MODES: tuple[Mode, ...] = ("batch", "stream")
HALVES: tuple[Half, ...] = ("tune", "test")


class MarkedRow(msgspec.Struct, frozen=True):
    """One method on one recording."""

    recording: str
    half: Half
    method: str
    mode: Mode
    moving: int
    """Scans that move by the marker."""
    still: int
    """Scans that are still by it."""
    found: int
    """Moving scans that are called slipping."""
    false: int
    """Still scans that are called slipping."""
    still_ok: int
    """Still scans whose pose has quality ok."""
    excursion_mm: float | None
    """Largest way from the first to any other such pose in a still interval, less the marker's; None if there are
    none."""


class XelaRow(msgspec.Struct, frozen=True):
    """One method on one half of the recordings; low and high: 95 % interval, by resampling recordings."""

    half: Half
    method: str
    mode: Mode
    recordings: int
    moving: int
    still: int
    f1: float
    f1_low: float
    f1_high: float
    precision: float
    recall: float
    still_slipping_percent: float
    still_slipping_low: float
    still_slipping_high: float
    excursion_median_mm: float | None
    """Median over recordings, and worst, of the largest excursion of ok poses while the object was still."""
    excursion_worst_mm: float | None
    still_ok_percent: float


@dataclass(frozen=True)
class Xela:
    """Measure slip and stillness of a XELA finger against a marker.

    FOLDER holds recordings with a marker on the object, a folder each (see docs/slip.md).
    """

    folder: Positional[Path | None] = None
    """Folder of the recordings."""
    methods: tuple[str, ...] = ("convolution", "registration", "template")
    """Estimators to score."""
    mode: Mode | Literal["both"] = "both"
    """Processing mode: batch, stream or both."""
    half: Half | Literal["all"] = "all"
    """Part of the recordings: those by which slip detection was tuned, those that test it, or both in turn."""
    shear: bool = True
    """Use the shear of each taxel, too: slip detection has it as its second witness."""
    stream_delay_s: float = 0.0
    """Delay of the slips of a stream besides that of its poses, s; subtracted before they are scored."""

    moves_m_s: float = 8e-3
    """Speed of the marker above which the object moves, m/s."""
    still_m_s: float = 3e-3
    """Speed of the marker below which the object is still, m/s; the camera's noise is 1 to 2 mm/s."""
    closing_s: float = 1.0
    """Time at the begin of a contact that is not judged, s: the grip closes, and the object moves with it."""
    opening_s: float = 0.5
    """Time at the end of a contact that is not judged, s."""

    def __post_init__(self) -> None:
        for name in ("stream_delay_s", "moves_m_s", "still_m_s", "closing_s", "opening_s"):
            not_negative(name, getattr(self, name))
        if self.folder is None:
            raise ParameterInvalid("folder", "nothing", "name the folder of the recordings")

    def run(self, watched: Watch = unwatched) -> XelaReport:
        """Estimate every recording with every method and mode. Raises NameUnknown, RecordingMissing, RecordingError."""
        for method in self.methods:
            api.estimator(method)
        paths = list(enumerate(marked_recordings(self.folder or Path())))
        chosen = [(HALVES[place % 2], path) for place, path in paths if self.half in ("all", HALVES[place % 2])]
        modes = MODES if self.mode == "both" else (self.mode,)
        found = []
        for half, path in watched(chosen, "recordings"):
            marked = open_marked(path, shear=self.shear)
            for method in self.methods:
                for mode in modes:
                    result = api.estimate(marked.recording, method, mode=mode, condition=Conditioner(tare="start"))
                    delay_s = self.stream_delay_s if mode == "stream" else 0.0
                    found.append(self.judged(marked, result, half, method, delay_s))
        return XelaReport(summed(found), found)

    def judged(self, marked: Marked, result: Result, half: Half, method: str, delay_s: float = 0.0) -> MarkedRow:
        """A result of one pad against the marker. delay_s: of its slips besides that of its poses."""
        slips, slipping = result.slips, result.slipping[:, 0]
        t_s = slips.t_s - np.nan_to_num(slips.lag_s[:, 0]) - delay_s
        speed = np.where(self._settled(slips.t_s, slips.contact[:, 0]), marked.speed_m_s(t_s), np.nan)
        moves, still = speed > self.moves_m_s, speed < self.still_m_s
        ok = still & (slips.quality[:, 0] == OK)
        intervals = np.cumsum(moves | ~slips.contact[:, 0])  # a motion or a release ends a still interval
        excursions = _excursions(slips.pose[ok, 0, :2], marked.at(t_s[ok]), intervals[ok])
        return MarkedRow(
            recording=marked.name,
            half=half,
            method=method,
            mode="stream" if result.summary.mode == "stream" else "batch",
            moving=int(moves.sum()),
            still=int(still.sum()),
            found=int((moves & slipping).sum()),
            false=int((still & slipping).sum()),
            still_ok=int(ok.sum()),
            excursion_mm=1e3 * max(excursions) if excursions else None,
        )

    def _settled(self, t_s: Floats, contact: Bools) -> Bools:
        """(scans,), in contact, and neither at its begin nor at its end."""
        settled = np.zeros_like(contact)
        for first, last in spans(contact):
            own = t_s[first:last]
            settled[first:last] = (own >= own[0] + self.closing_s) & (own <= own[-1] - self.opening_s)
        return settled


class XelaReport(msgspec.Struct, frozen=True):
    """Halves, and each recording."""

    rows: list[XelaRow]
    recordings: list[MarkedRow]

    def tables(self) -> list[Table]:
        """Halves, then recordings."""
        return [table_of("xela", self.rows, XelaRow), table_of("recordings", self.recordings, MarkedRow)]

    def show(self) -> None:
        """One table for each half."""
        console = Console(markup=False, highlight=False)
        for half in HALVES:
            if rows := [row for row in self.rows if row.half == half]:
                console.print(_shown(rows, f"marker against slip, {rows[0].recordings} recordings to {half} by"))
                console.print()
        caption(
            console,
            "In %. F1, prec, rec: scans that move by the marker against scans called "
            "slipping. still: scans that are still by it and called slipping. mm, worst: largest "
            "excursion of ok poses while still, median over recordings and largest. ok: of "
            "the still scans. 95 %: bootstrap over recordings.",
        )


def _shown(rows: Sequence[XelaRow], title: str) -> Shown:
    return shown(
        rows,
        *(("method:", "method"), ("mode:", "mode")),
        ("F1", lambda row: percent(row.f1)),
        ("95 %:", lambda row: f"{percent(row.f1_low)}-{percent(row.f1_high)}"),
        ("prec", lambda row: percent(row.precision)),
        ("rec", lambda row: percent(row.recall)),
        ("still", "still_slipping_percent", 0),
        ("95 %:", lambda row: f"{row.still_slipping_low:.0f}-{row.still_slipping_high:.0f}"),
        ("mm", lambda row: number(row.excursion_median_mm, 1)),
        ("worst", lambda row: number(row.excursion_worst_mm, 1)),
        ("ok", lambda row: number(row.still_ok_percent, 0)),
        title=title,
    )


def _excursions(place: Floats, marker: Floats, interval: Floats) -> list[float]:
    """The largest of each interval, m. place: (scans, 2). marker: (scans, 3). interval: (scans,), numbered."""
    found = []
    for one in np.unique(interval):
        own = interval == one
        way, marked = (np.linalg.norm(path[own] - path[own][0], axis=1) for path in (place, marker))
        found.append(float(np.maximum(way - marked, 0.0).max()))
    return found


def summed(rows: Sequence[MarkedRow]) -> list[XelaRow]:
    """Sums by half, method and mode."""
    groups: dict[tuple[Half, str, Mode], list[MarkedRow]] = defaultdict(list)
    for row in rows:
        groups[row.half, row.method, row.mode].append(row)
    order = sorted(groups, key=lambda key: HALVES.index(key[0]))
    return [_summed(key, groups[key]) for key in order]


def _summed(key: tuple[Half, str, Mode], rows: list[MarkedRow]) -> XelaRow:
    half, method, mode = key
    counts = np.array([(row.moving, row.still, row.found, row.false, row.still_ok) for row in rows], dtype=np.float64)
    excursions = [row.excursion_mm for row in rows if row.excursion_mm is not None]
    moving, still, found, false, still_ok = counts.sum(axis=0)
    f1_low, f1_high = resampled(counts, lambda drawn: _f1(drawn.sum(axis=1)), 2000)
    called_low, called_high = resampled(counts, lambda drawn: _still_slipping(drawn.sum(axis=1)), 2000)
    return XelaRow(
        half=half,
        method=method,
        mode=mode,
        recordings=len(rows),
        moving=int(moving),
        still=int(still),
        f1=float(_f1(counts.sum(axis=0))),
        f1_low=f1_low,
        f1_high=f1_high,
        precision=float(found / max(found + false, 1)),
        recall=float(found / max(moving, 1)),
        still_slipping_percent=float(_still_slipping(counts.sum(axis=0))),
        still_slipping_low=called_low,
        still_slipping_high=called_high,
        excursion_median_mm=float(np.median(excursions)) if excursions else None,
        excursion_worst_mm=max(excursions, default=None),
        still_ok_percent=float(100 * still_ok / max(still, 1)),
    )


def _f1(sums: Floats) -> Floats:
    moving, _, found, false, _ = sums.T
    share: Floats = 2 * found / np.maximum(moving + found + false, 1)
    return share


def _still_slipping(sums: Floats) -> Floats:
    _, still, _, false, _ = sums.T
    percent: Floats = 100 * false / np.maximum(still, 1)
    return percent
