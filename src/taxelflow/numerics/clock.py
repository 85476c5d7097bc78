"""Times as files and messages have them: whole nanoseconds since 1970, in 64 bits; and which ones are equal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, overload

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FARTHEST_S: Final = 1.8e10
"""Times up to this, in the year 2540, are whole nanoseconds of 64 bits; a device that sends a later one has failed."""
ROUNDING_S: Final = 1e-9
"""Rounding of a clock: a time or a difference below this is 0."""
SAME_S: Final = 1e-6
"""Times closer than this are of one scan: files of results hold whole microseconds."""


def nanoseconds(t_s: float) -> int:
    """A time in ns: 0 if it is before 1970 or unknown, that of `FARTHEST_S` if it is later than that."""
    return round(1e9 * min(max(0.0, t_s), FARTHEST_S))


@overload
def seconds(ns: int) -> float: ...
@overload
def seconds(ns: NDArray[np.integer[Any]]) -> NDArray[np.float64]: ...
def seconds(ns: Any) -> Any:
    """Nanoseconds, one or an array, in s: since 1970, as floats, they would first be rounded to 256 ns."""
    whole, rest = divmod(ns, 10**9)
    return whole + rest * 1e-9
