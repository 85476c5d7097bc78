"""Results as JSON, a line per scan: what programs in any language read."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.messages import QUALITY
from taxelflow.publish.columns import OBJECT, motion_rows
from taxelflow.publish.sinks.base import ScanText
from taxelflow.publish.spatial import COLUMNS, spatial_values
from taxelflow.publish.spatial import NAME as SPATIAL

if TYPE_CHECKING:
    from taxelflow.messages import Event, Motions
    from taxelflow.publish.sinks.base import Update

_NUMBERS = ("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s", "std_x_m", "std_y_m")
_QUALITY = (None, *QUALITY[1:])
_Pad = msgspec.defstruct(
    "_Pad", [("contact", bool), *((name, float) for name in _NUMBERS), ("slipping", bool), ("quality", str | None)]
)
_Object = msgspec.defstruct("_Object", [(name, float) for name in OBJECT])
"""Structs are made and encoded in half the time of dictionaries."""


def json_lines(update: Update, pads: tuple[str, ...]) -> list[bytes]:
    """A line for each scan, with its final newline. Unknown numbers are null."""
    ages = (1e3 * (time.monotonic() - update.arrived_s)).tolist()
    events = events_by_scan(update)
    texts = update.texts or scan_texts(update, pads)
    in_space = spatial_objects(update, pads)
    lines = []
    for scan, (t_s, age, text) in enumerate(zip(update.output.slips.t_s.tolist(), ages, texts, strict=True)):
        line = {"t_s": t_s, "age_ms": age, "pads": text.pads, "object": text.moved}
        if in_space:
            line[SPATIAL] = in_space[scan]
        line["events"] = events.get(scan, [])
        lines.append(msgspec.json.encode(line) + b"\n")
    return lines


def scan_texts(update: Update, pads: tuple[str, ...]) -> list[ScanText]:
    """For each scan, its results as JSON; NaN is null."""
    encode, raw = msgspec.json.encode, msgspec.Raw
    rows = zip(pad_rows(update, pads), object_rows(update.output.motions), strict=True)
    return [ScanText(raw(encode(by_pad)), raw(encode(moved))) for by_pad, moved in rows]


def pad_rows(update: Update, pads: tuple[str, ...]) -> list[dict[str, Any]]:
    """For each scan, what is known of each pad, as structs."""
    output, slips = update.output, update.output.slips
    numbers = np.empty((*slips.contact.shape, len(_NUMBERS)))
    numbers[..., :3], numbers[..., 3:6] = slips.pose, slips.velocity
    with np.errstate(invalid="ignore"):
        np.sqrt(slips.covariance.diagonal(axis1=2, axis2=3)[..., :2], out=numbers[..., 6:])
    flags = zip(slips.contact.tolist(), output.slipping.tolist(), slips.quality.tolist(), numbers.tolist(), strict=True)
    return [
        {
            pad: _Pad(touched, *row, slides, _QUALITY[judged])
            for pad, touched, slides, judged, row in zip(pads, contact, slipping, quality, rows, strict=True)
        }
        for contact, slipping, quality, rows in flags
    ]


def object_rows(motions: Motions) -> list[Any]:
    """For each scan, the columns of object.csv, as structs."""
    return [_Object(*row) for row in motion_rows(motions)]


def spatial_objects(update: Update, pads: tuple[str, ...]) -> list[dict[str, float | int | str]]:
    """For each scan, the columns of object3d.csv; none where the places of the pads in space are unknown."""
    spatial = update.output.spatial
    return [] if spatial is None else [dict(zip(COLUMNS, row, strict=True)) for row in spatial_values(spatial, pads)]


def events_by_scan(update: Update) -> dict[int, list[dict[str, Any]]]:
    """Events as rows of events.csv, by the scan of the update that reports them."""
    found: dict[int, list[dict[str, Any]]] = {}
    t_s = update.output.slips.t_s
    for event in update.output.events:
        scan = min(int(np.searchsorted(t_s, event.t_s)), len(t_s) - 1)
        found.setdefault(scan, []).append(event_row(event))
    return found


def event_row(event: Event) -> dict[str, Any]:
    """An event, its columns as keys; None for a pose that nothing judges."""
    return asdict(event) | {"quality": event.quality or None}
