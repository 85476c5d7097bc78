"""A device's clock that begins again at 0 when its number is full: 32 bits of ms last 49.7 days, of us 71.6 min."""

from __future__ import annotations

_EDGE = 0.1
"""A clock wraps from the last to the first tenth of its range; from elsewhere it was set back."""


class WrappingClock:
    """Ticks with all wraps added. span: ticks after which the clock wraps; 0 if it never does."""

    def __init__(self, span: float) -> None:
        self._span = span
        self._wraps, self._last = 0, 0.0

    def unwrapped(self, ticks: float) -> float:
        """Ticks since the clock's first 0. A scan that arrives after a later one may be from before a wrap."""
        low, high = _EDGE * self._span, (1.0 - _EDGE) * self._span
        if self._span and self._wraps and self._last < low and ticks >= high:
            return (self._wraps - 1) * self._span + ticks
        self._wraps += bool(self._span) and self._last >= high and ticks < low
        self._last = ticks
        return self._wraps * self._span + ticks
