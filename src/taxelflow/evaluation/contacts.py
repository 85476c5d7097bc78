"""Score contacts: two objects on one pad, split, not split, and each alone; feet of one object that lift.

Errors are those of pose_errors; all scans of a contact count alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from rich.console import Console

from taxelflow.evaluation.base import Table, unwatched
from taxelflow.evaluation.cells import caption, seeds_from, shown
from taxelflow.evaluation.nees import SPANS, Consistency, consistency
from taxelflow.evaluation.pose_errors import contacts_of, without_frame
from taxelflow.evaluation.statistics import rms
from taxelflow.messages import LOST, OK
from taxelflow.pipeline import api
from taxelflow.runtime.checks import at_least
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import of_second, simulate

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from rich.table import Table as Shown

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Estimator, Mode
    from taxelflow.evaluation.base import Cell, Watch
    from taxelflow.messages import Bools, Floats
    from taxelflow.pipeline.result import Result
    from taxelflow.simulation.scenario import Scenario

TWO = ("two-contacts", "two-contacts-meet")
LIFT = "feet-lift"
METHODS = ("template", "lnorm")


class ContactRow(msgspec.Struct, frozen=True):
    """One object of a scenario as a method saw it, over all seeds."""

    scenario: str
    method: str
    mode: str
    object: str
    seen: str
    """alone: the other object is absent. separated: with --contacts 2. as one: with --contacts 1."""
    scans: int
    """Scans in which the object touches."""
    known: float
    """Share of them with a pose that is not lost."""
    ok: float
    """Share of them with quality ok."""
    rms_mm: float | None
    """Of the distance from the true place, in mm; None without a pose."""
    rms_deg: float | None
    """Of the turn; None if none was seen."""
    consistency: list[Consistency]
    """Over 1, 20 and 100 scans, of all poses that are not lost."""


@dataclass(frozen=True)
class Contacts:
    """Measure two objects on one pad, and feet that lift.

    Each object is estimated alone, with --contacts 2, and as one contact with the other.
    """

    seeds: int = 10
    """Number of recordings of each scenario, 1 or more."""
    seed: int = 0
    """Seed of the first recording, 0 or more; the others count up from it."""
    methods: tuple[str, ...] = METHODS
    """Estimators to score; template in both modes."""

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        at_least("seed", self.seed, 0)

    def run(self, watched: Watch = unwatched) -> ContactsReport:
        """Simulate, estimate, compare. Raises NameUnknown."""
        kinds = {method: api.estimator(method) for method in self.methods}
        found: dict[Key, list[_Contact]] = {}
        noted = dict.fromkeys((*TWO, LIFT), 0)
        for number in watched(range(self.seed, self.seed + self.seeds), "seeds"):
            for case in _cases(number):
                noted[case.scenario] += _add(found, case, kinds) and case.seen == "as one"
        rows = [_row(key, own) for key, own in sorted(found.items(), key=lambda item: _place(item[0], kinds))]
        shares = {scenario: count / self.seeds for scenario, count in noted.items()}
        return ContactsReport(self.seeds, self.seed, rows, shares)


class ContactsReport(msgspec.Struct, frozen=True):
    """All rows, and the share of recordings, by scenario, whose notes report contacts that move apart."""

    seeds: int
    seed: int
    rows: list[ContactRow]
    noted: dict[str, float]

    def tables(self) -> list[Table]:
        """The rows with the NEES of each span, then the share of recordings with a note."""
        columns = ("method", "object", "seen", "known_percent", "ok_percent", "rms_mm", "rms_deg")
        rows: list[tuple[Cell, ...]] = []
        for row in self.rows:
            run = (row.scenario, row.mode, self.seeds, row.method, row.object, row.seen)
            nees = (found.nees for found in row.consistency)
            rows.append((*run, 100 * row.known, 100 * row.ok, row.rms_mm, row.rms_deg, *nees))
        noted: list[tuple[Cell, ...]] = [(scenario, 100 * share) for scenario, share in self.noted.items()]
        return [
            Table("rows", ("scenario", "mode", "seeds", *columns, *(f"nees_{over}" for over in SPANS)), rows),
            Table("noted", ("scenario", "noted_percent"), noted),
        ]

    def show(self) -> None:
        """Errors and consistency of each object, by how its contact was estimated."""
        console = Console(markup=False)
        for scenario, mode in dict.fromkeys((row.scenario, row.mode) for row in self.rows):
            console.print(self._shown(scenario, mode))
            console.print()
        for scenario, share in self.noted.items():
            console.print(f"{scenario}, as one: {share:.0%} of runs note that contacts move apart", highlight=False)
        caption(
            console,
            "alone: the other object is not there. separated: --contacts 2. as one: without. "
            "known: share of the contact's scans with a pose that is not lost; ok: with "
            "quality ok. mm, deg: RMS of place and turn, each contact's best constant offset "
            "taken off. 1, 20, 100: NEES a degree of freedom over that number of scans.",
        )

    def _shown(self, scenario: str, mode: str) -> Shown:
        rows = [row for row in self.rows if (row.scenario, row.mode) == (scenario, mode)]
        return shown(
            rows,
            *(("method:", "method"), ("object:", "object"), ("seen:", "seen")),
            ("known", lambda row: f"{row.known:.0%}"),
            ("ok", lambda row: f"{row.ok:.0%}"),
            ("mm", lambda row: _number(row.rms_mm, 3)),
            ("deg", lambda row: _number(row.rms_deg, 2)),
            *((str(span), partial(_nees, place)) for place, span in enumerate(SPANS)),
            title=f"{scenario}, {mode}, {seeds_from(self.seed, self.seeds)}",
        )


def _nees(place: int, row: ContactRow) -> str:
    return _number(row.consistency[place].nees, 1)


def _number(value: float | None, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if value < 1e3 else f"{value:.0e}"


class Key(NamedTuple):
    """What a row is of: scenario, method, mode, object, and how its contact was estimated."""

    scenario: str
    method: str
    mode: Mode
    object: str
    seen: str


class Case(NamedTuple):
    """A recording. pads: to score, one for each of objects: their names and true poses (scans, 3)."""

    scenario: str
    seen: str
    recording: Recording
    pads: list[str]
    objects: list[tuple[str, Floats]]


def _cases(seed: int) -> Iterator[Case]:
    """Every scenario with this seed, in every way in which its contacts are estimated."""
    for scenario in TWO:
        drawn = replace(SCENARIOS[scenario], seed=seed)
        first, second = _objects(drawn)
        both = simulate(drawn)
        truths = [("first", both.known_truth.pose), ("second", _second(both))]
        pad = drawn.pad
        yield Case(scenario, "alone", first, [pad], truths[:1])
        yield Case(scenario, "alone", second, [pad], [("second", second.known_truth.pose)])
        yield Case(scenario, "separated", both.with_contacts(2), [f"{pad}#1", f"{pad}#2"], truths)
        yield Case(scenario, "as one", both, [pad, pad], truths)
    lift = SCENARIOS[LIFT]
    lifting = simulate(replace(lift, seed=seed))
    yield Case(LIFT, "as one", lifting, [lift.pad], [("feet", lifting.known_truth.pose)])


def _add(found: dict[Key, list[_Contact]], case: Case, kinds: Mapping[str, Estimator]) -> bool:
    """Estimate a case by every method; whether the notes of the last one report contacts that move apart."""
    noted = False
    for method, kind in kinds.items():
        for mode in _modes(method):
            result = api.estimate(case.recording, kind, mode=mode)
            noted = any("moved apart" in note for note in result.summary.notes)
            for pad, (name, true) in zip(case.pads, case.objects, strict=True):
                key = Key(case.scenario, method, mode, name, case.seen)
                found.setdefault(key, []).append(_contact(result, result.pads.index(pad), true))
    return noted


def _modes(method: str) -> tuple[Mode, ...]:
    return ("batch", "stream") if method == "template" else ("batch",)


def _place(key: Key, kinds: Iterable[str]) -> tuple[int, int, str, str, int]:
    """Where a row stands in the table."""
    ways = ("alone", "separated", "as one")
    return (*TWO, LIFT).index(key.scenario), list(kinds).index(key.method), key.mode, key.object, ways.index(key.seen)


def _objects(scenario: Scenario) -> tuple[Recording, Recording]:
    """Each of the two objects without the other."""
    alone = replace(scenario, second=replace(scenario.second, there=False))
    return simulate(alone), simulate(of_second(scenario))


def _second(recording: Recording) -> Floats:
    second = recording.known_truth.second
    if second is None:
        raise ValueError(f"{recording.source} has one object")
    return second


@dataclass(frozen=True, slots=True, eq=False)
class _Contact:
    """One contact of one run: errors (scans, 3), covariances (scans, 3, 3), touched, known and ok (scans,)."""

    error: Floats
    covariance: Floats
    touched: Bools
    known: Bools
    ok: Bools


def _contact(result: Result, pad: int, true: Floats) -> _Contact:
    slips = result.slips
    pose, quality, touched = slips.pose[:, pad], slips.quality[:, pad], slips.contact[:, pad]
    known = np.isfinite(pose[:, :2]).all(axis=1) & (quality != LOST)
    error = np.full(pose.shape, np.nan)
    for own in contacts_of(known, np.cumsum(~touched | (quality == LOST))):
        error[own] = without_frame(pose[own], true[own], np.ones((len(own), 3)))
    return _Contact(error, slips.covariance[:, pad], touched, known, quality == OK)


def _row(key: Key, own: list[_Contact]) -> ContactRow:
    error = np.concatenate([one.error for one in own])
    touched = sum(int(one.touched.sum()) for one in own)
    far, turn = error[np.isfinite(error[:, 0]), :2], error[np.isfinite(error[:, 2]), 2]
    return ContactRow(
        **key._asdict(),
        scans=touched,
        known=sum(int((one.known & one.touched).sum()) for one in own) / max(touched, 1),
        ok=sum(int((one.ok & one.touched).sum()) for one in own) / max(touched, 1),
        rms_mm=1e3 * rms(np.hypot(*far.T)) if len(far) else None,
        rms_deg=float(np.degrees(rms(turn))) if len(turn) else None,
        consistency=[consistency([(one.error, one.covariance) for one in own], over) for over in SPANS],
    )
