"""Recognises times in another unit than s: they advance a thousand or more times as fast as the computer's clock."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median

from taxelflow.acquire.columns import PER_SECOND, RATES, likely_unit


@dataclass(frozen=True, slots=True)
class _Steps:
    """Steps of stamps that are in another unit."""

    least_s: float = 0.5
    """Shorter steps of stamps are in s, or come so often that no sensor is that fast."""
    quick: float = 20.0
    """A step is quick if it has advanced by this many times as much as the computer's clock."""
    alike: float = 3.0
    """Steps are alike if the longest is at most this many times the shortest, and clocks if they agree within it."""
    fewest: int = 5
    most: int = 32
    """Quick steps in a row that are alike, before the unit is judged, and the most that are kept."""


_STEPS = _Steps()


def unit_remedy(unit: str) -> str:
    """What to do about times in another unit than s."""
    return f"?time-unit={unit} for lines; else convert them to s"


class TimeUnit:
    """Watches the steps from stamp to stamp. doubt: what is likely wrong with the unit; empty as long as nothing is."""

    def __init__(self) -> None:
        self.doubt = ""
        self._steps: deque[tuple[float, float]] = deque(maxlen=_STEPS.most)

    def add(self, step_s: float, passed_s: float) -> bool:
        """One step, by the stamps and by the computer's clock; whether it is the one that gives rise to a doubt."""
        if step_s < _STEPS.least_s or step_s <= _STEPS.quick * passed_s:
            self._steps.clear()
            return False
        self._steps.append((step_s, passed_s))
        if self.doubt or len(self._steps) < _STEPS.fewest:
            return False
        steps_s = [step for step, _ in self._steps]
        if max(steps_s) > _STEPS.alike * min(steps_s):
            return False
        rate_hz = 1.0 / median(steps_s)
        unit = likely_unit(rate_hz)
        if unit is None or unit == "s":
            return False
        device_s, computer_s = sum(steps_s) / PER_SECOND[unit], sum(passed for _, passed in self._steps)
        agree = computer_s / _STEPS.alike < device_s < computer_s * _STEPS.alike
        if agree or rate_hz < RATES.slowest_hz:
            self.doubt = (
                f"steps of {median(steps_s):.3g} s, while scans come more than {_STEPS.quick:g} times as fast: the "
                f"times are likely in {unit} ({unit_remedy(unit)}), unless a recording is sent faster than it was made"
            )
        return bool(self.doubt)
