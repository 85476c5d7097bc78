"""Pictures of results: what is read from result directories and recordings, and handed to the plots."""

from __future__ import annotations

import csv
import re
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taxelflow import api
from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import ParameterInvalid, RecordingError, ResultMissing
from taxelflow.estimation.centroid.paper_reference import convolution_matrix
from taxelflow.geometry import transform
from taxelflow.publish.patterns import read_patterns
from taxelflow.publish.plots.hand import Moment, field_figure
from taxelflow.publish.plots.path import path_figure
from taxelflow.publish.plots.pattern import Contact, pattern_figure
from taxelflow.publish.plots.position import position_figure
from taxelflow.publish.plots.sensor import sensor_figure
from taxelflow.publish.plots.style import save, styled
from taxelflow.publish.plots.views import views_figure
from taxelflow.publish.results import Track, read_result

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.messages import Floats, LearnedPattern
    from taxelflow.publish.summary import Summary
    from taxelflow.sensors.sensor import Sensor

_FORMATS = ("svg", "png", "pdf")
_MOST_PADS = 4
_FEWEST_PADS = 2
_FIELD_SEEN = "Slip vectors on the hand laid flat, at moments when most pads know theirs; + is the centre of rotation."


def draw_results(directories: Sequence[Path], out: Path, form: str) -> list[Path]:
    """Draw results, several of which may be of the same recording by different methods.

    Per loaded pad a `position-PAD` and, where a method has learned one, a `pattern-PAD`; one `path-METHOD` per result,
    one `field-METHOD` where several pads moved at once, and, where the recording is still there, `views`: the paper's
    Fig. 5 at the moment of largest slip. Raises ResultMissing, ExtraMissing.
    """
    everything = [read_result(directory) for directory in directories]
    results = [(ran, _placed(tracks)) for ran, tracks in everything]
    for directory, (ran, _) in zip(directories, results, strict=True):
        if (ran.input, ran.sensor) != (results[0][0].input, results[0][0].sensor):
            raise ResultMissing(directory, f"result of the same recording as {directories[0]}")
    summary = results[0][0]
    pads = _busiest(results)
    results = [(ran, tracks) for ran, tracks in results if any(track.pad in pads for track in tracks)]
    if not results:
        raise ResultMissing(directories[0], f"position: method {summary.method!r} knows none, there is nothing to draw")
    recording = _recording(summary)
    out.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    with styled():
        for pad in pads:
            tracks = [track for _, tracks in results for track in tracks if track.pad == pad]
            if not tracks:
                continue
            truth = recording.truth if recording and recording.truth and recording.truth.pad == pad else None
            shown = (truth.t_s, truth.pose[:, :2]) if truth else None
            figure = position_figure(tracks, shown, strokes_of(truth) if truth else ())
            made.append(save(figure, _free(out, f"position-{pad}", form, made)))
        for directory, (ran, tracks) in zip(directories, everything, strict=True):
            for contact in _contacts(directory, ran, tracks, results, recording):
                figure = pattern_figure(ran.layout.layout, contact)
                made.append(save(figure, _free(out, f"pattern-{contact.pattern.pad}", form, made)))
        for ran, tracks in results:
            figure = path_figure([track for track in tracks if track.pad in pads], ran.layout.layout)
            made.append(save(figure, _free(out, f"path-{ran.method}", form, made)))
        for directory, (ran, tracks) in zip(directories, everything, strict=True):
            moments = _field(ran, tracks, directory)
            if moments:
                figure = field_figure(ran.layout.layout, moments, _FIELD_SEEN)
                made.append(save(figure, _free(out, f"field-{ran.method}", form, made)))
        drawn = any(track.pad == pads[0] for _, tracks in results for track in tracks)
        if recording and drawn and not recording.layout.tables[recording.layout.pads.index(pads[0])]:
            made.append(_draw_views(results, pads[0], recording, out / f"views.{form}"))
    return made


