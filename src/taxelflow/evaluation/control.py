"""Trials of grip controllers in MuJoCo: the streaming estimator in the loop, and what is scored."""

from __future__ import annotations

from dataclasses import dataclass
from time import thread_time
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.control.hold import HoldSession
from taxelflow.control.motion import LetMove, Pivot, Slide
from taxelflow.control.touch import TouchStream
from taxelflow.evaluation.base import table_of
from taxelflow.simulation.mujoco.plant import Actuator
from taxelflow.simulation.mujoco.plants import TRIAL
from taxelflow.simulation.mujoco.trial import Moment, Rehearsal, Trial

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from taxelflow.control.base import Controller, Touch
    from taxelflow.evaluation.base import Table
    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.mujoco.plant import Grip

    Watched = Callable[[list["Course"]], Iterable["Course"]]
    """Passes courses on, and may show progress."""


class TrialRow(msgspec.Struct, frozen=True):
    """Score of a trial. force_over_least: mean force per pad in the last second over the least that holds; NaN if
    the trial ended before, and of a trial not grasped.
    """

    seed: int
    object: str
    event: str
    grasped: bool
    held: bool
    slid_mm: float
    force_over_least: float | None


class ControlReport(msgspec.Struct, frozen=True):
    """Trials of a controller. Shares are of the grasped trials; quantiles are of the held ones."""

    controller: str
    trials: list[TrialRow]
    held: float | None
    within_5_mm: float | None
    force_p50: float | None
    force_p90: float | None

    @classmethod
    def of(cls, controller: str, rows: list[TrialRow]) -> ControlReport:
        """Shares and quantiles; None where no trial counts."""
        grasped = [row for row in rows if row.grasped]
        ratios = [row.force_over_least for row in grasped if row.held and row.force_over_least is not None]
        p50, p90 = (float(np.quantile(ratios, share)) if ratios else None for share in (0.5, 0.9))
        held = float(np.mean([row.held for row in grasped])) if grasped else None
        near = float(np.mean([is_near(row) for row in grasped])) if grasped else None
        return cls(controller, rows, held, near, p50, p90)


def is_near(row: TrialRow) -> bool:
    """Whether an object was held and slid less than 5 mm."""
    return row.held and row.slid_mm < 1e3 * TRIAL.near_m


def cost_of(rows: Sequence[TrialRow]) -> float:
    """Mean cost of the grasped trials: slip and force in one number, by which controllers are tuned and compared."""
    costs = [cost(row) for row in rows if row.grasped]
    return float(np.mean(costs)) if costs else float("inf")


def cost(row: TrialRow) -> float:
    """Cost of a grasped trial."""
    return float(not is_near(row)) + TRIAL.force_cost * max((row.force_over_least or 1.0) - 1.0, 0.0)


class MotionRow(msgspec.Struct, frozen=True):
    """A commanded motion: mm or degrees. closed: whether the controller ended the motion."""

    seed: int
    object: str
    event: str
    grasped: bool
    closed: bool
    asked: float
    felt: float
    moved: float


class MotionReport(msgspec.Struct, frozen=True):
    """Commanded motions of a controller. Quantiles of the absolute error are of the grasped trials."""

    controller: str
    unit: str
    trials: list[MotionRow]
    error_p50: float | None
    error_p90: float | None

    def tables(self) -> list[Table]:
        """The trials."""
        return [table_of("motions", self.trials, MotionRow)]

    @classmethod
    def of(cls, controller: str, unit: str, rows: list[MotionRow]) -> MotionReport:
        """Quantiles; None where no trial counts."""
        errors = [abs(row.moved - row.asked) for row in rows if row.grasped]
        p50, p90 = (float(np.quantile(errors, share)) if errors else None for share in (0.5, 0.9))
        return cls(controller, unit, rows, p50, p90)


@dataclass(frozen=True)
class Scans:
    """Of one trial. blind: (scans,), the controller knows that its pads cannot detect a slip. step_s: (scans,)."""

    blind: Bools
    step_s: Floats


@dataclass(frozen=True)
class Outcome:
    """Trials of a controller that holds, with what their scans show of the estimator. scans: one of each trial."""

    report: ControlReport
    scans: list[Scans]


def outcome_of(name: str, courses: list[Course], watched: Watched) -> Outcome:
    """Run trials of a controller that holds, one after the other. Raises ExtraMissing."""
    rows, scans = [], []
    for course in watched(courses):
        seen = list(course)
        rows.append(score(course, seen))
        scans.append(Scans(np.array([one.blind for one in seen]), np.array([one.step_s for one in seen])))
    return Outcome(ControlReport.of(name, rows), scans)


