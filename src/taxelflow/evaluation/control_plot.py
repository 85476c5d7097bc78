"""Pictures of a trial: force, load and slid distance against time, and a film of gripper, pads and slip vectors."""

from __future__ import annotations

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
    from taxelflow.messages import Floats
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
            sheet = sheet or _Sheet(course)
            if len(seen) % SCANS_PER_FRAME == 0:
                yield sheet.frame(seen)
    finally:
        if sheet is not None:
            sheet.close()


class _Sheet:
    """The picture that becomes a frame: the gripper, both pads with slip vectors, and curves that grow."""

    def __init__(self, course: Course) -> None:
        import matplotlib.pyplot as plt

        skin = course.skin
        self.camera, self._skin, self._trial = Camera(course.plant), skin, course.trial
        figure: Any = plt.figure(figsize=(8.8, 4.8), dpi=100, layout="constrained")
        self._figure: Figure = figure
        grid = figure.add_gridspec(4, 4)
        figure.suptitle(f"{_title(course.trial)}, half speed", x=0.01, ha="left")
        view = figure.add_subplot(grid[:, :2])
        view.axis("off")
        self._view = view.imshow(self.camera.frame())
        half = 500.0 * skin.pitch_m * np.array([-skin.cols, skin.cols, -skin.rows, skin.rows])
        self._pads: list[tuple[Any, Any]] = []
        for side, name in enumerate(("left pad", "right pad")):
            axis = figure.add_subplot(grid[:2, 2 + side])
            axis.set_title(name)
            axis.grid(visible=False)
            axis.set_xticks([])
            axis.set_yticks([])
            image = axis.imshow(np.zeros((skin.rows, skin.cols)), extent=half, vmin=0.0, vmax=_MOST_KPA, cmap="magma")
            arrow = axis.quiver([0.0], [0.0], [0.0], [0.0], color=GREEN, scale_units="xy", scale=1.0, angles="xy")
            self._pads.append((image, arrow))
        self._curves = [figure.add_subplot(grid[2, 2:]), figure.add_subplot(grid[3, 2:])]
        self._laid_out = False

    def frame(self, seen: Sequence[Seen]) -> Frame:
        """All scans up to now."""
        now = seen[-1]
        self._view.set_data(self.camera.frame())
        for side, (image, arrow) in enumerate(self._pads):
            pressure = now.moment.readings[side].reshape(self._skin.rows, self._skin.cols)
            image.set_data(1e-3 * pressure)
            arrow.set_offsets(self._middle_mm(pressure)[np.newaxis])
            u, v = np.nan_to_num(1e3 * _ARROW_S * now.touch.velocity[side, :2]) * [1.0 if side == 0 else -1.0, 1.0]
            arrow.set_UVC([u], [v])
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

    def _middle_mm(self, pressure: Floats) -> Floats:
        """Centre of pressure (2,) in the pad's frame."""
        total = max(float(pressure.sum()), 1.0)
        x = (np.arange(self._skin.cols) - (self._skin.cols - 1) / 2) * self._skin.pitch_m
        y = ((self._skin.rows - 1) / 2 - np.arange(self._skin.rows)) * self._skin.pitch_m
        return 1e3 * np.array([pressure.sum(axis=0) @ x, pressure.sum(axis=1) @ y]) / total


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