def draw_sensors(sensors: Sequence[Sensor], out: Path) -> list[Path]:
    """Draw sensors: into `out` if it is a file's name, for one sensor, else one .svg each in the directory `out`.

    Raises ParameterInvalid, ExtraMissing.
    """
    form = out.suffix.removeprefix(".")
    if form and (form not in _FORMATS or len(sensors) > 1):
        raise ParameterInvalid("plot", str(out), f"be a directory, or a file that ends in .{' or .'.join(_FORMATS)}")
    made: list[Path] = []
    (out.parent if form else out).mkdir(parents=True, exist_ok=True)
    with styled():
        for sensor in sensors:
            path = out if form else _free(out, sensor.name, "svg", made)
            made.append(save(sensor_figure(sensor), path))
    return made


def _contacts(
    directory: Path,
    ran: Summary,
    tracks: list[Track],
    results: Sequence[tuple[Summary, list[Track]]],
    recording: Recording | None,
) -> list[Contact]:
    """Of each pad the contact whose pattern was learned from most scans."""
    patterns = sorted(read_patterns(directory), key=lambda one: one.scans)
    longest = {one.pad: one for one in patterns}
    return [
        _contact(ran, track, longest[track.pad], _axis_track(track.pad, ran, results, recording), recording)
        for track in _placed(tracks)
        if track.pad in longest
    ]


def _contact(
    ran: Summary, track: Track, pattern: LearnedPattern, axis: Track | None, recording: Recording | None
) -> Contact:
    t_s, touching = track.numbers["t_s"], track.flags["contact"]
    last = int(np.searchsorted(t_s, pattern.t_last_s - 1e-6))
    end = last + int(np.argmin(np.append(touching[last:], False)))
    first = int(np.searchsorted(t_s, pattern.t_first_s - 1e-6))
    if ran.mode == "batch":  # poses of a contact that was solved as a whole are all in one frame
        first -= int(np.argmin(np.append(touching[:first][::-1], False)))
    own = slice(first, max(end, last + 1))
    pose = np.stack([track.numbers[name][own] for name in ("x_m", "y_m", "theta_rad")], axis=1)
    std = np.stack([track.numbers[f"std_{name}"][own] for name in ("x_m", "y_m", "theta_rad")], axis=1)
    scans = _all_images(ran, recording, pattern.pad, t_s[own]) if recording else None
    load = np.zeros(len(pose)) if scans is None else np.nansum(scans, axis=(1, 2))
    shown = int(np.argmax(np.where(np.isfinite(pose[:, 0]), load, -np.inf)))
    turn = None if axis is None else _levelled(axis.numbers["theta_rad"][own], pose[:, 2])
    truth = recording.truth if recording and recording.truth and recording.truth.pad == pattern.pad else None
    true = None
    if truth is not None:
        true = np.stack([np.interp(t_s[own], truth.t_s, column) for column in truth.pose.T], axis=1)
        true[:, 2] = _levelled(true[:, 2], pose[:, 2])
    scan = None if scans is None else scans[shown]
    return Contact(pattern, ran.unit, t_s[own], pose, std, track.flags["ok"][own], shown, scan, turn, true)


def _levelled(turn: Floats, like: Floats) -> Floats:
    """A turn (n,) counted from where it agrees best with another: each has a zero of its own."""
    gap = like - turn
    return turn + (float(np.median(gap[np.isfinite(gap)])) if np.isfinite(gap).any() else 0.0)


def _axis_track(
    pad: str, ran: Summary, results: Sequence[tuple[Summary, list[Track]]], recording: Recording | None
) -> Track | None:
    """The contact's principal axis, from a result if one was given, else estimated here if the recording is there."""
    for other, tracks in results:
        for track in tracks:
            if other.method == "principal_axis" and track.pad == pad:
                return track
    if recording is None:
        return None
    found = api.estimate(recording, "principal_axis", condition=Conditioner(**ran.parameters["condition"]))
    number = found.pads.index(pad)
    return Track("principal_axis", pad, {"theta_rad": found.slips.pose[:, number, 2]}, {})


