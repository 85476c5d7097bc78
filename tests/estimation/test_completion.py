from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import assert_same, dome, grid_sensor
from taxelflow.errors import EstimatorBroken
from taxelflow.estimation.completion import SlipsSession
from taxelflow.messages import AMBIGUOUS, NO_POSE, OK, Estimates, Scans, cut, joined

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Floats

PALM = grid_sensor(4, 7)


def scans_of(count: int) -> Scans:
    """A dome that leaves the pad to the right."""
    pressure = np.array([dome(PALM, 0.002 * scan) for scan in range(count)]).reshape(count, 28)
    touched = np.ones((count, 1), dtype=np.bool_)
    return Scans(np.arange(float(count)), pressure, np.full(28, 100.0), np.full(28, np.inf), touched, touched)


class Holding:
    """Holds estimates back: after each step it gives the given number of rows, and the others at the end."""

    def __init__(self, rows: Sequence[int]) -> None:
        self._rows, self._held = list(rows), [Estimates.unknown(scans_of(0))]

    def step(self, scans: Scans) -> Estimates:
        self._held.append(Estimates.unknown(scans))
        return self._given(self._rows.pop(0))

    def finish(self) -> Estimates:
        return self._given(len(joined(self._held)))

    def _given(self, count: int) -> Estimates:
        held = joined(self._held)
        self._held = [cut(held, min(count, len(held)), len(held))]
        return cut(held, 0, count)


@given(st.lists(st.integers(0, 6), min_size=4, max_size=4))
def test_slips_are_the_same_however_long_estimates_are_held_back(rows: list[int]) -> None:
    scans = scans_of(24)
    at_once, late = SlipsSession(Holding([24]), PALM.layout), SlipsSession(Holding(rows), PALM.layout)
    parts = [late.step(cut(scans, start, start + 6)) for start in range(0, 24, 6)]
    assert [len(part) for part in parts] == rows
    assert_same(joined([*parts, late.finish()]), joined([at_once.step(scans), at_once.finish()]))


class Placed:
    """Poses at 0 that their method calls ok."""

    def step(self, scans: Scans) -> Estimates:
        found = Estimates.unknown(scans)
        found.pose[:], found.quality[:] = 0.0, OK
        return found

    def finish(self) -> Estimates:
        return Estimates.unknown(scans_of(0))


def judged(load: Floats, *, x: float = 0.0, unseen_error: float = 0.05, block: int = 7) -> list[int]:
    """Qualities of poses of a dome at x that is pressed so hard in scans at 50 Hz; 0: without contact."""
    count = len(load)
    palm = grid_sensor(9, 9, unseen_error=unseen_error)
    touched = (load > 0)[:, np.newaxis]
    pressure = load[:, np.newaxis] * dome(palm, x, radius_m=0.008)
    scans = Scans(np.arange(count) / 50, pressure, np.full(81, 1.0), np.full(81, np.inf), touched, touched)
    session = SlipsSession(Placed(), palm.layout)
    quality = joined([session.step(cut(scans, k, min(k + block, count))) for k in range(0, count, block)]).quality
    return np.where(touched, quality, NO_POSE)[:, 0].tolist()


RISE = np.linspace(0.05, 1.0, 20)


@given(st.integers(1, 200))
def test_a_pose_is_ambiguous_while_its_contact_forms(block: int) -> None:
    quality = judged(np.concatenate([RISE, np.ones(60), np.zeros(5), RISE, np.ones(60)]), block=block)
    formed = quality.index(OK)
    assert 25 < formed < 45  # half the time of its rise later, and 0.1 s
    assert quality[:80] == [AMBIGUOUS] * formed + [OK] * (80 - formed)
    assert quality[85:] == quality[:80]


def test_a_contact_whose_load_is_multiplied_forms_again_unless_a_border_cuts_it() -> None:
    load = np.concatenate([np.full(100, 0.2), np.ones(100), np.full(50, 1.5)])
    quality, at_border = judged(load), judged(load, x=0.035)
    assert quality[20:100] == [OK] * 80
    assert quality[100:105] == [AMBIGUOUS] * 5
    assert quality[120:] == [OK] * 130
    assert at_border[:5] == [AMBIGUOUS] * 5
    assert at_border[20:] == [OK] * 230


def test_poses_of_contacts_that_form_stay_ok_without_an_unseen_error() -> None:
    assert set(judged(RISE, unseen_error=0.0)) == {OK}


def test_an_estimator_that_gives_more_rows_than_scans_is_named() -> None:
    class Twice:
        def step(self, scans: Scans) -> Estimates:
            return joined([Estimates.unknown(scans)] * 2)

        finish = None

    session = SlipsSession(Twice(), PALM.layout)  # type: ignore[arg-type]
    with pytest.raises(EstimatorBroken, match=r"Twice gave estimates of 10 scans where at most 5 were waiting"):
        session.step(scans_of(5))


def test_a_session_that_cannot_end_is_named_before_the_first_scan() -> None:
    class Endless:
        step = None

    with pytest.raises(EstimatorBroken, match=r"Endless gave no method finish; start must return a session with"):
        SlipsSession(Endless(), PALM.layout)  # type: ignore[arg-type]


def test_an_estimator_that_loses_scans_is_named_at_the_end() -> None:
    class Lossy(Holding):
        def finish(self) -> Estimates:
            return Estimates.unknown(scans_of(0))

    session = SlipsSession(Lossy([2]), PALM.layout)
    session.step(scans_of(5))
    with pytest.raises(EstimatorBroken, match=r"Lossy gave no estimates of the last 3 scans; step and finish must"):
        session.finish()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda _: None, r"Odd gave a NoneType; step and finish must return Estimates.unknown"),
        (
            lambda one: replace(one, pose=one.pose[..., :2]),
            r"Odd gave pose of shape \(5, 1, 2\); it must be \(5, 1, 3\)",
        ),
        (lambda one: replace(one, span_s=one.span_s[:, 0]), r"Odd gave span_s of shape \(5,\); it must be \(5, 1\)"),
    ],
    ids=["none", "two of three", "no pads"],
)
def test_estimates_of_another_shape_are_refused(change: Any, says: str) -> None:
    class Odd:
        finish = None

        def step(self, scans: Scans) -> Any:
            return change(Estimates.unknown(scans))

    session = SlipsSession(Odd(), PALM.layout)  # type: ignore[arg-type]
    with pytest.raises(EstimatorBroken, match=says):
        session.step(scans_of(5))


def test_estimates_at_the_end_belong_to_the_scans_that_wait() -> None:
    session = SlipsSession(Holding([2, 0]), PALM.layout)
    scans = scans_of(10)
    assert len(session.step(cut(scans, 0, 5))) == 2
    assert len(session.step(cut(scans, 5, 10))) == 0
    last = session.finish()
    np.testing.assert_array_equal(last.t_s, np.arange(2.0, 10.0))
    assert last.border[-1, 0].tolist() == [True, True]
