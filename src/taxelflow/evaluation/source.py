"""The recording that a result came from, if it is still there, and its conditioned scans."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.acquire.columns import Columns
from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import ParameterInvalid, RecordingError
from taxelflow.numerics.clock import SAME_S
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats, Scans
    from taxelflow.publish.summary import Summary


def source_of(summary: Summary) -> Recording | None:
    """The recording of a result; None if it is gone, or has been replaced by another since."""
    try:
        topic, columns = summary.asked.get("topic"), summary.asked.get("columns")
        how = None if columns is None else Columns.of_record(columns)
        recording = api.read(summary.input, summary.layout, topic=topic, columns=how)
        first = next(recording.blocks())
    except (RecordingError, ParameterInvalid, msgspec.ValidationError, OSError):
        return None
    count = summary.scans + summary.repeated_scans_dropped
    same = recording.scans in (None, count) or summary.loss is not None
    return recording if same and first.t_s[0] == summary.t_first_s else None


def conditioned_blocks(ran: Summary, recording: Recording) -> Iterator[Scans]:
    """Blocks of scans as the run conditioned them."""
    return api.segmented(recording, Conditioner(**ran.parameters["condition"]))


def images(ran: Summary, recording: Recording, pad: int) -> Iterator[tuple[float, Floats]]:
    """Time and image (rows, cols) of one pad in every scan, conditioned as in the run; NaN where no taxel is.

    That of a separate contact has its own load only.
    """
    layout = recording.layout
    own = layout.of_pad(pad)
    for scans in conditioned_blocks(ran, recording):
        for when, pressure in zip(scans.t_s, scans.pressure, strict=True):
            image: Floats = np.full(layout.shapes[pad], np.nan)
            image[layout.row[own], layout.col[own]] = pressure[own]
            yield float(when), image


def pressure_at(ran: Summary, recording: Recording, times_s: Iterable[float]) -> dict[float, Floats]:
    """Pressure (entries,) of the scans at these times, conditioned as in the run; times without a scan are left out."""
    waiting = sorted(set(times_s))
    found: dict[float, Floats] = {}
    for scans in conditioned_blocks(ran, recording):
        while waiting and waiting[0] <= scans.t_s[-1] + SAME_S:
            near = int(abs(scans.t_s - waiting[0]).argmin())
            if abs(scans.t_s[near] - waiting[0]) <= SAME_S:
                found[waiting[0]] = scans.pressure[near].copy()
            del waiting[0]
        if not waiting:
            break
    return found