def _all_images(ran: Summary, recording: Recording, pad: str, t_s: Floats) -> Floats:
    """(n, rows, cols), the pad in the scans at t_s (n,), conditioned as in the run."""
    number = recording.layout.pads.index(pad)
    return np.stack(
        [image for when, image in _images(ran, recording, number) if t_s[0] - 1e-6 <= when <= t_s[-1] + 1e-6]
    )


def _field(ran: Summary, tracks: list[Track], directory: Path) -> list[Moment]:
    """Up to three moments at which most pads know their motion; none if no two pads ever do at once."""
    layout = ran.layout.layout
    t_s = tracks[0].numbers["t_s"]
    own = {track.pad: track for track in tracks}
    ordered = [own[pad] for pad in layout.pads]
    at = np.stack([track.position_m for track in ordered], axis=1)
    v = np.stack([[track.numbers["vx_m_s"], track.numbers["vy_m_s"]] for track in ordered]).transpose(2, 0, 1)
    known = np.isfinite(v[..., 0]) & np.isfinite(layout.T_hand[:, 0])
    count = known[:, : layout.pad_count].sum(axis=1)
    known &= layout.independent
    if count.max(initial=0) < _FEWEST_PADS:
        return []
    full = np.flatnonzero(count == count.max())
    turn = layout.T_hand.copy()
    turn[:, :2] = 0.0
    twists = _twists(directory)
    moments = []
    for k in np.unique(full[(np.array([0.2, 0.5, 0.8]) * (len(full) - 1)).astype(int)]).tolist():
        places, vectors = transform(layout.T_hand, at[k]), transform(turn, v[k])
        places[~known[k]] = vectors[~known[k]] = np.nan
        moments.append(Moment(f"{t_s[k] - t_s[0]:.2f} s", places, vectors, twists[k, :3], twists[k, 3:]))
    return moments


def _twists(directory: Path) -> Floats:
    """(scans, 5) of object.csv: velocity, rate of turn, centre of rotation. Raises ResultMissing."""
    names = ("vx_m_s", "vy_m_s", "omega_rad_s", "cx_m", "cy_m")
    try:
        with (directory / "object.csv").open(newline="", encoding="utf-8") as file:
            rows = [[float(row[name] or "nan") for name in names] for row in csv.DictReader(file)]
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise ResultMissing(directory, f"readable object.csv ({error})") from error
    return np.array(rows).reshape(-1, len(names))


def _free(out: Path, stem: str, form: str, made: Sequence[Path]) -> Path:
    """A file for a picture: whatever a pad is called it stays in `out`, and no picture of this drawing is replaced."""
    safe = re.sub(r"[^\w .,+@=-]", "_", stem)
    names = (f"{safe}{suffix}.{form}" for suffix in ("", *(f"-{number}" for number in range(2, len(made) + 3))))
    return next(out / name for name in names if out / name not in made)


def strokes_of(truth: Truth) -> list[tuple[float, float]]:
    """Intervals (from, to) in s during which the object moves at one velocity."""
    fresh = np.diff(truth.t_s, prepend=-np.inf) > 0
    t_s, pose = truth.t_s[fresh], truth.pose[fresh]
    step = np.round(np.diff(pose[:, :2], axis=0) / np.diff(t_s)[:, np.newaxis], 5)
    turns = np.flatnonzero(np.any(np.diff(step, axis=0) != 0, axis=1)) + 1
    bounds = [0, *turns, len(step)]
    return [
        (float(t_s[first]), float(t_s[last]))
        for first, last in pairwise(bounds)
        if last - first > 1 and np.any(step[first] != 0)
    ]


def _placed(tracks: list[Track]) -> list[Track]:
    """Tracks of which some position is known."""
    return [track for track in tracks if np.isfinite(track.position_m).any()]


