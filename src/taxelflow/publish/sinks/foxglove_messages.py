"""Scans and slips as messages for Foxglove: a point per taxel, a grid per pad, an arrow per slip vector.

The messages are those of foxglove-sdk in protobuf. All lie in the frame `hand`, the skin laid flat; pads without a
place in it stand in a row beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taxelflow.errors import ExtraMissing
from taxelflow.numerics.clock import nanoseconds
from taxelflow.numerics.geometry import transform
from taxelflow.sensors.channels import plausible
from taxelflow.sensors.triangulation import raster_cell_m

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.messages import Floats
    from taxelflow.publish.sinks.base import Update
    from taxelflow.sensors.layout import Layout
    from taxelflow.sensors.sensor import Sensor

_FRAME = "hand"


@dataclass(frozen=True, slots=True)
class _Arrow:
    """An arrow along the object's path."""

    path_s: float = 0.2
    """An arrow is as long as the object's path in this time."""
    shortest_m: float = 1e-4
    """Length below which an arrow is not drawn."""


_ARROW = _Arrow()
_FLOAT = np.dtype(np.float32).itemsize
"""Bytes of a number."""


class Drawn(NamedTuple):
    """A message in protobuf. t_ns: of the scan."""

    topic: str
    t_ns: int
    content: bytes


