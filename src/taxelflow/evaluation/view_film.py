"""`taxelflow view RECORDING --film`: the scene of the view as a film."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import Watch, unwatched
from taxelflow.evaluation.view import Playing
from taxelflow.publish.video import check_video, write_video
from taxelflow.publish.view.browser import PATIENCE_S, drawn_by, headless, installed_browser
from taxelflow.publish.view.look import CAMERA, FILM, PANEL
from taxelflow.publish.view.server import PageServer
from taxelflow.runtime.checks import not_negative, positive

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats
    from taxelflow.publish.plots.film import Frame
    from taxelflow.publish.view.page import Page


class Part(NamedTuple):
    """Of a recording: from and to, s since its first scan (None: its end), speed of the film, frames per second, and
    whether the hand is laid flat.
    """

    from_s: float = 0.0
    to_s: float | None = None
    speed: float = 1.0
    fps: float = 20.0
    flat: bool = False


def film_recording(
    recording: Recording, methods: Sequence[str], out: Path, part: Part, watched: Watch = unwatched
) -> int:
    """Film the scene into a .mp4 or .gif; return the number of frames.

    Raises BrowserMissing, BrowserFailed, ExtraMissing, NameUnknown, ParameterInvalid, and what reading raises.
    """
    check_video(out, "film")
    installed_browser()
    _check(part)
    playing = Playing(recording, methods, PageServer(port=0), flat=part.flat)
    try:
        playing.fill()
        times = frame_times(playing.page, part)
        with headless(playing.page.url, FILM.wide + PANEL.wide + FILM.border, FILM.high + FILM.border):
            drawn = drawn_by(playing.page, FILM.wide + FILM.border)
            return write_video(_frames(playing.page, drawn, watched(times.tolist(), "filming")), out, part.fps)
    finally:
        playing.close()


def frame_times(page: Page, part: Part) -> Floats:
    """Times of the frames, s of the sensor's clock. Raises ParameterInvalid."""
    first_s, last_s = page.span_s
    length = last_s - first_s
    to_s = length if part.to_s is None else min(part.to_s, length)
    if part.from_s >= to_s:
        raise ParameterInvalid("from", part.from_s, f"lie before the end, {to_s:.3f} s")
    count = int((to_s - part.from_s) * part.fps / part.speed + 1e-9) + 1
    if count > FILM.frames:
        raise ParameterInvalid("frames", count, f"be at most {FILM.frames}: choose a part by --from and --to")
    times: Floats = first_s + part.from_s + np.arange(count, dtype=np.float64) * (part.speed / part.fps)
    return times


def _frames(page: Page, drawn: Any, times: Any) -> Iterator[Frame]:
    camera: dict[str, Any] = {}
    for at_s in times:
        page.show_at(at_s)
        if not camera:
            found = page.scene.frame(page.direction(), FILM.wide / FILM.high)
            drawn.camera.position, drawn.camera.look_at = (
                found.look_at + FILM.farther * (found.position - found.look_at),
                found.look_at,
            )
            camera = {"wxyz": found.wxyz, "position": found.position, "fov": CAMERA.fov_rad}
            drawn.get_render(FILM.high, FILM.wide, timeout=PATIENCE_S, **camera)  # the first one may lack its labels
        frame = drawn.get_render(FILM.high, FILM.wide, timeout=PATIENCE_S, **camera)
        yield np.ascontiguousarray(frame[..., :3])


def _check(part: Part) -> None:
    positive("fps", part.fps)
    positive("speed", part.speed)
    not_negative("from", part.from_s)
