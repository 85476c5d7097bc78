"""Columns of a table that are named by pads: they must stand where the sensor has these pads."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.columns import Columns
from taxelflow.errors import RecordingCorrupt

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor


def check_pads(path: Path, names: Sequence[str], asked: Columns, sensor: Sensor) -> None:
    """Raises RecordingCorrupt where columns of one pad, by their names, would be read as those of another.

    Not where the user has chosen columns or their order, nor where some name is that of no pad.
    """
    layout = sensor.layout
    pads = layout.pads[: layout.pad_count]
    if asked.order is not None or asked.taxels != Columns.taxels or len(pads) < 2:
        return
    columns = sensor.channel_map.column
    expected = np.repeat(np.arange(len(pads)), np.diff(layout.starts[: len(pads) + 1]))
    found = [_pad_in(names[column], pads) for column in columns.tolist()]
    if None in found or len(set(found)) < len(pads):
        return
    for column, pad, own in zip(columns.tolist(), found, expected.tolist(), strict=True):
        if pad != pads[own]:
            seen = f"column {names[column]!r} stands where sensor {sensor.name!r} has pad {pads[own]}"
            ordered = " ".join(f"'*{one}*'" for one in pads)
            remedy = (
                f"choose columns in the sensor's order, such as --columns.taxels {ordered}, or --columns.order file"
            )
            raise RecordingCorrupt(path, seen, remedy)


def _pad_in(name: str, pads: Sequence[str]) -> str | None:
    """The pad whose name occurs in a column's name, the longest one; None if there is none."""
    found = [pad for pad in pads if re.search(_pattern(pad), name, re.IGNORECASE)]
    return max(found, key=len, default=None)


def _pattern(pad: str) -> str:
    """A pad's name between other characters; the number of a taxel may follow where it does not itself end in one."""
    return rf"(?<![^\W_]){re.escape(pad)}(?![^\W_{'' if pad[-1].isdigit() else '0-9'}])"
