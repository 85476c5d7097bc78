"""Force, load and slid distance of a trial against time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from taxelflow.publish.plots.style import BLUE, GREEN, GREY, SLIP, VERMILION, save, styled
from taxelflow.simulation.mujoco.plants import TRIAL

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.evaluation.control import Course, Seen
    from taxelflow.simulation.mujoco.trial import Trial


def plot_course(course: Course, path: Path) -> Path:
    """Run a trial and draw force, load and slid distance. Raises ExtraMissing without matplotlib."""
    seen = list(course)
    with styled():
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(2, 1, figsize=(6.4, 4.2), sharex=True, layout="constrained")
        figure.suptitle(f"{headline(course.trial)} (seed {course.trial.seed})", x=0.01, ha="left")
        draw_force(axes[0], course.trial, seen)
        draw_slid(axes[1], course.trial, seen)
        return save(figure, path)


def headline(trial: Trial) -> str:
    """The trial in words: what is held, and what happens to it."""
    happening, mass_g = trial.happening, f"{1e3 * trial.held.mass_kg:.0f} g"
    happens = {
        "pour": f"is poured into: {mass_g} become {1e3 * happening.mass_kg * happening.times:.0f} g",
        "pull": f"of {mass_g} is pulled: {happening.times:.1f} times its weight",
        "shake": f"of {mass_g} is shaken: {happening.shake_g:.1f} g at {happening.shake_hz:.1f} Hz",
        "weak": f"of {mass_g} in too weak a grip: {trial.first_n / trial.least_n(TRIAL.lifted_s):.0%} of the least",
        "double": f"of {mass_g} weighs twice as much at once",
    }
    thing = "bumpy block" if trial.object == "bumpy" else trial.object
    return f"A {thing} {happens.get(trial.event, f'of {mass_g}')}"


def draw_force(axis: Any, trial: Trial, seen: Sequence[Seen]) -> None:
    """Force of the grip, what carries the load of the moment, and the least that holds; slips shaded."""
    t_s = [one.moment.truth.t_s for one in seen]
    axis.plot(t_s, [one.moment.truth.force_n for one in seen], color=BLUE, label="force of the grip")
    load_n = [trial.happening.load(time_s).tangential_n() / (2.0 * trial.held.friction) for time_s in t_s]
    axis.plot(t_s, load_n, color=VERMILION, linewidth=0.8, label="least for the load now")
    axis.plot(t_s, [one.least_n for one in seen], color=VERMILION, linestyle="--", label="least that holds")
    slips = [bool(one.touch.slipping.any()) for one in seen]
    if any(slips):
        shade = {"transform": axis.get_xaxis_transform(), "color": SLIP, "label": "slip detected"}
        axis.fill_between(t_s, 0, 1, where=slips, **shade)
    _mark_event(axis, trial)
    axis.set_ylim(0.0, None)
    axis.set_ylabel("force in N")
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=7, borderaxespad=0.1)  # above


def _changes(trial: Trial) -> bool:
    return trial.event not in {"none", "weak"}


def _mark_event(axis: Any, trial: Trial) -> None:
    """A line where the load begins to change."""
    if _changes(trial):
        axis.axvline(TRIAL.event_s, color=GREY, linewidth=0.8)


def draw_slid(axis: Any, trial: Trial, seen: Sequence[Seen]) -> None:
    """Distance from where the object was at the lift."""
    axis.plot([one.moment.truth.t_s for one in seen], [1e3 * one.slid_m for one in seen], color=GREEN)
    _mark_event(axis, trial)
    axis.set_ylim(0.0, max(1.0, 1.1e3 * max(one.slid_m for one in seen)))
    axis.set_ylabel("slid in mm")
    axis.set_xlabel("time in s" + ("; line: the load begins to change" if _changes(trial) else ""))