class Drawing:
    """Draws the scans of one sensor."""

    def __init__(self, sensor: Sensor) -> None:
        """Raises ExtraMissing."""
        try:
            from foxglove import messages
        except ImportError as error:
            raise ExtraMissing("view", "foxglove-sdk") from error
        self._messages: Any = messages
        self._sensor, self._layout = sensor, sensor.layout
        self._place = _places(self._layout)
        self._cells = [_cells(self._layout, pad) for pad in range(self._layout.pad_count)]
        self._points = np.zeros((self._layout.taxels, 4), np.float32)
        for pad in range(self._layout.pad_count):
            own = self._layout.of_pad(pad)
            self._points[own, :2] = transform(
                self._place[pad], np.stack([self._layout.x_m[own], self._layout.y_m[own]], axis=1)
            )
        number = messages.PackedElementFieldNumericType.Float32
        self._axes = [
            messages.PackedElementField(name=name, offset=_FLOAT * k, type=number)
            for k, name in enumerate(("x", "y", "z", "pressure"))
        ]
        self._value = [messages.PackedElementField(name="pressure", offset=0, type=number)]

    @property
    def schemas(self) -> dict[str, Any]:
        """Schema (name, encoding, data) by topic."""
        messages = self._messages
        grids = {f"/pads/{name}": messages.Grid for name in self._layout.pads[: self._layout.pad_count]}
        kinds = {"/taxels": messages.PointCloud, **grids, "/arrows": messages.SceneUpdate}
        return {topic: kind.get_schema() for topic, kind in kinds.items()}

    def scan(self, t_s: float, values: Floats) -> Iterator[Drawn]:
        """A scan (columns,) as the source sent it: the cloud of all taxels and a grid for each pad."""
        messages, layout = self._messages, self._layout
        readings = self._sensor.channel_map.to_readings(plausible(values)[np.newaxis])[0]
        t_ns = nanoseconds(t_s)
        stamp = self._stamp(t_ns)
        self._points[:, 3] = np.nan_to_num(readings)
        cloud = messages.PointCloud(
            timestamp=stamp,
            frame_id=_FRAME,
            pose=self._pose(0.0, 0.0, 0.0),
            point_stride=4 * _FLOAT,
            fields=self._axes,
            data=self._points.tobytes(),
        )
        yield Drawn("/taxels", t_ns, cloud.encode())
        for pad in range(layout.pad_count):
            yield Drawn(f"/pads/{layout.pads[pad]}", t_ns, self._grid(pad, readings, stamp).encode())

    def arrows(self, update: Update) -> Drawn:
        """The velocity of the object on each pad in the last of these scans; red where it slips."""
        messages, layout = self._messages, self._layout
        velocity, place = update.output.slips.velocity[-1], update.output.contacts.centroid[-1]
        arrows = []
        for pad in range(layout.pad_count):
            length = _ARROW.path_s * float(np.hypot(*velocity[pad, :2]))
            if not length >= _ARROW.shortest_m or not np.isfinite(place[pad]).all():
                continue
            x, y = transform(self._place[pad], place[pad]).tolist()
            turn = float(np.arctan2(velocity[pad, 1], velocity[pad, 0]) + self._place[pad, 2])
            red = 1.0 if update.output.slipping[-1, pad] else 0.2
            arrows.append(
                messages.ArrowPrimitive(
                    pose=self._pose(x, y, turn),
                    shaft_length=0.75 * length,
                    shaft_diameter=1e-3,
                    head_length=0.25 * length,
                    head_diameter=2e-3,
                    color=messages.Color(r=red, g=0.2, b=1.2 - red, a=1.0),
                )
            )
        t_ns = nanoseconds(float(update.output.slips.t_s[-1]))
        entity = messages.SceneEntity(timestamp=self._stamp(t_ns), frame_id=_FRAME, id="slip", arrows=arrows)
        return Drawn("/arrows", t_ns, messages.SceneUpdate(entities=[entity]).encode())

    def _grid(self, pad: int, readings: Floats, stamp: Any) -> Any:
        messages, layout = self._messages, self._layout
        image = np.ascontiguousarray(np.flipud(layout.grid(pad, readings, 0.0)), np.float32)  # y grows upwards
        cell, corner = self._cells[pad]
        x, y = transform(self._place[pad], corner).tolist()
        return messages.Grid(
            timestamp=stamp,
            frame_id=_FRAME,
            pose=self._pose(x, y, float(self._place[pad, 2])),
            column_count=image.shape[1],
            cell_size=messages.Vector2(x=float(cell[0]), y=float(cell[1])),
            row_stride=_FLOAT * image.shape[1],
            cell_stride=_FLOAT,
            fields=self._value,
            data=np.nan_to_num(image).tobytes(),
        )

    def _pose(self, x: float, y: float, theta: float) -> Any:
        messages = self._messages
        turn = messages.Quaternion(x=0.0, y=0.0, z=float(np.sin(theta / 2)), w=float(np.cos(theta / 2)))
        return messages.Pose(position=messages.Vector3(x=x, y=y, z=0.0), orientation=turn)

    def _stamp(self, t_ns: int) -> Any:
        return self._messages.Timestamp(sec=t_ns // 10**9, nsec=t_ns % 10**9)


def _cells(layout: Layout, pad: int) -> tuple[Floats, Floats]:
    """Size of a cell of the pad's image, and its lower left corner in the pad's frame, (2,), m."""
    own, pitch = layout.of_pad(pad), layout.pitch_m[pad]
    row, col, rows = layout.row[own], layout.col[own], layout.shapes[pad][0]
    xy = np.stack([layout.x_m[own], layout.y_m[own]], axis=1)
    left, top = xy[:, 0].min(), xy[:, 1].max()
    if layout.tables[pad] and len(xy) > 1:
        cell = np.full(2, raster_cell_m(xy))
        return cell, np.array([left, top - rows * cell[1]])
    return pitch, np.array([left - (col.min() + 0.5) * pitch[0], top - (rows - row.min() - 0.5) * pitch[1]])


def _places(layout: Layout) -> Floats:
    """(pads, 3), pose of each pad in the picture."""
    place = layout.T_hand[: layout.pad_count].copy()
    known = np.isfinite(place).all(axis=1)
    right = float(place[known, 0].max()) + 0.03 if known.any() else 0.0
    for pad in np.flatnonzero(~known).tolist():
        width = layout.shapes[pad][1] * float(layout.pitch_m[pad, 0])
        place[pad] = right + width / 2, 0.0, 0.0
        right += width + 0.01
    return place
