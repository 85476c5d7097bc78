"""`.npy` recordings: one array (scans, taxels) or (scans, rows, cols); times by --columns.times, a column or a rate."""

from __future__ import annotations

import tokenize
from contextlib import nullcontext
from typing import TYPE_CHECKING

from numpy.lib.format import open_memmap

from taxelflow.acquire.arrays import Stored, array_recording
from taxelflow.acquire.columns import Columns
from taxelflow.errors import RecordingCorrupt

if TYPE_CHECKING:
    from pathlib import Path

    from taxelflow.acquire.base import Recording
    from taxelflow.sensors.sensor import Sensor


def open_npy(path: Path, sensor: Sensor | None, columns: Columns | None = None) -> Recording:
    """Open an array, which is mapped and not read. Raises RecordingCorrupt, SensorNeeded, TaxelCountWrong."""
    asked = (columns or Columns()).resolved()
    try:
        array = open_memmap(path, mode="r")  # `np.load` calls other files pickled objects
    except (ValueError, EOFError, OSError, tokenize.TokenError, SyntaxError) as error:
        raise RecordingCorrupt(path, str(error), "write it with numpy.save(path, pressure)") from error
    stored = Stored(path, "npy", array.shape, array.dtype, timed=False, open=lambda: nullcontext((array, None)))
    return array_recording(stored, sensor, asked)
