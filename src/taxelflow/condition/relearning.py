"""Learns a stream's noise and tare again from a larger sample, beside the stream.

What is learned is adopted a fixed time after it was begun, by the scans' own clock, so that results depend neither on
the machine nor on the blocks that scans come in. The time is several times what learning takes; a machine that is too
slow makes the stream wait. A live loop adopts it when it is ready instead, see `runtime.adoption`, and learns in a
process of its own: a thread would take turns with the scan's, which at 1 kHz made some of them 2 ms later.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TYPE_CHECKING

from taxelflow.condition.baseline import update_baseline
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

_LEAST_S, _PER_WINDOW_S = 0.1, 2e-3
"""Time until what is learned is adopted: at least, and for each window of the sample."""


class Relearning:
    """At most one baseline at a time is being learned; `adopt` puts it to use."""

    def __init__(
        self,
        parameters: ConditionSettings,
        sensor: Sensor,
        put: Callable[[Baseline], None],
        adopting: Adopting | None = None,
    ) -> None:
        """put: uses a baseline. adopting: at fixed times if left out."""
        self._parameters, self._sensor, self._put = parameters, sensor, put
        self._lane = Lane("tare", adopting or AtFixedTimes())
        self._beside: Runs = _thread() if self._lane.adopting.waits else worker()

    @property
    def due_s(self) -> float:
        """When it is to be adopted; infinite if there is none, or nobody knows yet."""
        return self._lane.due_s

    @property
    def free(self) -> bool:
        """Whether another may begin: a stream that never waits goes on with what has been begun."""
        return self._lane.adopting.waits or not self._lane.busy

    def begin(self, sample: Sample, before: Baseline, now_s: float) -> None:
        """Learn from what the sample holds now. before: what is known."""
        held = sample.snapshot()
        job = self._beside.submit(update_baseline, self._parameters, self._sensor, held, before)
        self._lane.begin(job, now_s, now_s + _LEAST_S + _PER_WINDOW_S * len(held), self._put)

    def adopt(self, now_s: float) -> None:
        """Put to use what is being learned, if anything is; waits for it if it is not ready."""
        self._lane.adopt(now_s)


@cache
def _thread() -> ThreadPoolExecutor:
    """One thread for all streams of the process."""
    return ThreadPoolExecutor(1, thread_name_prefix="taxelflow-relearn")
