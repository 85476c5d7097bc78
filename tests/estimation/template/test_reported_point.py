"""What a stream reports when its map is learned again: the point of the object, and what a step adds to covariances."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from compiled import compiled
from estimation.template.test_map_update import keyframes_of
from estimation.template.test_taxel_gains import sliding
from synthetic import grid_sensor
from taxelflow.estimation.template.centre_of_pressure import Anchor
from taxelflow.estimation.template.online import map_update
from taxelflow.estimation.template.online.hand import Scan, hand_of, room_for
from taxelflow.estimation.template.online.local_maps import LocalMaps
from taxelflow.estimation.template.online.map_update import learn
from taxelflow.estimation.template.online.mapping_thread import Workers
from taxelflow.estimation.template.online.output import _add_step, report
from taxelflow.estimation.template.online.track_state import FAINT, NOTHING, NOVEL, Track
from taxelflow.estimation.template.online.witness import put_on_average, reported_place
from taxelflow.estimation.template.warmup import compile_stream
from taxelflow.messages import no_scans
from taxelflow.numerics.records import record, records

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.numerics.records import Records


AVERAGE = Anchor(np.array([0.3, -0.1]), 0.0, np.array([0.2, 0.1]), np.zeros(0), np.zeros((0, 2)))


def track(held: Records | None = None) -> Track:
    m = record(Track, records(Track, 1) if held is None else held, 0)
    m.state[:] = [1.0, 2.0, 0.5, 1.0, 0.0]
    m.theta_0, m.arm_load = 0.2, 1.0
    return m


def test_the_point_turns_with_the_object() -> None:
    m = track()
    put_on_average(m, AVERAGE)
    cos, sin = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(reported_place(m, m.state), [1 + 0.3 * cos + 0.1 * sin, 2 + 0.3 * sin - 0.1 * cos])


def test_an_object_that_was_known_before_keeps_its_point() -> None:
    m = track()
    m.arm_load = np.inf
    before = m.arm.copy()
    put_on_average(m, AVERAGE)
    np.testing.assert_array_equal(m.arm, before)


def test_an_object_on_a_line_of_taxels_keeps_its_point() -> None:
    m = track()
    m.across[:] = 3.0, 0.0
    put_on_average(m, AVERAGE)
    np.testing.assert_array_equal(m.arm, 0.0)


@pytest.mark.parametrize(("share", "left"), [(0.0, 1.0), (0.5, 0.25), (1.0, 0.0)])
def test_a_step_of_the_map_counts_as_far_as_the_map_does(share: float, left: float) -> None:
    cov = np.diag([1.0, 2.0, 3.0])
    _add_step(0.1, share * np.eye(2), cov)
    np.testing.assert_allclose(cov, np.diag([1.0 + 0.1 * left, 2.0 + 0.1 * left, 3.0]))


def test_a_mapper_in_a_process_of_its_own_finds_the_point_before_the_first_scan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = []
    monkeypatch.setattr(map_update, "anchor_of", lambda *given: found.append(given))
    compile_stream.__wrapped__()
    assert found


class AtOnce:
    """A mapper that learns when it is asked."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(function(*arguments))
        return done


def test_a_map_in_another_frame_moves_no_point_and_its_steps_count_up_to_one_load() -> None:
    scanned, at, _ = sliding(0.0)
    gains = np.ones(scanned.readings.shape[1])
    last = scanned.readings[-1]
    scan = Scan(0.78, last, scanned.variance[-1], np.full(len(last), np.inf), last, np.ones(1, np.bool_))
    maps = LocalMaps(grid_sensor(12, 12).layout, Workers(AtOnce(), AtOnce()), 0.1)
    maps.begin(0, scan)
    maps._last = scan
    maps._improve(0, learn(keyframes_of(scanned, at, gains)))
    m = maps.track(0)
    before, m.broken = reported_place(m, m.state), 1.0
    new = learn(keyframes_of(scanned, at + 0.3, gains))
    maps._improve(0, new)
    np.testing.assert_allclose(reported_place(m, m.state), before, atol=0.02)
    assert new.anchor is not None
    assert m.broken == 1.0  # what was lost stays so
    assert m.wander <= new.anchor.variance


@pytest.mark.parametrize(("probation", "flag"), [(0.0, NOVEL), (1.0, NOTHING)])
def test_a_faint_map_learns_from_a_loud_scan_only_where_it_surely_is(probation: float, flag: int) -> None:
    layout, held = grid_sensor(8, 8).layout, records(Track, 1)
    m = track(held)
    m.keyframes, m.probation, m.usual, m.count, m.radius = 10, probation, 1.0, 20.0, 1.0
    m.state[3] = 2.0 * FAINT
    m.doubted[:] = m.step[:] = 1e4 * np.eye(5)
    rows = room_for(no_scans(layout.entries, 1, 1))
    compiled(report)(0.0, 0, 0, 0.003, 0.05, held[0], hand_of(layout).room, rows)
    assert m.flag == flag
