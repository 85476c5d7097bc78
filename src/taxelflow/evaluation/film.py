"""What `taxelflow film` shows: gathered from a result and its recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import ParameterInvalid, SourceMissing
from taxelflow.evaluation.base import Watch
from taxelflow.evaluation.source import conditioned_blocks, source_of
from taxelflow.numerics.clock import SAME_S
from taxelflow.publish.plots.film import Film, film_frames, on_one_plane
from taxelflow.publish.plots.hand import at_contacts
from taxelflow.publish.plots.sizes import FILM
from taxelflow.publish.plots.style import look, styled
from taxelflow.publish.results import drawn_once, read_events, read_result, with_arrows
from taxelflow.publish.video import check_video, write_video
from taxelflow.runtime.checks import positive

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats
    from taxelflow.publish.summary import Summary

_MOST_FRAMES = 3000
"""Most frames of a film: a GIF of that length has about 50 MB."""


def make_film(
    directory: Path,
    out: Path,
    *,
    fps: float,
    speed: float,
    from_s: float,
    to_s: float | None,
    watched: Watch,
) -> int:
    """Film a result into a .gif or .mp4; return the number of frames.

    fps: frames a second of the film, which runs `speed` times as fast as the recording. from_s, to_s: part of it, in s
    since its first scan. watched may show progress. Raises ResultMissing, SourceMissing, ParameterInvalid,
    ExtraMissing.
    """
    check_video(out)
    film = gathered(directory, fps=fps, speed=speed, from_s=from_s, to_s=to_s)
    with styled():
        return write_video(film_frames(film, watched(film.frames_s.tolist(), "filming")), out, fps)


def gathered(directory: Path, *, fps: float, speed: float, from_s: float, to_s: float | None) -> Film:
    """What is shown, see `make_film`."""
    ran, tracks = read_result(directory)
    recording = source_of(ran)
    if recording is None:
        raise SourceMissing(directory, ran.input)
    frames_s = _frame_times(ran, fps, speed, from_s, to_s)
    layout = on_one_plane(ran.layout.layout)
    when, pressure, peaks = _pressures(ran, recording, frames_s)
    own = {track.pad: track for track in tracks}
    ordered = [own[pad] for pad in layout.pads]
    rows = np.searchsorted(ordered[0].numbers["t_s"], when - SAME_S)
    names = (("x_m", "y_m", "theta_rad"), ("vx_m_s", "vy_m_s", "omega_rad_s"))
    pose, velocity = (
        np.stack([[track.numbers[name][rows] for name in group] for track in ordered]).transpose(2, 0, 1)
        for group in names
    )
    places, vectors = np.empty((2, len(when), len(ordered), 2))
    for k, scan in enumerate(pressure):
        places[k], vectors[k] = at_contacts(layout, pose[k], velocity[k], scan)
    once = drawn_once(ran)
    vectors[:, ~with_arrows(ran)] = np.nan
    heaviest = max(float(np.nanmax(track.numbers["load_pa"], initial=0.0)) for track in ordered[: layout.pad_count])
    darkest = float(np.quantile(peaks, 0.99)) if len(peaks) else float(pressure.max()) / FILM.idle
    title = f"{ran.layout.name}, {look(ran.method)['label']}" + (f", {speed:g} x" if speed != 1.0 else "")
    return Film(
        title,
        layout,
        when,
        pressure[:, : layout.taxels],
        places,
        vectors,
        np.stack([track.flags["slipping"][rows] & (track.pad in once) for track in ordered], axis=1),
        np.stack([track.numbers["load_pa"][rows] for track in ordered], axis=1),
        [
            event
            for event in read_events(directory)
            if event.pad in once and frames_s[0] - SAME_S <= event.t_s <= frames_s[-1] + SAME_S
        ],
        frames_s,
        ran.t_first_s,
        darkest or 1.0,
        (heaviest if len(peaks) else heaviest / FILM.idle) or 1.0,
        ran.unit,
    )


def _frame_times(ran: Summary, fps: float, speed: float, from_s: float, to_s: float | None) -> Floats:
    duration_s = ran.t_last_s - ran.t_first_s
    for name, value in (("fps", fps), ("speed", speed)):
        positive(name, value)
    if duration_s <= 0:
        raise ParameterInvalid("scans", ran.scans, "be at least 2, at different times, for a film")
    end_s = duration_s if to_s is None else to_s
    if not 0 <= from_s < duration_s:
        raise ParameterInvalid("from_s", from_s, f"lie within the recording, 0 to {duration_s:.3f} s")
    if not from_s < end_s:
        raise ParameterInvalid("to_s", end_s, f"be after from_s, {from_s:g} s")
    count = int((min(end_s, duration_s) - from_s) * fps / speed + 1e-9) + 1
    if count > _MOST_FRAMES:
        raise ParameterInvalid(
            "frames", count, f"be at most {_MOST_FRAMES}: choose a part by --from-s and --to-s, or raise --speed"
        )
    times_s: Floats = ran.t_first_s + from_s + np.arange(count, dtype=np.float64) * (speed / fps)
    return times_s


def _pressures(ran: Summary, recording: Recording, frames_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Times (n,) and pressure (n, entries) of the scans from the last before the first frame to the last frame; and the
    largest pressure of each scan in contact, of the whole recording: beside it an idle part looks idle.
    """
    times: list[Floats] = []
    kept: list[Floats] = []
    peaks: list[Floats] = []
    for scans in conditioned_blocks(ran, recording):
        peaks.append(scans.pressure[scans.contact.any(axis=1)].max(axis=1))
        if scans.t_s[0] > frames_s[-1]:
            continue
        if scans.t_s[-1] < frames_s[0]:
            times, kept = [scans.t_s[-1:]], [scans.pressure[-1:].copy()]
            continue
        shown = slice(
            max(int(np.searchsorted(scans.t_s, frames_s[0], side="right")) - 1, 0),
            int(np.searchsorted(scans.t_s, frames_s[-1], side="right")),
        )
        times.append(scans.t_s[shown])
        kept.append(scans.pressure[shown].copy())
    return np.concatenate(times), np.concatenate(kept), np.concatenate(peaks)
