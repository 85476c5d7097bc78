"""Learns a stream's noise and tare again from a larger sample, in another thread or process.

A baseline is adopted at a fixed time after its computation began, by the scans' own clock, so that results depend
neither on the machine nor on the size of blocks. That time is several times the usual computing time; on a slower
machine the stream waits. A live loop adopts the baseline when it is ready, see `runtime.adoption`, and learns in a
process of its own: a thread would share Python's lock with the scans, which delayed some by 2 ms at 1 kHz.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from taxelflow.condition.baseline import update_baseline
from taxelflow.numerics.clock import SAME_S
from taxelflow.runtime.adoption import AtFixedTimes, Lane
from taxelflow.runtime.worker import worker

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.condition.base import ConditionSettings
    from taxelflow.condition.baseline import Baseline
    from taxelflow.condition.sample import Sample
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.runtime.worker import Runs
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Delay:
    """Time from begin to adoption, s."""

    least_s: float = 0.1
    per_window_s: float = 2e-3
    """More for each window of the sample."""


_DELAY = _Delay()


class Relearning:
    """Learns one baseline at a time; `adopt` passes it to the stream."""

    def __init__(
        self,
        parameters: ConditionSettings,
        sensor: Sensor,
        put: Callable[[Baseline], None],
        adopting: Adopting | None = None,
    ) -> None:
        """put: uses a baseline. adopting: at fixed times if left out."""
        self._parameters, self._sensor, self._put = parameters, sensor, put
        self._lane = Lane("tare", adopting or AtFixedTimes(SAME_S))
        self._beside: Runs = _thread() if self._lane.adopting.waits else worker()

    @property
    def due_s(self) -> float:
        """Time of adoption; infinite if there is none, or as long as it is unknown."""
        return self._lane.due_s

    @property
    def free(self) -> bool:
        """Whether another may begin; a stream that never waits finishes the present one first."""
        return self._lane.adopting.waits or not self._lane.busy

    def begin(self, sample: Sample, before: Baseline, now_s: float) -> None:
        """Learn from the sample as it is now. before: the present baseline."""
        held = sample.snapshot()
        job = self._beside.submit(update_baseline, self._parameters, self._sensor, held, before)
        self._lane.begin(job, now_s, now_s + _DELAY.least_s + _DELAY.per_window_s * len(held), self._put)

    def adopt(self, now_s: float) -> None:
        """Adopt the baseline that is due, if any; waits for it if it is not ready."""
        self._lane.adopt(now_s)


@cache
def _thread() -> ThreadPoolExecutor:
    """One thread for all streams of the process."""
    return ThreadPoolExecutor(1, thread_name_prefix="taxelflow-relearn")