def motions_of(name: str, courses: list[Course], watched: Watched) -> MotionReport:
    """Run commanded motions, one after the other. Raises ExtraMissing."""
    unit = "mm" if isinstance(courses[0].controller, Slide) else "deg"
    return MotionReport.of(name, unit, [moved(course) for course in watched(courses)])


@dataclass(frozen=True)
class Seen:
    """One scan under control. slid_m, turned_rad: from where the object was at the handover. least_n: least force per
    pad that holds now. commanded_n: force per pad during the scan. blind: the controller knows that its pads cannot
    detect a slip. step_s: processor time from readings to touch.
    """

    moment: Moment
    touch: Touch
    commanded_n: float
    slid_m: float
    turned_rad: float
    least_n: float
    blind: bool
    step_s: float


class Course:
    """A trial with a controller at work. Iterate over it once: the scans under control until the object has slid out.

    session: the controller's. grasped: whether both pads held the object at the lift.
    """

    def __init__(
        self,
        trial: Trial,
        controller: Controller,
        method: str | None = None,
        *,
        actuator: Actuator | None = None,
        end_s: float = TRIAL.end_s,
        hand: str = "gripper",
    ) -> None:
        """method: estimator instead of the controller's own. hand: name of the plant. Raises ParameterInvalid."""
        self.trial, self.controller = trial, controller
        self._actuator, self._end_s, self._hand = actuator or Actuator(), end_s, hand
        self._method = None if controller.method is None else method or controller.method
        self.session = controller.start(trial.first_n, self._actuator.max_n)
        self.grasped = False
        self._rehearsal: Rehearsal | None = None

    @property
    def plant(self) -> Grip:
        """The gripper or hand, once the trial runs."""
        assert self._rehearsal is not None
        return self._rehearsal.plant

    def __iter__(self) -> Iterator[Seen]:
        rehearsal = self._rehearsal = Rehearsal(self.trial, None, self._actuator, self._hand)
        pads = TouchStream(rehearsal.plant.sensor, self._method, rehearsal.plant.down)
        for moment in rehearsal.start():
            touch, origin = pads.step(moment.truth.t_s, moment.readings, moment.joints), moment.truth
        self.grasped, slid_m = rehearsal.grasped, 0.0
        while rehearsal.t_s < self._end_s - 1e-9 and slid_m < TRIAL.dropped_m:
            commanded_n = self.session.step(touch)
            moment = rehearsal.step(commanded_n)
            began_s = thread_time()
            touch = pads.step(moment.truth.t_s, moment.readings, moment.joints)
            step_s = thread_time() - began_s
            slid_m = float(np.linalg.norm(moment.truth.slid_m - origin.slid_m))
            turned_rad = moment.truth.turned_rad - origin.turned_rad
            least_n, blind = (
                self.trial.least_n(moment.truth.t_s),
                isinstance(self.session, HoldSession) and self.session.blind,
            )
            yield Seen(moment, touch, commanded_n, slid_m, turned_rad, least_n, blind, step_s)


def held(course: Course) -> TrialRow:
    """Run a trial and score how the object was held."""
    return score(course, list(course))


def score(course: Course, seen: Sequence[Seen], still_m: float = 1e-3, last_s: float = 1.0) -> TrialRow:
    """Score the scans of a finished trial: held if the object slid less than `TRIAL.dropped_m`, and less than still_m
    in the last seconds.
    """
    trial, end_s = course.trial, seen[-1].moment.truth.t_s
    last = [one for one in seen if one.moment.truth.t_s > end_s - last_s]
    slid_m = max(one.slid_m for one in seen)
    inside = course.grasped and slid_m < TRIAL.dropped_m
    rests = abs(last[-1].slid_m - last[0].slid_m) < still_m
    force_n = sum(one.moment.truth.force_n for one in last)
    ratio = force_n / sum(one.least_n for one in last) if inside else None
    return TrialRow(trial.seed, trial.object, trial.event, course.grasped, inside and rests, 1e3 * slid_m, ratio)


def moved(course: Course, rested_s: float = 0.5) -> MotionRow:
    """Run a commanded motion until it has ended and rested so long, and score it."""
    controller, session, shut_s = course.controller, course.session, float("inf")
    assert isinstance(controller, Slide | Pivot) and isinstance(session, LetMove)
    for last in course:
        shut_s = min(shut_s, last.moment.truth.t_s) if session.shut else shut_s
        if last.moment.truth.t_s > shut_s + rested_s:
            break
    if isinstance(controller, Slide):
        asked, scale, true = controller.by_m, 1e3, last.slid_m
    else:
        asked, scale, true = controller.by_rad, float(np.degrees(1.0)), abs(last.turned_rad)
    numbers = (scale * asked, scale * abs(session.felt), scale * true)
    trial = course.trial
    return MotionRow(trial.seed, trial.object, trial.event, course.grasped, session.shut, *numbers)
