from __future__ import annotations

from typing import Any

from compiled import compiled
from taxelflow.numerics.records import records
from taxelflow.slip.hypotheses import merge_closest as _merge_closest
from taxelflow.slip.hypotheses import remove as _remove
from taxelflow.slip.onset import Ramp

merge_closest = compiled(_merge_closest)
remove = compiled(_remove)


def started(*times: float) -> Any:
    found = records(Ramp, len(times))
    found["start_s"], found["weight"] = times, 1.0
    return found


def test_the_one_that_leaves_the_smallest_gap_for_its_age_is_merged_into_the_next() -> None:
    ramps = started(0.0, 4.0, 5.0, 8.0, 9.0, 10.0)
    merge_closest(11.0, 6, 2, ramps)  # gaps over ages: 5 / 6, 4 / 3
    assert ramps["start_s"][:5].tolist() == [0.0, 5.0, 8.0, 9.0, 10.0]
    assert ramps["weight"][:5].tolist() == [1.0, 2.0, 1.0, 1.0, 1.0]
    ramps = started(0.0, 6.0, 6.5, 7.0, 9.0, 10.0)
    merge_closest(11.0, 6, 2, ramps)  # 6.5 / 4.5, 1 / 4
    assert ramps["start_s"][:5].tolist() == [0.0, 6.0, 7.0, 9.0, 10.0]


def test_only_those_in_use_are_moved() -> None:
    ramps = started(0.0, 1.0, 2.0, 3.0)
    remove(0, 3, ramps)
    assert ramps["start_s"].tolist() == [1.0, 2.0, 2.0, 3.0]
