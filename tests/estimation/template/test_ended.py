"""Maps of contacts that have ended wait for their turn beside a stream."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

import numpy as np

from taxelflow.estimation.template.online.ended import Ended
from taxelflow.messages import LearnedPattern


class Busy:
    """Runs nothing until it is let."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, Future[Any]]] = []

    def submit(self, function: Any, /, *_arguments: Any) -> Future[Any]:
        self.asked.append((function, Future()))
        return self.asked[-1][1]

    def let(self) -> None:
        function, future = self.asked.pop()
        future.set_result(function())


def learned(scans: int) -> LearnedPattern:
    line = np.arange(2.0)
    return LearnedPattern("pad", 0.0, 1.0, scans, line, line, np.ones((2, 2)), np.ones((2, 2)), False, np.zeros(0, int))


def test_of_more_contacts_than_there_is_time_for_those_of_most_scans_have_maps() -> None:
    worker = Busy()
    ended = Ended(worker, at_once=False)
    counts = np.random.default_rng(0).permutation(200).tolist()
    for scans in counts:
        ended.add(lambda scans=scans: learned(scans), scans)  # type: ignore[misc]
    ended.go_on(busy=True)
    while ended.waiting:
        worker.let()
        ended.go_on(busy=False)
    assert {one.scans for one in ended.kept} == set(range(200 - 64, 200))
