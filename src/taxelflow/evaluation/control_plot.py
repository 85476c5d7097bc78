"""Pictures of a trial: force, load and slid distance against time, and a film of plant, pads and slip vectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.publish.plots.style import BLUE, GREEN, GREY, SLIP, VERMILION, save, styled
from taxelflow.publish.video import check_video, write_video
from taxelflow.simulation.mujoco.camera import Camera
from taxelflow.simulation.mujoco.events import END_S, EVENT_S, LIFT_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from taxelflow.evaluation.control import Course, Seen
    from taxelflow.messages import Bools
    from taxelflow.publish.plots.film import Frame
    from taxelflow.simulation.mujoco.trial import Trial

FPS, SCANS_PER_FRAME = 25, 2
"""A film at half speed: 100 scans a second, every second one at 25 frames a second."""
_ARROW_S = 0.05
"""An arrow is as long as the way in this time."""
_MOST_KPA = 60.0


def plot_course(course: Course, path: Path) -> Path:
    """Run a trial and draw force, load and slid distance. Raises ExtraMissing without matplotlib."""
    path.parent.mkdir(parents=True, exist_ok=True)
    seen = list(course)
    with styled():
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(2, 1, figsize=(6.4, 4.2), sharex=True, layout="constrained")
        figure.suptitle(_title(course.trial), x=0.01, ha="left")
        _draw_force(axes[0], course.trial, seen)
        _draw_slid(axes[1], course.trial, seen)
        return save(figure, path)


def film_course(course: Course, path: Path) -> int:
    """Run a trial and film it; the number of frames. Raises ParameterInvalid, ExtraMissing, GraphicsMissing."""
    check_video(path)
    with styled():
        return write_video(_frames(course), path, FPS)


def _frames(course: Course) -> Iterator[Frame]:
    """(height, width, 3) each, of every second scan."""
    seen: list[Seen] = []
    sheet: _Sheet | None = None
    try:
        for one in course:
            seen.append(one)
            sheet = sheet or _Sheet(course, one)
            if len(seen) % SCANS_PER_FRAME == 0:
                yield sheet.frame(seen)
    finally:
        if sheet is not None:
            sheet.close()


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
    """The picture that becomes a frame: the plant, pads that hold with slip vectors, and curves that grow."""

    def __init__(self, course: Course, first: Seen) -> None:
        import matplotlib.pyplot as plt

        self._sensor = course.plant.sensor
        self.camera, self._trial = Camera(course.plant), course.trial
        figure: Any = plt.figure(figsize=(8.8, 4.8), dpi=100, layout="constrained")
        self._figure: Figure = figure
        figure.suptitle(f"{_title(course.trial)}, half speed", x=0.01, ha="left")
        holding = np.flatnonzero(first.moment.truth.normal_n > 0.0).tolist()
        grid = figure.add_gridspec(4, 2 * max(len(holding), 1))
        middle = grid.ncols // 2
        view = figure.add_subplot(grid[:, :middle])
        view.axis("off")
        self._view = view.imshow(self.camera.frame())
        facing = first.moment.readings.ndim == 2
        self._pads = [
            self._pad(figure.add_subplot(grid[:2, middle + place]), number, -1.0 if facing and place else 1.0)
            for place, number in enumerate(holding)
        ]
        self._curves = [figure.add_subplot(grid[row, middle:]) for row in (2, 3)]
        self._laid_out = False

    def _pad(self, axis: Any, number: int, sign: float) -> _Pad:
        pad = self._sensor.pads[number]
        assert pad.pitch_m is not None
        axis.set_title(pad.name)
        axis.grid(visible=False)
        axis.set_xticks([])
        axis.set_yticks([])
        present = np.ones((pad.rows, pad.cols), dtype=np.bool_)
        for row, col in pad.missing:
            present[row, col] = False
        half = 500.0 * np.array([-pad.cols, pad.cols, -pad.rows, pad.rows]) * np.repeat(pad.pitch_m, 2)
        image = axis.imshow(np.zeros(present.shape), extent=half, vmin=0.0, vmax=_MOST_KPA, cmap="magma")
        arrow = axis.quiver([0.0], [0.0], [0.0], [0.0], color=GREEN, scale_units="xy", scale=1.0, angles="xy")
        return _Pad(number, present, image, arrow, sign)

    def frame(self, seen: Sequence[Seen]) -> Frame:
        """All scans up to now."""
        now = seen[-1]
        self._view.set_data(self.camera.frame())
        layout, pascals = self._sensor.layout, self._sensor.to_si * now.moment.readings.ravel()
        for pad in self._pads:
            own = layout.of_pad(pad.number)
            pressure = np.full(pad.present.shape, np.nan)
            pressure[pad.present] = pascals[own]
            pad.image.set_data(1e-3 * pressure)
            weight = pascals[own] / max(float(pascals[own].sum()), 1.0)
            pad.arrow.set_offsets(1e3 * np.array([[weight @ layout.x_m[own], weight @ layout.y_m[own]]]))
            u, v = np.nan_to_num(1e3 * _ARROW_S * now.touch.velocity[pad.number, :2]) * [pad.sign, 1.0]
            pad.arrow.set_UVC([u], [v])
        for axis, draw in zip(self._curves, (_draw_force, _draw_slid), strict=True):
            axis.clear()
            draw(axis, self._trial, seen)
            axis.set_xlim(LIFT_S, END_S)
        canvas: Any = self._figure.canvas
        canvas.draw()
        if not self._laid_out:  # axes keep their places: frames do not jump, and cost a tenth
            self._figure.set_layout_engine("none")
            self._laid_out = True
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def close(self) -> None:
        """Free the renderer and the figure."""
        import matplotlib.pyplot as plt

        self.camera.close()
        plt.close(self._figure)


def _title(trial: Trial) -> str:
    return f"{trial.object}, {trial.event} (seed {trial.seed})"


def _draw_force(axis: Any, trial: Trial, seen: Sequence[Seen]) -> None:
    """Force per pad, what carries the load of the moment, and the least that holds; slips shaded."""
    t_s = [one.moment.truth.t_s for one in seen]
    axis.plot(t_s, [one.moment.truth.force_n for one in seen], color=BLUE, label="force per pad")
    load_n = [trial.happening.load(time_s).tangential_n() / (2.0 * trial.held.friction) for time_s in t_s]
    axis.plot(t_s, load_n, color=VERMILION, linewidth=0.8, label="least for the load now")
    axis.plot(t_s, [one.least_n for one in seen], color=VERMILION, linestyle="--", label="least that holds")
    slips = [bool(one.touch.slipping.any()) for one in seen]
    if any(slips):
        shade = {"transform": axis.get_xaxis_transform(), "color": SLIP, "label": "slip detected"}
        axis.fill_between(t_s, 0, 1, where=slips, **shade)
    _mark_event(axis, trial)
    axis.set_ylim(0.0, None)
    axis.set_ylabel("force, N")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=6, borderaxespad=0.1)  # above


def _mark_event(axis: Any, trial: Trial) -> None:
    """A line where the load begins to change."""
    if trial.event not in {"none", "weak"}:
        axis.axvline(EVENT_S, color=GREY, linewidth=0.8)


def _draw_slid(axis: Any, trial: Trial, seen: Sequence[Seen]) -> None:
    """Distance from where the object was at the lift."""
    axis.plot([one.moment.truth.t_s for one in seen], [1e3 * one.slid_m for one in seen], color=GREEN)
    _mark_event(axis, trial)
    axis.set_ylim(0.0, max(1.0, 1.1e3 * max(one.slid_m for one in seen)))
    axis.set_ylabel("slid, mm")
    axis.set_xlabel("s")
