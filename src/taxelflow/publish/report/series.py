"""Series of numbers packed for the report: rounded, as minimum and maximum of bins where they are many, compressed.

The page builds the coarser levels of each pyramid itself, by pairs of bins.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Floats


@dataclass(frozen=True, slots=True)
class _Log:
    """Standard deviations are rounded to powers."""

    step: float = 1.05
    """Ratio of two levels."""
    unit: float = 1e-7
    """Level 0, m or rad."""


LOG = _Log()


def binned(values: Floats, width: int) -> tuple[Floats, Floats]:
    """Minimum and maximum (bins,) of each `width` values (n,), the last bin perhaps of fewer; NaN counts nowhere."""
    if width == 1:
        return values, values
    count = -(-len(values) // width)
    filled = np.full(count * width, np.nan)
    filled[: len(values)] = values
    bins = filled.reshape(count, width)
    return np.fmin.reduce(bins, axis=1), np.fmax.reduce(bins, axis=1)


class Packer:
    """Collects series into one compressed text; each gets a number by which the page finds it."""

    def __init__(self) -> None:
        self._bytes: list[bytes] = []
        self._heads: list[dict[str, Any]] = []

    def add(self, values: Floats, step: float) -> int:
        """Values (n,), rounded to multiples of step; NaN stays unknown."""
        known = np.isfinite(values)
        return self._add(np.round(values[known] / step).astype(np.int64), known, {"step": step})

    def add_log(self, values: Floats) -> int:
        """Values (n,) of 0 or more, rounded to 2.5 %."""
        known = np.isfinite(values)
        exponent = np.log(np.maximum(values[known], LOG.unit) / LOG.unit) / np.log(LOG.step)
        return self._add(np.round(exponent).astype(np.int64), known, {"log": [LOG.step, LOG.unit]})

    def _add(self, numbers: np.ndarray, known: Bools, head: dict[str, Any]) -> int:
        """Differences, without sign, byte plane by byte plane: most high bytes are 0 and vanish in the compression."""
        steps = np.diff(numbers, prepend=0)
        unsigned = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype("<u8")
        planes = 1
        while planes < 6 and len(unsigned) and int(unsigned.max()) >> (8 * planes):
            planes += 1
        whole = bool(known.all())
        if not whole:
            self._bytes.append(np.packbits(known, bitorder="little").tobytes())
        self._bytes.append(np.ascontiguousarray(unsigned.view(np.uint8).reshape(-1, 8)[:, :planes].T).tobytes())
        self._heads.append(head | {"n": len(known), "known": len(numbers), "planes": planes})
        return len(self._heads) - 1

    def packed(self) -> dict[str, Any]:
        """Heads of the series in the order of their numbers, and their bytes: zlib in base64."""
        return {"heads": self._heads, "bytes": base64.b64encode(zlib.compress(b"".join(self._bytes), 6)).decode()}
