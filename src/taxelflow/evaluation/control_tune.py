"""One search for all grip controllers: the same quasi-random draws, trials and cost for each, ours and others.

All draws are tried on the first quarter of the trials, and the cheapest of them on all: one trial more or less decides
between good draws, and bad ones need no second look.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.errors import NameUnknown
from taxelflow.evaluation.base import Table
from taxelflow.evaluation.control import ControlReport, cost_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from taxelflow.control.base import Controller
    from taxelflow.evaluation.control import TrialRow
    from taxelflow.simulation.mujoco.trial import Trial

_UP, _RELAX = (1.02, 1.3), (0.005, 0.2)
"""Ranges that the controllers with a fixed reaction share: factor of the force, and rate of its decrease."""
SPACES: dict[str, dict[str, tuple[float, float]]] = {
    "hold": {
        "stop_s": (0.01, 0.1),
        "margin": (1.02, 1.4),
        "foresee_s": (0.05, 0.6),
        "relax_1_s": _RELAX,
        "agreement.slip_m_s": (2e-3, 1e-2),
    },
    "threshold": {"change": (0.01, 0.3), "up": _UP, "relax_1_s": _RELAX},
    "centroid": {"speed_m_s": (0.003, 0.1), "up": _UP, "relax_1_s": _RELAX},
    "constant": {"times": (1.0, 8.0)},
}
"""Least and largest value of each parameter that is searched, drawn evenly in its logarithm."""


class Tried(msgspec.Struct, frozen=True):
    """One draw: parameters, and what that number of trials with them cost."""

    trials: int
    parameters: dict[str, float]
    cost: float
    held: float | None
    within_5_mm: float | None
    force_p50: float | None
    force_p90: float | None

    @property
    def words(self) -> str:
        """The parameters as they are printed."""
        return " ".join(f"{name}={value:g}" for name, value in self.parameters.items()) or "defaults"


class TuneReport(msgspec.Struct, frozen=True):
    """All draws of one controller: those tried on all trials first, then the others, each the cheapest first.

    The defaults are one of the former.
    """

    controller: str
    tried: list[Tried]


def table_of_draws(report: TuneReport) -> Table:
    """What was tried, as a table named for the controller."""
    numbers = [name for name in Tried.__struct_fields__ if name != "parameters"]
    rows = [(report.controller, one.words, *(getattr(one, name) for name in numbers)) for one in report.tried]
    return Table(report.controller, ("controller", "parameters", *numbers), rows)


def tune(
    name: str,
    controller: Controller,
    trials: Sequence[Trial],
    draws: int,
    run: Callable[[Trial, Controller], TrialRow],
    watched: Callable[[list[dict[str, float]]], Iterable[dict[str, float]]],
    first_share: float = 0.25,
    finalists: int = 4,
) -> TuneReport:
    """Try the defaults and `draws` points of a Halton sequence. run: one trial of a controller. first_share: of the
    trials on which all are tried. finalists: how many of them are tried on all trials, beside the defaults.

    Raises NameUnknown for a controller without a space.
    """
    if name not in SPACES:
        raise NameUnknown("controller to tune", name, SPACES)
    points: list[dict[str, float]] = [{}, *drawn(SPACES[name], draws)]
    count = max(round(first_share * len(trials)), 1)
    firsts = [(point, _rows(controller, point, trials[:count], run)) for point in watched(points)]
    firsts.sort(key=lambda one: cost_of(one[1]))
    best = [point for place, (point, _) in enumerate(firsts) if place < finalists or not point]
    rows = {str(point): seen for point, seen in firsts}
    for point in watched(best):
        rows[str(point)] += _rows(controller, point, trials[count:], run)
    tried = [_tried(name, point, rows[str(point)]) for point in points]
    return TuneReport(name, sorted(tried, key=lambda one: (-one.trials, one.cost)))


def drawn(space: dict[str, tuple[float, float]], draws: int) -> list[dict[str, float]]:
    """Points of a space that fill it evenly; the first ones stay the same when more are asked for."""
    from scipy.stats import qmc

    shares = qmc.Halton(len(space), scramble=False).random(draws + 1)[1:]  # without the corner
    low, high = np.log(np.array(list(space.values()))).T
    places = np.exp(low + shares * (high - low))
    return [dict(zip(space, (float(f"{value:.3g}") for value in place), strict=True)) for place in places]


def changed(controller: Any, parameters: dict[str, float]) -> Any:
    """A controller with other values of parameters; a dot leads into a parameter that has some of its own."""
    for name, value in parameters.items():
        first, _, rest = name.partition(".")
        controller = replace(
            controller, **{first: changed(getattr(controller, first), {rest: value}) if rest else value}
        )
    return controller


def _rows(
    controller: Controller,
    point: dict[str, float],
    trials: Sequence[Trial],
    run: Callable[[Trial, Controller], TrialRow],
) -> list[TrialRow]:
    """Trials with a point of a space."""
    candidate = changed(controller, point)
    return [run(trial, candidate) for trial in trials]


def _tried(name: str, point: dict[str, float], rows: list[TrialRow]) -> Tried:
    report = ControlReport.of(name, rows)
    shares = (report.held, report.within_5_mm, report.force_p50, report.force_p90)
    return Tried(len(rows), point, cost_of(rows), *shares)
