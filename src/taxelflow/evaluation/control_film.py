"""A film of a trial: the plant with the forces that act, pads with slip vectors, and force and slid distance in time.

The trial runs first, and is drawn afterwards: so the axes know their range.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.evaluation.control_plot import draw_force, draw_slid, headline
from taxelflow.publish.plots.style import BLUE, GREEN, INK, MAGENTA, styled
from taxelflow.publish.video import check_video, write_video
from taxelflow.simulation.mujoco.camera import Arrow, Camera
from taxelflow.simulation.mujoco.plants import TRIAL

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.evaluation.control import Course, Seen
    from taxelflow.messages import Bools, Floats
    from taxelflow.publish.plots.film import Frame


@dataclass(frozen=True, slots=True)
class _Film:
    """A film at half speed."""

    fps: int = 25
    scans_per_frame: int = 2
    """100 scans a second, every second one at 25 frames a second."""
    arrow_m: float = 0.06
    """Length of the arrow of the trial's largest force: two thirds of a bottle's width."""


FILM = _Film()


def film_course(course: Course, path: Path) -> int:
    """Run a trial and film it; the number of frames. Raises ParameterInvalid, ExtraMissing, GraphicsMissing."""
    check_video(path, "film")
    with styled():
        return write_video(_frames(course), path, FILM.fps)


def _frames(course: Course, pixels: int = 640) -> Iterator[Frame]:
    """(height, width, 3) each, of every second scan. pixels: height and width of the plant's picture, half a film's."""
    seen: list[Seen] = []
    places: list[Floats] = []
    camera: Camera | None = None
    try:
        for one in course:
            camera = camera or Camera(course.plant, pixels, pixels)  # fails before the trial, if it does
            seen.append(one)
            places.append(course.plant.data.qpos.copy())
        if camera is not None:
            yield from _drawn(course, camera, seen, places)
    finally:
        if camera is not None:
            camera.close()


def _drawn(course: Course, camera: Camera, seen: list[Seen], places: list[Floats]) -> Iterator[Frame]:
    """The frames of a trial that is over. places: (positions,) of all joints, of each scan."""
    import matplotlib.pyplot as plt

    sheet = _Sheet(course, seen)
    m_per_n = FILM.arrow_m / max(float(np.linalg.norm(one)) for moment in seen for one in _pulls(course, moment))
    for number in range(FILM.scans_per_frame - 1, len(seen), FILM.scans_per_frame):
        picture = camera.frame(places[number], partial(_forces, course, seen[number], m_per_n))
        frame = sheet.frame(seen[number], picture)
        yield frame
    yield from repeat(frame, FILM.fps)  # the result stands for a second
    plt.close(sheet.figure)


def _pulls(course: Course, now: Seen) -> list[Floats]:
    """(3,) in the world, N: the load on the object, and then of each pad its normal force along its own z axis."""
    load = course.trial.happening.load(now.moment.truth.t_s)
    pressed = now.moment.truth.normal_n[:, np.newaxis] * [0.0, 0.0, 1.0]
    return [load.mass_kg * load.gravity + load.pull, *pressed]


def _forces(course: Course, now: Seen, m_per_n: float) -> list[Arrow]:
    """The load on the object, and the force of each pad that holds it."""
    grip = course.plant
    load, *pressed = _pulls(course, now)
    middle_m = grip.data.body("object").xipos
    arrows = [Arrow(middle_m, middle_m + m_per_n * load, MAGENTA)]
    for pad, force in zip(grip.sensor.pads, pressed, strict=True):
        site = grip.data.site(pad.name)
        arrows.append(Arrow(site.xpos - m_per_n * site.xmat.reshape(3, 3) @ force, site.xpos, BLUE))
    return [
        one for one in arrows if np.linalg.norm(one.end_m - one.start_m) > 0.03 * FILM.arrow_m
    ]  # else it would be a dot


@dataclass(frozen=True, eq=False)
class _Pad:
    """One pad in the picture. number: of the sensor's pads. present: (rows, cols), whether there is a taxel. image,
    arrow: what is drawn. sign: of the slip vector's x, which of the second of two facing pads is mirrored.
    """

    number: int
    present: Bools
    image: Any
    arrow: Any
    sign: float


class _Sheet:
    """The picture that becomes a frame: the plant, pads that hold with slip vectors, and curves up to now."""

    def __init__(self, course: Course, seen: list[Seen]) -> None:
        import matplotlib.pyplot as plt

        self._sensor, trial, name = course.plant.sensor, course.trial, type(course.controller).__name__.lower()
        figure: Any = plt.figure(figsize=(12.8, 7.2), dpi=100)
        self.figure: Figure = figure
        figure.text(0.015, 0.955, headline(trial), fontsize=17, weight="bold", color=INK)
        figure.text(
            0.015, 0.918, f"controller {name}, in MuJoCo (seed {trial.seed}), at half speed", fontsize=11, color=INK
        )
        self._view = self._plant(figure.add_axes((0.0, 0.0, 0.5, 0.9)))
        pressed = np.max([one.moment.truth.normal_n for one in seen], axis=0)
        holding, facing = np.flatnonzero(pressed > 0.0).tolist(), seen[0].moment.readings.ndim == 2
        width = 0.46 / max(len(holding), 1)
        self._bright = float(np.quantile([one.moment.readings for one in seen], 0.999))
        self._pads = [
            self._pad(
                figure.add_axes((0.535 + place * width, 0.57, 0.9 * width, 0.33)),
                number,
                -1.0 if facing and place else 1.0,
            )
            for place, number in enumerate(holding)
        ]
        self._curtains = []
        for draw, bottom in ((draw_force, 0.31), (draw_slid, 0.08)):
            axis = figure.add_axes((0.565, bottom, 0.42, 0.185 if draw is draw_force else 0.165))
            draw(axis, trial, seen)
            axis.set_xlim(TRIAL.lift_s, TRIAL.end_s)
            legend = axis.get_legend()
            for text in legend.get_texts() if legend else []:
                text.set_fontsize(9.0)
            self._curtains.append(axis.axvspan(TRIAL.lift_s, TRIAL.end_s, facecolor="white", zorder=9.0))

    def _plant(self, axis: Any) -> Any:
        axis.axis("off")
        key = {"transform": axis.transAxes, "fontsize": 11, "weight": "bold"}
        axis.text(0.03, 0.95, "force of each pad", color=BLUE, **key)
        axis.text(0.03, 0.91, "load", color=MAGENTA, **key)
        self._numbers = axis.text(0.03, 0.03, "", color=INK, transform=axis.transAxes, fontsize=13)
        box = {"boxstyle": "round,pad=0.4", "facecolor": GREEN, "edgecolor": "none"}
        self._slips = axis.text(0.97, 0.94, "slip", color="white", ha="right", bbox=box, **key | {"fontsize": 15})
        return axis.imshow(np.zeros((1, 1, 3), np.uint8), extent=(0.0, 1.0, 0.0, 1.0), aspect="auto")

    def _pad(self, axis: Any, number: int, sign: float) -> _Pad:
        pad = self._sensor.pads[number]
        assert pad.pitch_m is not None
        axis.set_title(pad.name.replace("_", " "))
        axis.grid(visible=False)
        axis.set_xticks([])
        axis.set_yticks([])
        present = np.ones((pad.rows, pad.cols), dtype=np.bool_)
        for row, col in pad.missing:
            present[row, col] = False
        half = 500.0 * np.array([-pad.cols, pad.cols, -pad.rows, pad.rows]) * np.repeat(pad.pitch_m, 2)
        image = axis.imshow(np.zeros(present.shape), extent=half, vmin=0.0, vmax=self._bright, cmap="magma")
        look = {
            "color": GREEN,
            "edgecolor": "white",
            "linewidth": 1.2,
            "width": 0.035,
            "headwidth": 2.6,
            "minlength": 0,
        }
        arrow = axis.quiver([0.0], [0.0], [0.0], [0.0], scale_units="xy", scale=1.0, angles="xy", zorder=5, **look)
        return _Pad(number, present, image, arrow, sign)

    def frame(self, now: Seen, picture: Frame) -> Frame:
        """One scan."""
        truth = now.moment.truth
        self._view.set_data(picture)
        self._numbers.set_text(f"{truth.t_s:.2f} s     {truth.force_n:.1f} N grip     slid {1e3 * now.slid_m:.1f} mm")
        self._slips.set_visible(bool(now.touch.slipping.any()))
        layout, readings = self._sensor.layout, now.moment.readings.ravel()
        for pad in self._pads:
            own = layout.of_pad(pad.number)
            pressure = np.full(pad.present.shape, np.nan)
            pressure[pad.present] = readings[own]
            pad.image.set_data(pressure)
            weight = readings[own] / max(float(readings[own].sum()), 1e-9)
            pad.arrow.set_offsets(1e3 * np.array([[weight @ layout.x_m[own], weight @ layout.y_m[own]]]))
            u, v = _length_mm(now.touch.velocity[pad.number, :2]) * [pad.sign, 1.0]
            pad.arrow.set_UVC([u], [v])
            pad.arrow.set_visible(bool(u or v))
        for curtain in self._curtains:
            curtain.set_x(truth.t_s)
            curtain.set_width(TRIAL.end_s - truth.t_s)
        canvas: Any = self.figure.canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _length_mm(velocity: Floats, seconds: float = 0.2, least_mm: float = 0.3, most_mm: float = 12.0) -> Floats:
    """(2,), the arrow of a pad's velocity (2,) in m/s, NaN where unknown: the way in these seconds.

    Shorter ones, of 1.5 mm/s or less, are noise at rest and left out; longer ones would leave the pad.
    """
    way: Floats = np.nan_to_num(1e3 * seconds * velocity)
    length = float(np.hypot(*way))
    return way * min(1.0, most_mm / length) if length > least_mm else np.zeros(2)
