"""The command `taxelflow control`: trials of a grip controller in MuJoCo."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.commands import Output
from taxelflow.runtime import registry
from taxelflow.runtime.checks import not_negative
from taxelflow.runtime.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from taxelflow.control.base import Controller
    from taxelflow.evaluation.control import Course, MotionRow, TrialRow
    from taxelflow.simulation.mujoco.plant import Actuator
    from taxelflow.simulation.mujoco.trial import Trial

_MOTIONS = ("slide", "pivot")


@dataclass(frozen=True, slots=True)
class _By:
    """Default motion of the controllers that let an object move."""

    mm: float = 5.0
    deg: float = 45.0


_BY = _By()


@dataclass(frozen=True, kw_only=True)
class Control(Output):
    """Run a grip controller in MuJoCo (extra `sim`): a gripper or a hand holds objects whose load changes.

    hold raises the grip on slip and relaxes it; constant, threshold and centroid are baselines; slide and pivot let an
    object move by a distance or an angle. Trial k has the seed SEED + k.
    Exit code: 0; 1 if an object was not grasped before the lift, a fault of the bench; 2 on bad input.
    """

    controller: str
    """Name of the controller: hold, constant, threshold, centroid, slide, pivot, or one of another package."""
    trials: int = 20
    """Number of trials."""
    seed: int = 0
    """Seed of the first trial, 0 or more."""
    objects: tuple[str, ...] = ()
    """Names of objects in turn: ball, rod, box, bottle, bumpy (the default), plate (flat, larger than the pads),
    convex (random convex meshes). slide: bottle, bumpy. pivot: bumpy."""
    events: tuple[str, ...] = ()
    """Names of events in turn: pour, pull, shake, weak (the default), none. slide and pivot: none only."""
    method: str | None = None
    """Estimator in the loop, instead of the controller's own."""
    hand: Literal["gripper", "barrett"] = "gripper"
    """Name of the hand: a gripper with two pads, or the BarrettHand with 162 taxels (jar, case, can; no slide)."""
    bandwidth_hz: float = 10.0
    """Cut-off frequency of the gripper's force, Hz."""
    latency_ms: float = 0.0
    """Delay of the commanded force, ms."""
    by_mm: float | None = None
    """Distance of slide, mm; 5 if left out."""
    by_deg: float | None = None
    """Angle of pivot, deg; 45 if left out."""
    against: tuple[str, ...] = ()
    """Names of other controllers on the same trials, compared in the table."""
    sweep: Literal["actuator"] | None = None
    """Run the trials with latencies of 0 to 50 ms and bandwidths of 5, 10 and 30 Hz; the weight doubles at once."""
    tune: int = 0
    """Number of sets of parameters to try beside the defaults: all on a quarter of the trials, the best 4 on all."""

    film: Path | None = None
    """Film the first trial at half speed into this .mp4 or .gif: hand, pads, slip vectors, force and slid distance."""
    plot: Path | None = None
    """Draw force, load and slid distance of the first trial of each event into this directory."""

    lerobot: Path | None = None
    """Write the trials as episodes of a LeRobot data set (format v3.0) into this new directory."""

    def run(self, _rest: list[str]) -> int:
        """Run the trials and print them; 0 if the bench worked."""
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):  # the matrices are too small to share among cores
            return self._run()

    def _run(self) -> int:
        not_negative("tune", self.tune)
        self._check_hand()
        if self.json and self.against:
            raise ParameterInvalid("against", " ".join(self.against), "be left out with --json, one controller each")
        self._check_files()
        if self.against and {self.controller, *self.against} & set(_MOTIONS):
            raise ParameterInvalid("against", " ".join(self.against), f"not be used with {' or '.join(_MOTIONS)}")
        names = (self.controller, *self.against)
        for name in names:
            registry.check("controller", name)
        if self.sweep:
            return self._sweep()
        if self.tune:
            return self._search(names)
        if self.lerobot is not None:
            from taxelflow.evaluation.episodes import courses_to_lerobot

            courses = self._courses(self.controller)
            count = courses_to_lerobot(self._watched(courses), self.lerobot)
            print(f"{count} episode{'' if count == 1 else 's'} in {self.lerobot}")
            return _blamed_courses(courses)
        if self.film is not None or self.plot is not None:
            return self._show()
        return self._move() if self.controller in _MOTIONS else self._hold(names)

    def _check_hand(self) -> None:
        """What only two facing pads can do. Raises ParameterInvalid."""
        moves = {self.controller, *self.against} & set(_MOTIONS)
        if self.hand != "gripper" and moves:
            raise ParameterInvalid("hand", f"{self.hand} with {' '.join(sorted(moves))}", "be gripper for slide, pivot")

    def _check_files(self) -> None:
        """What is written instead of tables, and instead of each other. Raises ParameterInvalid."""
        tables = ("json", "csv", "against", "sweep", "tune")
        for name, others in (("film", tables), ("plot", tables), ("lerobot", (*tables, "film", "plot"))):
            given = getattr(self, name)
            for other in others:
                if given is not None and getattr(self, other):
                    raise ParameterInvalid(name, str(given), f"be left out with --{other}")
        if self.sweep and self.tune:
            raise ParameterInvalid("tune", self.tune, "be left out with --sweep")

    def _hold(self, names: tuple[str, ...]) -> int:
        """Let controllers hold objects."""
        from taxelflow.evaluation.control import outcome_of
        from taxelflow.evaluation.control_summary import tables_of
        from taxelflow.evaluation.control_table import show_holding

        outcomes = [outcome_of(name, self._courses(name), self._watched) for name in names]
        self.give(outcomes[0].report, lambda: show_holding(outcomes), tables=lambda: tables_of(outcomes))
        return _blamed([row for outcome in outcomes for row in outcome.report.trials])

    def _move(self) -> int:
        """Let objects slide or turn."""
        from taxelflow.evaluation.control import motions_of
        from taxelflow.evaluation.control_table import show_motion

        report = motions_of(self.controller, self._courses(self.controller), self._watched)
        self.give(report, lambda: show_motion(report))
        return _blamed(report.trials)

    def _sweep(self) -> int:
        """Let a controller hold objects whose weight doubles, with slow and late grippers."""
        from taxelflow.evaluation.control import Outcome, outcome_of
        from taxelflow.evaluation.control_sweep import sweep

        if self.controller in _MOTIONS or self.against or self.events:
            raise ParameterInvalid("sweep", "actuator", "be used with one controller that holds, and without events")

        def run(actuator: Actuator) -> tuple[list[Trial], Outcome]:
            doubled = replace(self, bandwidth_hz=actuator.bandwidth_hz, latency_ms=1e3 * actuator.latency_s)
            courses = replace(doubled, events=("double",))._courses(self.controller)
            return [course.trial for course in courses], outcome_of(self.controller, courses, self._watched)

        report = sweep(self.controller, run)
        self.give(report, report.show)
        return ExitCode.PARTLY_DONE if any(row.grasped < row.trials for row in report.rows) else 0

    def _show(self) -> int:
        """Film a trial and draw one of each event; a film is left out where nothing can be rendered."""
        from taxelflow.errors import GraphicsMissing
        from taxelflow.evaluation.control_film import film_course
        from taxelflow.evaluation.control_plot import plot_course
        from taxelflow.publish.video import check_video

        if self.film is not None:
            check_video(self.film, "film")
        ran: dict[int, Course] = {}
        if self.plot is not None:
            courses = self._courses(self.controller)
            for course in {course.trial.event: course for course in reversed(courses)}.values():
                print(plot_course(course, self.plot / f"{self.controller}-{course.trial.event}.svg"))
                ran[course.trial.seed] = course
        if self.film is not None:
            first = self._courses(self.controller)[0]
            try:
                frames = film_course(first, self.film)
                print(f"{frames} frames in {self.film}")
                ran[first.trial.seed] = first
            except GraphicsMissing as error:
                print(f"taxelflow: no film: {error}", file=sys.stderr)
        return _blamed_courses(ran.values())

    def _search(self, names: tuple[str, ...]) -> int:
        """Tune each controller on the same trials."""
        from taxelflow.evaluation.control import Course, held
        from taxelflow.evaluation.control_table import show_tuned
        from taxelflow.evaluation.control_tune import table_of_draws, tune
        from taxelflow.publish.terminal import counted

        def run(trial: Trial, controller: Controller) -> TrialRow:
            return held(Course(trial, controller, self.method, actuator=self._actuator(), hand=self.hand))

        reports = []
        for name in names:
            courses = self._courses(name)
            trials = [course.trial for course in courses]
            kind = courses[0].controller
            reports.append(tune(name, kind, trials, self.tune, run, lambda points: counted(points, "sets")))
        return self.give(
            reports[0], lambda: show_tuned(reports), tables=lambda: [table_of_draws(report) for report in reports]
        )

    def _actuator(self) -> Actuator:
        from taxelflow.simulation.mujoco.plant import Actuator

        if not 0 <= self.latency_ms <= 1000:
            raise ParameterInvalid("latency_ms", self.latency_ms, "be from 0 to 1000")
        return Actuator(self.bandwidth_hz, 1e-3 * self.latency_ms)

    def _watched(self, courses: list[Course]) -> Iterable[Course]:
        from taxelflow.publish.terminal import counted

        return counted(courses, "trials")

    def _courses(self, name: str) -> list[Course]:
        """The trials of one controller, not run yet. Raises NameUnknown, ParameterInvalid."""
        from taxelflow.evaluation.control import Course
        from taxelflow.simulation.mujoco.events import STANDARD_EVENTS
        from taxelflow.simulation.mujoco.hands import DEFAULT_OBJECTS, check_objects
        from taxelflow.simulation.mujoco.plants import TRIAL
        from taxelflow.simulation.mujoco.trial import Trial, drawn_in_turn

        for option, most, owner in (("by_mm", 25, "slide"), ("by_deg", 180, "pivot")):
            given = getattr(self, option)
            if given is not None and name != owner:
                raise ParameterInvalid(option, given, f"be left out for {name}: it is an option of {owner}")
            if given is not None and not 0 < given < most:
                raise ParameterInvalid(option, given, f"be above 0 and below {most}")
        kind = registry.find("controller", name)
        if self.method is not None:
            registry.find("estimator", self.method)
        own: dict[str, Any] = {}
        objects, events, draw = DEFAULT_OBJECTS[self.hand], STANDARD_EVENTS, Trial.drawn
        if name == "slide":
            own, objects, draw = {"by_m": 1e-3 * (self.by_mm or _BY.mm)}, ("bottle", "bumpy"), Trial.to_slide
        elif name == "pivot":
            own, objects, draw = {"by_rad": radians(self.by_deg or _BY.deg)}, ("bumpy",), Trial.to_pivot
        if name in _MOTIONS:
            events = ("none",)
            if set(self.events) - {"none"}:
                raise ParameterInvalid("events", " ".join(self.events), f"be none for {name}")
        actuator, objects = self._actuator(), self.objects or objects
        trials: list[Trial] = list(drawn_in_turn(self.seed, self.trials, objects, self.events or events, draw))
        check_objects(self.hand, objects)
        end_s = TRIAL.motion_end_s if name in _MOTIONS else TRIAL.end_s
        return [
            Course(trial, kind(**own), self.method, actuator=actuator, end_s=end_s, hand=self.hand) for trial in trials
        ]


def _blamed(rows: Sequence[TrialRow | MotionRow]) -> int:
    """The exit code, after a line for each object that was not grasped."""
    return _blamed_trials([row for row in rows if not row.grasped])


def _blamed_courses(courses: Iterable[Course]) -> int:
    """The exit code of trials that were drawn, filmed or written as episodes, see `_blamed`."""
    return _blamed_trials([course.trial for course in courses if not course.grasped])


def _blamed_trials(lost: Sequence[TrialRow | MotionRow | Trial]) -> int:
    for trial in lost:
        print(f"taxelflow: trial {trial.seed} ({trial.object}) was not grasped before the lift", file=sys.stderr)
    return ExitCode.PARTLY_DONE if lost else 0
