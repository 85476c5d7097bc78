"""Score prediction: recordings without truth, how well the next scan is predicted, and the template's turn beside the
principal axis.

Everything is causal. Forecasts use scans up to k: `no motion` repeats scan k, `forecast` changes it as the learned map
changes if the motion goes on. Registrations use the pose of scan k + 1, too: `registered` fits pose and gain of the
map, which was learned up to scan k; `centroid` moves scan k by the step of the centroid. Where the template gives up
its map at scan k + 1, its registration counts as bad as its forecast.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.ndimage import shift
from tyro.conf import Positional

from taxelflow.errors import ParameterInvalid
from taxelflow.estimation.template.online.session import StreamSession
from taxelflow.estimation.template.parameters import Template
from taxelflow.evaluation.base import table_of, unwatched
from taxelflow.evaluation.cells import caption, number, shown
from taxelflow.evaluation.statistics import rms
from taxelflow.messages import LOST, OK, cut
from taxelflow.numerics.rounding import ROUNDING
from taxelflow.numerics.spans import spans
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.table import Table as Shown

    from taxelflow.acquire.base import Recording
    from taxelflow.evaluation.base import Table, Watch
    from taxelflow.messages import Floats, Scans
    from taxelflow.sensors.layout import Layout

_PREDICTIONS = ("forecast", "no motion", "registered", "centroid")


class PredictionRow(msgspec.Struct, frozen=True):
    """Errors on one pad of a recording: RMS over taxels and scans, in percent of the RMS of the readings."""

    recording: str
    pad: str
    scans: int
    """Scans predicted: in contact, and so were the two before."""
    forecast_percent: float
    no_motion_percent: float
    registered_percent: float
    centroid_percent: float
    noise_percent: float
    """Error of the best prediction by the sensor's own noise."""
    lost: int
    """Scans at which the template gave up its map."""


class Turn(msgspec.Struct, frozen=True):
    """Turn of a contact by the template (batch) and by the principal axis, over scans in which both are known, with at
    least a quarter of the contact's largest load: with less, the principal axis is noise.
    """

    recording: str
    pad: str
    from_s: float
    """Since the recording's first scan."""
    scans: int
    template_deg: float
    axis_deg: float
    """From the first to the last of these scans."""
    apart_deg: float
    """RMS of their difference, less its median."""
    ok_percent: float
    """Scans whose pose by the template has quality ok."""


@dataclass(frozen=True)
class Prediction:
    """Predict the next scan of recordings without truth.

    A template learned up to a scan predicts the one after it. Its turn is compared with the principal axis, too.
    """

    recordings: Positional[tuple[Path, ...]] = ()
    """Recordings, one or more, in any format that `taxelflow estimate` reads."""
    sensor: str | None = None
    """Name of a built-in sensor (see `taxelflow sensors`) or a TOML file; not needed where the recording names its
    own."""
    topic: str | None = None
    """Topic of a bag or .mcap; not needed where only one fits."""

    def __post_init__(self) -> None:
        if not self.recordings:
            raise ParameterInvalid("recordings", "nothing", "name at least one recording")

    def run(self, watched: Watch = unwatched) -> PredictionReport:
        """Read and score the recordings. Raises what `api.read` raises."""
        opened = [api.read(path, self.sensor, topic=self.topic) for path in self.recordings]
        return score_recordings(opened, watched)


