"""Pictures of results and of sensors, drawn from arrays that the caller has gathered."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.publish.pictures import FORMATS, pictures_in, safe
from taxelflow.publish.plots.hand import Moment, field_figure
from taxelflow.publish.plots.path import path_figure
from taxelflow.publish.plots.pattern import Contact, pattern_figure
from taxelflow.publish.plots.patterns import patterns_figure
from taxelflow.publish.plots.position import position_figure
from taxelflow.publish.plots.sensor import sensor_figure
from taxelflow.publish.plots.style import looks, save, styled
from taxelflow.publish.plots.views import views_figure

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.messages import Event, Floats, LearnedPattern
    from taxelflow.publish.results import Track
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor

_FIELD_CAPTION = (
    "Slip vectors on the hand laid flat, at moments when the most pads slip: orange where the pad slips, grey where it "
    "does not; + is the centre of rotation. Taxels are shaded by pressure where the recording is at hand."
)


@dataclass(frozen=True, slots=True, eq=False)
class PadTracks:
    """Positions on one pad by several methods. truth: times (n,) in s and poses (n, 3) in m, rad; None if unknown.
    events: those of the pad, by track.
    """

    pad: str
    tracks: list[Track]
    truth: tuple[Floats, Floats] | None
    events: list[list[Event]] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class ResultPictures:
    """What is drawn of one method's result. tracks: of the pads drawn. contacts: of each pad the one whose pattern was
    learned from most scans. moments: slip vectors over the hand, none unless several pads moved at once and one
    slipped. patterns: of all contacts; unit: of their pressure. start_s: time that is shown as 0.
    """

    method: str
    layout: Layout
    tracks: list[Track]
    contacts: list[Contact]
    moments: list[Moment]
    patterns: list[LearnedPattern] = field(default_factory=list)
    unit: str = "Pa"
    start_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """One scan in the paper's three views. image: (rows, cols) in unit. matrix: C[T], (2 rows - 1, 2 cols - 1).
    slip_mm: along x, y.
    """

    title: str
    image: Floats
    unit: str
    matrix: Floats
    slip_mm: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Everything that is drawn of results of one recording."""

    pads: list[PadTracks]
    results: list[ResultPictures]
    views: Views | None


def draw_results(pictures: Pictures, out: Path, form: str) -> list[Path]:
    """Draw into the directory `out`, made if it does not exist, as form svg, png or pdf; return the files.

    Per pad a `position-PAD` and a `pattern-PAD` if a pattern was learned; per result one `path-METHOD`, at most one
    `field-METHOD`, and `patterns-METHOD` if several were learned; `views`. Raises ParameterInvalid,
    ExtraMissing.
    """
    if form not in FORMATS:
        raise ParameterInvalid("format", form, f"be {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    made: list[Path] = []
    with styled():
        for stem, figure in _figures(pictures):
            made.append(save(figure, _free(out, stem, form, made)))
    return made


def remove_older(directory: Path, made: Sequence[Path], pads: Iterable[str], methods: Iterable[str]) -> None:
    """Remove pictures of a result that `draw_results` made before of other methods, or of its earlier state: those in
    the format of the ones made now, and in any other if a table of the result is newer.
    """
    forms, tables = {path.suffix for path in made}, [path.stat().st_mtime for path in directory.glob("*.csv")]
    for path in pictures_in(directory, pads, methods):
        older = path.suffix in forms or path.stat().st_mtime < max(tables, default=0.0)
        if older and path not in made:
            path.unlink()


def _figures(pictures: Pictures) -> Iterator[tuple[str, Figure]]:
    """Name and figure of each picture, one after the other."""
    own = looks([result.method for result in pictures.results])
    style_of = {track: style for result, style in zip(pictures.results, own, strict=True) for track in result.tracks}
    for pad in pictures.pads:
        shown = None if pad.truth is None else (pad.truth[0], pad.truth[1][:, :2])
        strokes = () if pad.truth is None else strokes_of(*pad.truth)
        styles = [style_of[track] for track in pad.tracks]
        yield f"position-{pad.pad}", position_figure(pad.tracks, shown, strokes, pad.events, styles)
    for result in pictures.results:
        for contact in result.contacts:
            yield f"pattern-{contact.pattern.pad}", pattern_figure(result.layout, contact, result.start_s)
        if len(result.patterns) > 1:
            yield f"patterns-{result.method}", patterns_figure(result.patterns, result.unit, result.start_s)
    for result in pictures.results:
        if result.tracks:
            yield f"path-{result.method}", path_figure(result.tracks, result.layout)
    for result in pictures.results:
        if result.moments:
            yield f"field-{result.method}", field_figure(result.layout, {result.method: result.moments}, _FIELD_CAPTION)
    if pictures.views is not None:
        views = pictures.views
        yield "views", views_figure(views.title, views.image, views.unit, views.matrix, views.slip_mm)


def draw_sensors(sensors: Sequence[Sensor], out: Path) -> list[Path]:
    """Draw sensors: into `out` if it is a file's name, for one sensor, else one .svg each in the directory `out`.

    Raises ParameterInvalid, ExtraMissing.
    """
    form = out.suffix.removeprefix(".")
    if form and len(sensors) > 1:
        raise ParameterInvalid("plot", str(out), "be a directory for all sensors; for a file, name one sensor")
    if form and form not in FORMATS:
        raise ParameterInvalid("plot", str(out), f"be a directory, or a file that ends in .{' or .'.join(FORMATS)}")
    made: list[Path] = []
    with styled():
        for sensor in sensors:
            path = out if form else _free(out, sensor.name, "svg", made)
            made.append(save(sensor_figure(sensor), path))
    return made


def _free(out: Path, stem: str, form: str, made: Sequence[Path]) -> Path:
    """A file for a picture: inside `out` whatever the pad's name is, and none of those made before."""
    names = (f"{safe(stem)}{suffix}.{form}" for suffix in ("", *(f"-{number}" for number in range(2, len(made) + 3))))
    return next(out / name for name in names if out / name not in made)


def strokes_of(t_s: Floats, pose: Floats) -> list[tuple[float, float]]:
    """Intervals (from, to) in s during which an object with poses (n, 3) at times (n,) moves at one velocity."""
    fresh = np.diff(t_s, prepend=-np.inf) > 0
    t_s, pose = t_s[fresh], pose[fresh]
    step = np.round(np.diff(pose[:, :2], axis=0) / np.diff(t_s)[:, np.newaxis], 5)
    turns = np.flatnonzero(np.any(np.diff(step, axis=0) != 0, axis=1)) + 1
    bounds = [0, *turns, len(step)]
    return [
        (float(t_s[first]), float(t_s[last]))
        for first, last in pairwise(bounds)
        if last - first > 1 and np.any(step[first] != 0)
    ]
