"""Contacts on one pad: two objects told apart, not told apart, and each alone; feet of one object that lift.

Errors are what is left of poses when the constant body offset and angle that fit best were taken off, contact by
contact, as in `limits`; all scans of a contact count alike.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow import api
from taxelflow.evaluation.limits import without_frame
from taxelflow.evaluation.nees import SPANS, Consistency, consistency
from taxelflow.messages import LOST, OK
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import of_second, simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Bools, Floats
    from taxelflow.simulation.scenario import Scenario

TWO = ("two-contacts", "two-contacts-meet")
LIFT = "feet-lift"
METHODS = ("template", "lnorm")
_FEWEST = 3


class ContactRow(msgspec.Struct, frozen=True):
    """One object of a scenario as a method saw it, over all seeds."""

    scenario: str
    method: str
    mode: str
    object: str
    seen: str
    """alone: the other one is not there. told apart: with contacts 2. as one: with contacts 1."""
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


class ContactScore(msgspec.Struct, frozen=True):
    """All rows, and the share of recordings, by scenario, whose notes say that contacts move apart."""

    seeds: int
    seed: int
    rows: list[ContactRow]
    noted: dict[str, float]


def score_contacts(
    seeds: int,
    *,
    seed: int = 0,
    methods: Sequence[str] = (),
    watched: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> ContactScore:
    """Score methods, `METHODS` if none is named, on both modes where they differ. Raises NameUnknown."""
    kinds = {method: api.estimator(method) for method in methods or METHODS}
    found: dict[tuple[str, str, Mode, str, str], list[_Seen]] = {}
    noted = dict.fromkeys((*TWO, LIFT), 0)
    for number in watched(range(seed, seed + seeds)):
        for case, recording, pads, truths in _cases(number):
            scenario, seen = case
            noted_here = False
            for method, kind in kinds.items():
                for mode in _modes(method):
                    result = api.estimate(recording, kind, mode=mode)
                    noted_here = any("moved apart" in note for note in result.summary.notes)
                    for pad, (name, true) in zip(pads, truths, strict=True):
                        own = _seen(result, result.pads.index(pad), true)
                        found.setdefault((scenario, method, mode, name, seen), []).append(own)
            noted[scenario] += noted_here and seen == "as one"
    rows = [_row(key, own) for key, own in sorted(found.items(), key=lambda item: _place(item[0], kinds))]
    return ContactScore(seeds, seed, rows, {scenario: count / seeds for scenario, count in noted.items()})


def _modes(method: str) -> tuple[Mode, ...]:
    return ("batch", "stream") if method == "template" else ("batch",)


def _place(key: tuple[str, str, str, str, str], kinds: Iterable[str]) -> tuple[int, int, str, str, int]:
    scenario, method, mode, name, seen = key
    ways = ("alone", "told apart", "as one")
    return ((*TWO, LIFT).index(scenario), list(kinds).index(method), mode, name, ways.index(seen))


Case = tuple[tuple[str, str], "Recording", list[str], list[tuple[str, "Floats"]]]


def _cases(seed: int) -> Iterator[Case]:
    """Scenario and how it is seen; its recording; pads to score, and the object and true poses (scans, 3) of each."""
    for scenario in TWO:
        drawn = replace(SCENARIOS[scenario], seed=seed)
        first, second = _objects(drawn)
        both = simulate(drawn)
        truths = [("first", both.known_truth.pose), ("second", _second(both))]
        pad = drawn.pad
        yield (scenario, "alone"), first, [pad], truths[:1]
        yield (scenario, "alone"), second, [pad], [("second", second.known_truth.pose)]
        yield (scenario, "told apart"), both.with_contacts(2), [f"{pad}#1", f"{pad}#2"], truths
        yield (scenario, "as one"), both, [pad, pad], truths
    lifting = simulate(replace(SCENARIOS[LIFT], seed=seed))
    yield (LIFT, "as one"), lifting, [SCENARIOS[LIFT].pad], [("feet", lifting.known_truth.pose)]


def _objects(scenario: Scenario) -> tuple[Recording, Recording]:
    """Each of the two objects without the other."""
    alone = replace(scenario, second=replace(scenario.second, there=False))
    return simulate(alone), simulate(of_second(scenario))


def _second(recording: Recording) -> Floats:
    second = recording.known_truth.second
    if second is None:
        raise ValueError(f"{recording.source} has one object")
    return second


class _Seen:
    """One contact of one run: errors (scans, 3), covariances (scans, 3, 3), touched, known and ok (scans,)."""

    def __init__(self, error: Floats, covariance: Floats, touched: Bools, known: Bools, ok: Bools) -> None:
        self.error, self.covariance = error, covariance
        self.touched, self.known, self.ok = touched, known, ok


def _seen(result: api.Result, pad: int, true: Floats) -> _Seen:
    slips = result.slips
    pose, quality, touched = slips.pose[:, pad], slips.quality[:, pad], slips.contact[:, pad]
    known = np.isfinite(pose[:, :2]).all(axis=1) & (quality != LOST)
    error = np.full(pose.shape, np.nan)
    piece = np.cumsum(~touched | (quality == LOST))
    for number in np.unique(piece[known]):
        own = np.flatnonzero(known & (piece == number))
        if len(own) >= _FEWEST:
            error[own] = without_frame(pose[own], true[own], np.ones((len(own), 3)))
    return _Seen(error, slips.covariance[:, pad], touched, known, quality == OK)


def _row(key: tuple[str, str, Mode, str, str], own: list[_Seen]) -> ContactRow:
    scenario, method, mode, name, seen = key
    error = np.concatenate([one.error for one in own])
    touched = sum(int(one.touched.sum()) for one in own)
    far, turn = error[np.isfinite(error[:, 0]), :2], error[np.isfinite(error[:, 2]), 2]
    return ContactRow(
        scenario=scenario,
        method=method,
        mode=mode,
        object=name,
        seen=seen,
        scans=touched,
        known=sum(int((one.known & one.touched).sum()) for one in own) / max(touched, 1),
        ok=sum(int((one.ok & one.touched).sum()) for one in own) / max(touched, 1),
        rms_mm=1e3 * float(np.sqrt(np.mean(np.sum(far**2, axis=1)))) if len(far) else None,
        rms_deg=float(np.degrees(np.sqrt(np.mean(turn**2)))) if len(turn) else None,
        consistency=[consistency([(one.error, one.covariance) for one in own], over) for over in SPANS],
    )
