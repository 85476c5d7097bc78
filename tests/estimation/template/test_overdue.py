"""What is being learned and comes late is asked for again, with more scans."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.estimation.template.online.candidates import Waiting
from taxelflow.estimation.template.online.local_map import LocalMap
from taxelflow.estimation.template.online.mapping_thread import Learner, Workers
from taxelflow.runtime.adoption import Adoption, AsRecorded, Lane, Late, WhenReady

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.runtime.adoption import Adopting


class Mapper:
    """Keeps what is asked for; nothing is ever begun."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, Future[Any]]] = []
        self.states: list[np.ndarray] = []

    def submit(self, _function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        self.asked.append((len(arguments[1].t_s), Future()))
        self.states.append(arguments[1].states)
        return self.asked[-1][1]


def learned(keyframes: int, **known: Any) -> LocalMap:
    return LocalMap(None, [0] * keyframes, 1.0, np.ones(1), **known)  # type: ignore[arg-type]


def moving(adopting: Adopting, scans: int, **known: Any) -> tuple[Learner, Mapper, list[LocalMap]]:
    """A learner whose contact moves for this many scans at 100 Hz, each of them new."""
    mapper, used = Mapper(), list[LocalMap]()
    learner = Learner("pad", Workers(mapper, mapper), 0.1, adopting)
    learner.learned = learned(1, **known)
    for scan in range(scans):
        t_s = 0.01 * scan
        learner.waiting.add(t_s, *(np.zeros(1),) * 2, np.zeros((3, 1)), np.zeros(5))
        learner.go_on(t_s, used.append, may_turn=False)
    return learner, mapper, used


def test_what_is_overdue_is_asked_for_again_when_half_as_many_keyframes_have_come() -> None:
    _, mapper, _ = moving(Late(1.0), 40)
    assert [count for count, _ in mapper.asked] == [1, 4, 7, 11, 22, 34]  # of 12 keyframes on it may take 0.1 s
    _, unhurried, _ = moving(Late(1.0), 3)
    assert len(unhurried.asked) == 1


def test_a_pattern_that_changes_or_grows_is_not_asked_for_again() -> None:
    assert len(moving(Late(1.0), 40, changing=True)[1].asked) == 1
    assert len(moving(Late(1.0), 40, grows=True)[1].asked) == 1


def test_a_live_loop_asks_no_more_for_what_has_not_been_begun() -> None:
    _, mapper, _ = moving(WhenReady(), 40)
    assert [result.cancelled() for _, result in mapper.asked] == [True] * 5 + [False]


def test_scans_that_were_learned_wait_no_longer_and_later_requests_go_on() -> None:
    learner, mapper, used = moving(Late(0.1), 13)  # asked for with 1, 4, 7 and 11 scans
    mapper.asked[1][1].set_result(learned(5))
    learner.lane.adopt(0.135)
    assert (len(used), learner.lane.busy, len(learner.waiting)) == (1, True, 9)
    assert mapper.asked[0][1].cancelled()
    assert not mapper.asked[2][1].cancelled()


def test_requests_for_a_pattern_that_did_not_turn_are_dropped_once_it_does() -> None:
    learner, mapper, _ = moving(Late(0.1), 13)
    mapper.asked[1][1].set_result(learned(5, turns=True))
    learner.lane.adopt(0.135)
    assert not learner.lane.busy
    assert mapper.asked[2][1].cancelled()


def test_the_newest_request_that_is_due_is_used() -> None:
    lane, used, requests = Lane("pad", ready := WhenReady()), [], [Future[int]() for _ in range(3)]
    for number, request in enumerate(requests):
        request.set_running_or_notify_cancel()
        lane.renew(request, float(number), number + 0.1, used.append)
    for request in requests[:2]:
        request.set_result(7)
    assert (lane.due_s, lane.planned_s) == (-np.inf, 2.1)
    lane.adopt(3.0)
    assert (len(used), lane.busy, lane.due_s) == (1, True, np.inf)
    assert ready.taken() == [Adoption("pad", 1, 3.0)]


def test_a_replay_uses_the_request_that_the_loop_used() -> None:
    lane, used = Lane("pad", AsRecorded([Adoption("pad", 1, 3.0)])), []
    for number in range(3):
        request = Future[int]()
        lane.renew(request, float(number), number + 0.1, used.append)
        request.set_result(number)
    assert lane.due_s == 3.0
    lane.adopt(3.0)
    assert (used, lane.busy) == ([1], True)


def test_scans_that_wait_move_with_the_newest_keyframe_of_a_new_pattern() -> None:
    learner, _, _ = moving(Late(0.1), 13)
    learner.waiting.all.states[:] = 1.0, 2.0, 0.0, 2.0, 0.0
    learner._newest = np.array([1.0, 2.0, 0.0, 2.0, 0.0])
    keyframes = SimpleNamespace(states=np.array([[3.0, 1.0, 0.5, 1.0, 0.0]]))
    state = np.array([1.5, 2.0, 0.0, 3.0, 0.0])
    still, turns = (LocalMap(None, keyframes, 1.0, np.ones(1), turns=turns) for turns in (False, True))  # type: ignore[arg-type]
    np.testing.assert_allclose(learner.shifted(still, state.copy()), [2.0, -1.0, 0.0])
    np.testing.assert_allclose(learner.shifted(turns, state), [2.0, -1.0, 0.5])
    np.testing.assert_allclose(state, [1.5, 2.0, 0.0, 1.5, 0.0])  # the last scan has to be registered there
    learner.shift_waiting(np.array([2.0, -1.0, 0.5, 9.0, 9.0]))
    np.testing.assert_allclose(learner.waiting.all.states, [[3.0, 1.0, 0.5, 2.0, 0.0]] * 13)


def test_scans_that_were_asked_for_stay_where_they_were_when_those_that_wait_move() -> None:
    """The request may be sent to its process after that."""
    learner, mapper, _ = moving(WhenReady(), 4)
    learner.shift_waiting(np.ones(5))
    np.testing.assert_array_equal(mapper.states[-1], np.zeros((4, 5)))
    np.testing.assert_array_equal(learner.waiting.all.states[:, :3], np.ones((4, 3)))


def test_any_number_of_scans_may_wait() -> None:
    waiting = Waiting()
    assert waiting.leave(0) == len(waiting.all.t_s) == 0
    for scan in range(300):
        waiting.add(float(scan), np.full(2, scan + 0.1), np.ones(2), np.zeros((3, 0)), np.full(5, scan + 0.5))
    assert (waiting.leave(100), waiting.leave(100), waiting.leave(150), len(waiting)) == (100, 0, 50, 150)
    left = waiting.all
    assert left.t_s.tolist() == list(range(150, 300))
    assert left.readings[:, 1].tolist() == (left.t_s + 0.1).tolist()
    assert left.states[:, 4].tolist() == (left.t_s + 0.5).tolist()
