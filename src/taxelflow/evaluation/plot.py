"""What `taxelflow plot` draws: gathered from result directories and, where it is still there, from their recording."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.errors import ResultMissing
from taxelflow.estimation.centroid.paper_reference import convolution_matrix
from taxelflow.evaluation.source import images, pressure_at, source_of
from taxelflow.numerics.clock import SAME_S
from taxelflow.publish.figures import PadTracks, Pictures, ResultPictures, Views, draw_results
from taxelflow.publish.patterns import read_patterns
from taxelflow.publish.plots.hand import Moment, at_contacts
from taxelflow.publish.plots.pattern import Contact
from taxelflow.publish.plots.style import pressure_unit
from taxelflow.publish.results import (
    Track,
    counted_once,
    drawn_once,
    read_events,
    read_motions,
    read_orientations,
    read_result,
    with_arrows,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.acquire.base import Recording, Truth
    from taxelflow.messages import Event, Floats, LearnedPattern
    from taxelflow.publish.summary import Summary


@dataclass(frozen=True, slots=True)
class _Drawn:
    """The scan, and the pads, that are drawn."""

    fast: float = 0.75
    """The scan drawn is this quantile of its part by speed: clearly moving, and not the one that is farthest off."""
    share: float = 0.2
    """Least speed of the pads that slip, as a share of that quantile of all slips: less is noise at its begin or
    end."""


_DRAWN = _Drawn()


class _Result(NamedTuple):
    """A result as it was read. tracks: of all pads. placed: those of which some position is known. seen: events by
    pad.
    """

    directory: Path
    ran: Summary
    tracks: list[Track]
    placed: list[Track]
    seen: dict[str, list[Event]]


def plot_results(directories: Sequence[Path], out: Path, form: str) -> list[Path]:
    """Draw results of one recording, by one method or several, into `out`; return the files.

    See `figures.draw_results` for the pictures; `views` is the paper's Fig. 5 at the moment of largest slip, drawn
    where the recording is still there. Raises ResultMissing, ExtraMissing.
    """
    return draw_results(gathered(directories), out, form)


def gathered(directories: Sequence[Path]) -> Pictures:
    """What is drawn of these results. Raises ResultMissing."""
    results = [
        _Result(
            directory,
            ran,
            tracks,
            [track for track in tracks if np.isfinite(track.position_m).any()],
            _by_pad(read_events(directory)),
        )
        for directory in directories
        for ran, tracks in [read_result(directory)]
    ]
    summary = results[0].ran
    for result in results:
        if (result.ran.input, result.ran.sensor) != (summary.input, summary.sensor):
            lacks = f"result of the same recording as {directories[0]}"
            raise ResultMissing(result.directory, lacks, "give results of one recording, or plot each by itself")
    pads = _busiest(summary)
    drawn = [track for result in results for track in result.placed if track.pad in pads]
    if not drawn:
        lacks = f"position by {summary.method}, so nothing is drawn"
        raise ResultMissing(directories[0], lacks, "estimate by another --method, or longer contacts")
    recording = source_of(summary)
    truth = None if recording is None else recording.truth
    positions = []
    for pad in pads:
        if own := [track for track in drawn if track.pad == pad]:
            known = (truth.t_s, truth.pose) if truth is not None and truth.pad == pad else None
            seen = [result.seen.get(pad, []) for result in results if any(track.pad == pad for track in result.placed)]
            positions.append(PadTracks(pad, own, known, seen))
    views = None
    if recording is not None and any(track.pad == pads[0] for track in drawn):
        views = _views(results, pads[0], recording)
    return Pictures(positions, [_pictures(result, pads, results, recording) for result in results], views)


def _by_pad(events: Sequence[Event]) -> dict[str, list[Event]]:
    found: dict[str, list[Event]] = {}
    for event in events:
        found.setdefault(event.pad, []).append(event)
    return found


def _busiest(summary: Summary, most: int = 4) -> list[str]:
    """Pads, and contacts that were split, with the longest contact first. most: number of them, at most."""
    names = counted_once(summary)
    loaded = [(summary.pads[name].contact_scans, name) for name in names if summary.pads[name].contact_scans]
    if not loaded:
        lacks, cure = "contact at all, so there is nothing to draw", "the result's notes state its readings"
        raise ResultMissing(Path(summary.input), lacks, cure)
    return [name for _, name in heapq.nlargest(most, loaded)]


def _pictures(
    result: _Result, pads: Sequence[str], results: Sequence[_Result], recording: Recording | None
) -> ResultPictures:
    layout = result.ran.layout.layout
    tracks = [track for track in result.placed if track.pad in pads]
    once = drawn_once(result.ran)
    patterns = sorted((one for one in read_patterns(result.directory) if one.pad in once), key=lambda one: one.scans)
    longest = {one.pad: one for one in patterns}  # of each pad the contact whose pattern was learned from most scans
    contacts = [
        _contact(result.ran, track, longest[track.pad], _axis_track(track.pad, result, results), recording)
        for track in result.placed
        if track.pad in longest
    ]
    moments = _moments(result, recording)
    ran = result.ran
    return ResultPictures(ran.method, layout, tracks, contacts, moments, patterns, ran.unit, ran.t_first_s)


def _contact(
    ran: Summary, track: Track, pattern: LearnedPattern, axis: Track | None, recording: Recording | None
) -> Contact:
    """A contact, scan by scan, beside its truth, its principal axis and one of its scans, as far as they are known."""
    t_s = track.numbers["t_s"]
    own = _span(ran, track, pattern)
    pose = np.stack([track.numbers[name][own] for name in ("x_m", "y_m", "theta_rad")], axis=1)
    std = np.stack([track.numbers[f"std_{name}"][own] for name in ("x_m", "y_m", "theta_rad")], axis=1)
    scans = None if recording is None else _images_between(ran, recording, pattern.pad, t_s[own])
    load = np.zeros(len(pose)) if scans is None else np.nansum(scans, axis=(1, 2))
    shown = int(np.argmax(np.where(np.isfinite(pose[:, 0]), load, -np.inf)))
    turn = None if axis is None else _levelled(axis.numbers["theta_rad"][own], pose[:, 2])
    true = None
    if recording is not None and recording.truth is not None and recording.truth.pad == pattern.pad:
        true = _true_poses(recording.truth, t_s[own], pose[:, 2])
    scan = None if scans is None else scans[shown]
    return Contact(pattern, ran.unit, t_s[own], pose, std, track.flags["ok"][own], shown, scan, turn, true)


def _span(ran: Summary, track: Track, pattern: LearnedPattern) -> slice:
    """Scans of the contact in which the pattern was learned."""
    t_s, touching = track.numbers["t_s"], track.flags["contact"]
    last = int(np.searchsorted(t_s, pattern.t_last_s - SAME_S))
    end = last + int(np.argmin(np.append(touching[last:], False)))
    first = int(np.searchsorted(t_s, pattern.t_first_s - SAME_S))
    if ran.mode == "batch":  # poses of a contact that was solved as a whole are all in one frame
        first -= int(np.argmin(np.append(touching[:first][::-1], False)))
    return slice(first, max(end, last + 1))


def _true_poses(truth: Truth, t_s: Floats, like: Floats) -> Floats:
    """(n, 3), the truth at times (n,); its turn counts from where it agrees best with another (n,)."""
    true = truth.pose_at(t_s)
    true[:, 2] = _levelled(true[:, 2], like)
    return true


def _levelled(turn: Floats, like: Floats) -> Floats:
    """A turn (n,) counted from where it agrees best with another: each has a zero of its own."""
    gap = like - turn
    return turn + (float(np.median(gap[np.isfinite(gap)])) if np.isfinite(gap).any() else 0.0)


def _axis_track(pad: str, result: _Result, results: Sequence[_Result]) -> Track | None:
    """The contact's principal axis, by its own method if such a result was given, else from the contacts' features."""
    for other in results:
        for track in other.placed:
            if other.ran.method == "principal_axis" and track.pad == pad:
                return track
    t_s = next(track.numbers["t_s"] for track in result.tracks if track.pad == pad)
    angle = np.full(len(t_s), np.nan)
    for when, value in read_orientations(result.directory, pad):
        near = min(int(np.searchsorted(t_s, when - SAME_S)), len(t_s) - 1)
        angle[near] = value
    known = np.isfinite(angle)
    if not known.any():
        return None
    angle[known] = np.unwrap(angle[known], period=np.pi)  # an axis has no direction
    return Track("principal_axis", pad, {"theta_rad": angle}, {})


def _moments(result: _Result, recording: Recording | None, most: int = 3) -> list[Moment]:
    """Moments at which most pads slip; none if no two pads ever have a slip vector while one slips.

    most: parts into which the scans in which most pads slip are cut; one scan of each part is drawn.
    """
    layout = result.ran.layout.layout
    t_s = result.tracks[0].numbers["t_s"]
    own = {track.pad: track for track in result.tracks}
    ordered = [own[pad] for pad in layout.pads]
    at = np.stack([track.position_m for track in ordered], axis=1)
    names = ("vx_m_s", "vy_m_s", "omega_rad_s")
    v = np.stack([[track.numbers[name] for name in names] for track in ordered]).transpose(2, 0, 1)
    slipping = np.stack([track.flags["slipping"] for track in ordered], axis=1)
    known = np.isfinite(v[..., 0]) & np.isfinite(layout.T_hand[:, 0])
    several = known[:, : layout.pad_count].sum(axis=1) >= 2
    known &= with_arrows(result.ran)
    moving, slips = np.hypot(v[..., 0], v[..., 1]), slipping & np.isfinite(v[..., 0])
    speed = np.where(known & slipping, moving, 0.0).sum(axis=1)
    least = _DRAWN.share * np.quantile(moving[slips], _DRAWN.fast) if slips.any() else 0.0
    fast = speed >= least if slips.any() else several  # a slip may begin at rest
    count = np.where(several & fast, (known & slipping).sum(axis=1), 0)
    if not count.max(initial=0):
        return []
    parts = filter(len, np.array_split(np.flatnonzero(count == count.max()), most))
    chosen = [int(part[np.argsort(speed[part])[int(np.ceil(_DRAWN.fast * (len(part) - 1)))]]) for part in parts]
    pressure = {} if recording is None else pressure_at(result.ran, recording, t_s[chosen].tolist())
    twists = read_motions(result.directory)
    moments = []
    for k in chosen:
        title, shade = f"{t_s[k] - t_s[0]:.2f} s", pressure.get(float(t_s[k]))
        places, vectors = at_contacts(layout, at[k], v[k], shade)
        places[~known[k]] = vectors[~known[k]] = np.nan
        moments.append(Moment(title, places, vectors, twists[k, :3], twists[k, 3:], shade, faint=~slipping[k]))
    return moments


def _views(results: Sequence[_Result], pad: str, recording: Recording) -> Views | None:
    """The paper's views of a pad at its largest slip, by Method II if there is a result of it; None without a grid."""
    number = recording.layout.pads.index(pad)
    if recording.layout.tables[number]:
        return None
    tracks = {
        result.ran.method: (result.ran, track) for result in results for track in result.placed if track.pad == pad
    }
    ran, track = tracks.get("convolution", next(iter(tracks.values())))
    scan = _largest_slip(track)
    t_s = float(track.numbers["t_s"][scan])
    before, now = _two_scans(ran, recording, number, t_s)
    scale, unit = pressure_unit(ran.unit, float(np.nanmax(now)))
    dx_mm, dy_mm = (1e3 * float(track.numbers[name][scan]) for name in ("dx_m", "dy_m"))
    slip_mm = (dx_mm, dy_mm) if np.isfinite(dx_mm) and np.isfinite(dy_mm) else (0.0, 0.0)
    title = f"{pad} at {t_s - float(track.numbers['t_s'][0]):.2f} s"
    return Views(title, now / scale, unit, convolution_matrix(before, now), slip_mm)