class PredictionReport(msgspec.Struct, frozen=True):
    """All recordings."""

    predictions: list[PredictionRow]
    turns: list[Turn]

    def tables(self) -> list[Table]:
        """Prediction errors, then turns."""
        return [table_of("scans", self.predictions, PredictionRow), table_of("turn", self.turns, Turn)]

    def show(self) -> None:
        """Prediction errors, then turns, a block per recording."""
        console = Console(markup=False, highlight=False)
        for name in dict.fromkeys(row.recording for row in self.predictions):
            console.print(name, style="bold")
            console.print(_errors_shown([row for row in self.predictions if row.recording == name]))
            if turns := [turn for turn in self.turns if turn.recording == name]:
                console.print(_turns_shown(turns))
            console.print()
        if not self.predictions:
            console.print("no contact is long enough to predict a scan of it")
        caption(
            console,
            "Errors of the next scan, RMS, in % of its readings. forecast: the last scan, "
            "changed as the template is if the motion goes on. no motion: the last scan. "
            "registered: the template at the pose of that scan. centroid: the last scan, "
            "moved as far as the centroid did. noise: the sensor's own. Turns: the longest "
            "contact that shows one, while it has a quarter of its load or more; the template "
            "as a batch.",
        )


def _errors_shown(rows: Sequence[PredictionRow]) -> Shown:
    names = ("forecast", "no motion", "registered", "centroid", "noise")
    errors = [(name, f"{name.replace(' ', '_')}_percent", 1) for name in names]
    return shown(rows, ("pad:", "pad"), ("scans", "scans"), *errors, ("lost", "lost"))


def _turns_shown(turns: Sequence[Turn]) -> Shown:
    return shown(
        turns,
        *(("pad:", "pad"), ("from s", "from_s", 2), ("scans", "scans")),
        ("template deg", lambda turn: f"{turn.template_deg:+.1f}"),
        ("axis deg", lambda turn: f"{turn.axis_deg:+.1f}"),
        *(("apart deg", "apart_deg", 1), ("ok %", lambda turn: number(turn.ok_percent, 0))),
    )


def score_recordings(recordings: Sequence[Recording], watched: Watch = unwatched) -> PredictionReport:
    """Score recordings that are open, simulated ones too; their truth is not used."""
    predictions, turns = [], []
    for recording in watched(recordings, "recordings"):
        predictions += _predictions(recording)
        turns += _turns(recording)
    return PredictionReport(predictions, turns)


@dataclass(slots=True)
class _Sums:
    """Squares on one pad."""

    scans: int = 0
    lost: int = 0
    readings: float = 0.0
    noise: float = 0.0
    errors: dict[str, float] = field(default_factory=lambda: dict.fromkeys(_PREDICTIONS, 0.0))


def _predictions(recording: Recording) -> list[PredictionRow]:
    layout = recording.layout
    sums = [_Sums() for _ in range(layout.pad_count)]
    session = StreamSession(layout, Template().latency_s)
    before: Scans | None = None
    touched = np.zeros(layout.pad_count, dtype=np.int64)
    for scan in _single_scans(recording):
        contact = scan.contact[0, : layout.pad_count]
        forecast = session.expected(float(scan.t_s[0]))
        slips = session.step(scan)
        registered = session.expected()
        for pad in np.flatnonzero(contact & (touched >= 2) & scan.complete[0, : layout.pad_count]):
            own, images = layout.of_pad(int(pad)), (before, scan)
            lost = slips.quality[0, pad] == LOST
            seen, last = scan.pressure[0, own], before.pressure[0, own] if before else scan.pressure[0, own]
            guesses = {
                "forecast": forecast[own],
                "no motion": last,
                "registered": forecast[own] if lost else registered[own],
                "centroid": _moved(layout, int(pad), images[0] or scan, scan),
            }
            _count(sums[pad], seen, scan.noise[own], guesses, lost=bool(lost))
        touched = np.where(contact, touched + 1, 0)
        before = scan
    session.finish()
    name = Path(recording.source).name
    return [_row(name, layout.pads[pad], own) for pad, own in enumerate(sums) if own.scans]


def _single_scans(recording: Recording) -> Iterator[Scans]:
    """Scan by scan, conditioned as a recording is: tare and noise are no part of the comparison."""
    for scans in api.segmented(recording):
        yield from (cut(scans, k, k + 1) for k in range(len(scans)))