def _busiest(results: Sequence[tuple[Summary, list[Track]]]) -> list[str]:
    """Pads and contacts that are told apart, those in contact, the longest contact first."""
    summary = results[0][0]
    groups = {group.name for group in summary.layout.groups}  # they lie on pads
    pads = [name for name in summary.layout.layout.pads if name not in groups]
    loaded = [(summary.pads[name].contact_scans, name) for name in pads if summary.pads[name].contact_scans]
    if not loaded:
        raise ResultMissing(Path(summary.input), "contact at all, so there is nothing to draw")
    return [name for _, name in sorted(loaded, reverse=True)[:_MOST_PADS]]


def _recording(summary: Summary) -> Recording | None:
    """The recording that a result came from, if it is still where it was."""
    try:
        recording = api.read(summary.input, summary.layout)
        first = next(recording.blocks())
    except RecordingError:
        return None
    count = summary.scans + summary.repeated_scans_dropped
    same = recording.scans in (None, count) or summary.loss is not None
    return recording if same and first.t_s[0] == summary.t_first_s else None


def _draw_views(results: Sequence[tuple[Summary, list[Track]]], pad: str, recording: Recording, path: Path) -> Path:
    tracks = {ran.method: (ran, track) for ran, own in results for track in own if track.pad == pad}
    ran, track = tracks.get("convolution", next(iter(tracks.values())))
    moved = np.hypot(track.numbers["dx_m"], track.numbers["dy_m"])
    inner = np.where(track.flags["slipping"] | ~track.flags["slipping"].any(), moved, np.nan)
    touched = int(np.argmax(track.flags["contact"]))
    scan = int(np.nanargmax(_settled(inner))) if np.isfinite(inner).any() else touched
    t_s = float(track.numbers["t_s"][scan])
    number = recording.layout.pads.index(pad)
    before, now = _two_scans(ran, recording, number, t_s)
    scale, unit = (1e3, "kPa") if ran.unit == "Pa" and np.nanmax(now) > 1e4 else (1.0, ran.unit)
    slip_mm = (1e3 * float(track.numbers["dx_m"][scan]), 1e3 * float(track.numbers["dy_m"][scan]))
    title = f"{pad} at {t_s - float(track.numbers['t_s'][0]):.2f} s"
    return save(views_figure(title, now / scale, unit, convolution_matrix(before, now), _finite(slip_mm)), path)


def _settled(moved: Floats) -> Floats:
    """Median of three scans, so that one jump at an edge is not taken for the largest slip."""
    padded = np.concatenate([[np.nan], moved, [np.nan]])
    three = np.stack([padded[:-2], padded[1:-1], padded[2:]])
    complete = np.isfinite(three).all(axis=0)
    return np.where(complete, np.sort(three, axis=0)[1], np.where(np.isfinite(moved), 0.0, np.nan))


def _finite(slip_mm: tuple[float, float]) -> tuple[float, float]:
    return slip_mm if np.all(np.isfinite(slip_mm)) else (0.0, 0.0)


def _two_scans(ran: Summary, recording: Recording, pad: int, t_s: float) -> tuple[Floats, Floats]:
    """The scan at t_s and the one before it, conditioned as in the run, as images of one pad; 0 where no taxel is."""
    before: Floats | None = None
    for when, image in _images(ran, recording, pad):
        if when >= t_s - 1e-6:
            return (image if before is None else before), image
        before = image
    raise ResultMissing(Path(ran.input), f"scan at {t_s} s")


def _images(ran: Summary, recording: Recording, pad: int) -> Iterator[tuple[float, Floats]]:
    """Time and image (rows, cols) of one pad in every scan, conditioned as in the run; NaN where no taxel is."""
    conditioner = Conditioner(**ran.parameters["condition"])
    session = conditioner.start(recording.sensor, recording.masked, recording.blocks())
    for scans in chain(*map(session.step, recording.blocks()), session.finish()):
        for when, pressure in zip(scans.t_s, scans.pressure, strict=True):
            yield float(when), recording.layout.grid(pad, pressure)
