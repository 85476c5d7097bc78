"""Layout of pads whose place on the hand is unknown: in rows, to one scale, pads of one finger together."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.publish.plots.names import finger
from taxelflow.publish.plots.outlines import extent_mm
from taxelflow.publish.plots.sizes import NAMES, PAPER

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.sensors.layout import Layout


def packed(layout: Layout) -> Floats:
    """(pads, 3): pose x, y, theta (m, m, rad) of each pad on the picture, theta 0."""
    blocks = [list(own) for _, own in groupby(range(layout.pad_count), lambda pad: finger(layout.pads[pad]))]
    boxes = np.array([extent_mm(layout, pad) for pad in range(layout.pad_count)])
    whole = float((boxes[:, 1] - boxes[:, 0]).sum()) * 1.5
    tried = [_rows(layout, blocks, boxes, width) for width in np.geomspace(whole / 8, whole, 12)]
    corners, sizes = zip(*tried, strict=True)
    best = int(np.argmin([abs(np.log(high / wide / PAPER.row_aspect)) for wide, high in sizes]))
    T = np.zeros((layout.pad_count, 3))
    T[:, :2] = 1e-3 * (corners[best] - boxes[:, [0, 3]])
    return T


def _rows(layout: Layout, blocks: list[list[int]], boxes: Floats, width: float) -> tuple[Floats, tuple[float, float]]:
    """Upper left corners (pads, 2) in mm of pads in rows of this width, and the extent of all, mm."""
    point = width / PAPER.row_points
    gap, head = 10 * point, (NAMES.tall * NAMES.points + 8) * point
    sizes = np.stack([boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2]], axis=1)
    room = np.array(
        [
            max(sizes[pad, 0], NAMES.wide * NAMES.points * len(layout.pads[pad]) * point) + gap
            for pad in range(len(sizes))
        ]
    )
    corners = np.zeros((len(sizes), 2))
    x, y, tall, widest = 0.0, 0.0, 0.0, 0.0
    for block in blocks:
        if x > 0 and x + room[block].sum() > width:
            x, y, tall = 0.0, y - tall - head, 0.0
        for pad in block:
            corners[pad] = x + (room[pad] - gap - sizes[pad, 0]) / 2, y
            x += room[pad]
        widest, tall = max(widest, x - gap), max(tall, float(sizes[block, 1].max()))
    return corners, (widest, tall - y + head)