def _count(sums: _Sums, seen: Floats, noise: Floats, guesses: dict[str, Floats], *, lost: bool) -> None:
    live = noise > 0
    sums.scans += 1
    sums.lost += lost
    sums.readings += float((seen[live] ** 2).sum())
    sums.noise += float((noise[live & (seen != 0)] ** 2).sum())
    for name, guess in guesses.items():
        sums.errors[name] += float(((guess - seen)[live] ** 2).sum())


def _moved(layout: Layout, pad: int, before: Scans, now: Scans) -> Floats:
    """(taxels,), the pad in the scan before, moved by the step of the centroid; at the border it goes on as it ends."""
    own = layout.of_pad(pad)
    table = bool(layout.tables[pad])
    places = np.stack([layout.x_m[own], layout.y_m[own]] if table else [layout.row[own], layout.col[own]], axis=1)
    centres = [_centroid(scan.pressure[0, own], scan.noise[own], places) for scan in (before, now)]
    step = centres[1] - centres[0]
    if table:
        return _interpolated(places, before.pressure[0, own], places - step)
    image = layout.grid(pad, before.pressure[0], fill=0.0)
    moved: Floats = shift(image, step, order=1, mode="nearest")[layout.row[own], layout.col[own]]
    return moved


def _interpolated(places: Floats, values: Floats, at: Floats) -> Floats:
    """(n,), values (taxels,) of places (taxels, 2) interpolated at others (n, 2), also where they lie on a line."""
    middle = places.mean(axis=0)
    _, width, axes = np.linalg.svd(places - middle, full_matrices=False)
    if width[-1] <= ROUNDING * width[0] or len(places) == 1:
        along = (places - middle) @ axes[0]
        order = np.argsort(along)
        between: Floats = np.interp((at - middle) @ axes[0], along[order], values[order])
        return between
    between = np.asarray(LinearNDInterpolator(places, values)(at), np.float64)
    return np.where(np.isfinite(between), between, NearestNDInterpolator(places, values)(at))


def _centroid(pressure: Floats, noise: Floats, places: Floats) -> Floats:
    weight = np.where(pressure > 3.0 * noise, pressure, 0.0)
    centre: Floats = weight @ places / (weight.sum() or 1.0)
    return centre


def _row(name: str, pad: str, sums: _Sums) -> PredictionRow:
    percent = {key: 100.0 * float(np.sqrt(error / sums.readings)) for key, error in sums.errors.items()}
    return PredictionRow(
        recording=name,
        pad=pad,
        scans=sums.scans,
        forecast_percent=percent["forecast"],
        no_motion_percent=percent["no motion"],
        registered_percent=percent["registered"],
        centroid_percent=percent["centroid"],
        noise_percent=100.0 * float(np.sqrt(sums.noise / sums.readings)),
        lost=sums.lost,
    )


def _turns(recording: Recording, fewest: int = 10, loaded: float = 0.25) -> list[Turn]:
    """Of contacts with at least `fewest` scans whose load is above a share `loaded` of the contact's largest."""
    template, axis = (api.estimate(recording, method).slips for method in ("template", "principal_axis"))
    layout, found = recording.layout, []
    for pad in range(layout.pad_count):
        best = None
        for first, last in spans(template.contact[:, pad]):
            theta, other = template.pose[first:last, pad, 2], axis.pose[first:last, pad, 2]
            load = template.load[first:last, pad]
            both = np.flatnonzero(np.isfinite(theta) & np.isfinite(other) & (load >= loaded * load.max()))
            if len(both) >= max(fewest, best.scans if best else 0):
                theta, other = np.degrees(theta[both]), np.degrees(other[both])
                gap = theta - other
                best = Turn(
                    recording=Path(recording.source).name,
                    pad=layout.pads[pad],
                    from_s=float(template.t_s[first + both[0]] - template.t_s[0]),
                    scans=len(both),
                    template_deg=float(theta[-1] - theta[0]),
                    axis_deg=float(other[-1] - other[0]),
                    apart_deg=rms(gap - np.median(gap)),
                    ok_percent=100.0 * float(np.mean(template.quality[first:last, pad][both] == OK)),
                )
        found += [best] if best else []
    return found