def _largest_slip(track: Track) -> int:
    """The scan of the largest displacement while slipping, of those with an ok pose if there are any; of one in contact
    if there is none.
    """
    moved = np.hypot(track.numbers["dx_m"], track.numbers["dy_m"])
    used = (track.flags["slipping"] | ~track.flags["slipping"].any()) & np.isfinite(moved)
    used &= track.flags["ok"] | ~(used & track.flags["ok"]).any()
    inner = np.where(used, moved, np.nan)
    if np.isfinite(inner).any():
        return int(np.nanargmax(_settled(inner)))
    return int(np.argmax(track.flags["contact"]))


def _settled(moved: Floats) -> Floats:
    """Median of three scans, so that one jump at an edge does not count as the largest slip."""
    padded = np.concatenate([[np.nan], moved, [np.nan]])
    three = np.stack([padded[:-2], padded[1:-1], padded[2:]])
    complete = np.isfinite(three).all(axis=0)
    return np.where(complete, np.sort(three, axis=0)[1], np.where(np.isfinite(moved), 0.0, np.nan))


def _two_scans(ran: Summary, recording: Recording, pad: int, t_s: float) -> tuple[Floats, Floats]:
    """The scan at t_s and the one before it, conditioned as in the run, as images of one pad."""
    before: Floats | None = None
    for when, image in images(ran, recording, pad):
        if when >= t_s - SAME_S:
            return (image if before is None else before), image
        before = image
    raise ResultMissing(Path(ran.input), f"scan at {t_s} s")


def _images_between(ran: Summary, recording: Recording, pad: str, t_s: Floats) -> Floats:
    """(n, rows, cols), the pad in the scans at t_s (n,), conditioned as in the run."""
    found = images(ran, recording, recording.layout.pads.index(pad))
    return np.stack([image for when, image in found if t_s[0] - SAME_S <= when <= t_s[-1] + SAME_S])
