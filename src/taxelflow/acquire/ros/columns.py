"""Which number of a message each taxel is read from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.acquire.ros.kinds import Kind
    from taxelflow.sensors.layout import Indices
    from taxelflow.sensors.sensor import Sensor


def columns_of(sensor: Sensor, kind: Kind, cells: Sequence[int], named: Sequence[str] = ()) -> Indices | None:
    """(columns,): number of the message that each column of the sensor is read from; None if they do not match.

    cells: numbers per part. named: the parts' names, which give their order where they are those of the sensor's pads.
    A message may also contain the cells of grids without a taxel.
    """
    layout = sensor.layout
    pads = layout.pads[: layout.pad_count]
    by_name = len(named) == len(cells) and sorted(named) == sorted(pads)
    if not sensor.channel_map.identity:
        return _of_channels(sensor, cells, named if by_name else ())
    order = list(range(layout.pad_count))
    if by_name or set(kind.pads) == set(pads):
        order = [pads.index(name) for name in (named if by_name else kind.pads)]
    own = [layout.of_pad(pad) for pad in range(layout.pad_count)]
    grids = zip(layout.shapes, layout.tables, own, strict=False)
    all_cells = [one.stop - one.start if table else rows * cols for (rows, cols), table, one in grids]
    if sum(cells) == layout.taxels:
        cell_of = [np.arange(one.stop - one.start) for one in own]
        sizes = [len(one) for one in cell_of]
    elif sum(cells) == sum(all_cells):
        cell_of = [layout.row[one] * layout.shapes[pad][1] + layout.col[one] for pad, one in enumerate(own)]
        sizes = all_cells
    else:
        return None
    if len(cells) == len(order) and list(cells) != [sizes[pad] for pad in order]:
        return None
    columns = np.zeros(layout.taxels, dtype=np.int64)
    start = 0
    for pad in order:
        columns[own[pad]] = start + cell_of[pad]
        start += sizes[pad]
    return columns


def _of_channels(sensor: Sensor, cells: Sequence[int], named: Sequence[str]) -> Indices | None:
    """Of a sensor file that describes the source's channels: all in their order, or parts by the names of the pads."""
    layout, channel_map = sensor.layout, sensor.channel_map
    if sum(cells) != channel_map.columns:
        return None
    if not named:
        return np.arange(channel_map.columns)
    firsts = [channel_map.column[layout.of_pad(pad)].min() for pad in range(layout.pad_count)]
    starts = np.cumsum([0, *cells])
    parts = [named.index(layout.pads[pad]) for pad in np.argsort(firsts)]
    return np.concatenate([np.arange(starts[part], starts[part + 1]) for part in parts])
