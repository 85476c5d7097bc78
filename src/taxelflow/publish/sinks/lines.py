"""Results as JSON, a line per scan: what programs in any language read."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.messages import QUALITY
from taxelflow.publish.spatial import COLUMNS, spatial_values
from taxelflow.publish.spatial import NAME as SPATIAL
from taxelflow.publish.tables import OBJECT, motion_columns

if TYPE_CHECKING:
    from taxelflow.messages import Event, Motions, Slips
    from taxelflow.publish.sinks.base import Update

_PAD = ("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s", "std_x_m", "std_y_m")
_QUALITY = (None, *QUALITY[1:])


def json_lines(update: Update, pads: tuple[str, ...]) -> list[bytes]:
    """A line for each scan, with its final newline. Unknown numbers are null."""
    ages = (1e3 * (time.monotonic() - update.arrived_s)).tolist()
    events = events_by_scan(update)
    encode = msgspec.json.encode  # NaN becomes null
    scans = zip(update.slips.t_s.tolist(), ages, pad_rows(update, pads), object_rows(update.motions), strict=True)
    in_space = spatial_objects(update, pads)
    return [
        encode(
            {"t_s": t_s, "age_ms": age, "pads": by_pad, "object": moved}
            | ({SPATIAL: in_space[scan]} if in_space else {})
            | {"events": events.get(scan, [])}
        )
        + b"\n"
        for scan, (t_s, age, by_pad, moved) in enumerate(scans)
    ]


def pad_rows(update: Update, pads: tuple[str, ...]) -> list[dict[str, dict[str, Any]]]:
    """For each scan, what is known of each pad."""
    slips: Slips = update.slips
    with np.errstate(invalid="ignore"):
        std = np.sqrt(np.diagonal(slips.covariance, axis1=2, axis2=3))
    numbers = np.concatenate([slips.pose, slips.velocity, std[..., :2]], axis=2).tolist()
    flags = zip(slips.contact.tolist(), update.slipping.tolist(), slips.quality.tolist(), numbers, strict=True)
    return [
        {
            pad: {
                "contact": touched,
                **dict(zip(_PAD, row, strict=True)),
                "slipping": slides,
                "quality": _QUALITY[judged],
            }
            for pad, touched, slides, judged, row in zip(pads, contact, slipping, quality, rows, strict=True)
        }
        for contact, slipping, quality, rows in flags
    ]


def object_rows(motions: Motions) -> list[dict[str, float]]:
    """For each scan, the columns of object.csv."""
    return [dict(zip(OBJECT, row, strict=True)) for row in motion_columns(motions)]


def spatial_objects(update: Update, pads: tuple[str, ...]) -> list[dict[str, float | int | str]]:
    """For each scan, the columns of object3d.csv; none where the places of the pads in space are unknown."""
    if update.spatial is None:
        return []
    return [dict(zip(COLUMNS, row, strict=True)) for row in spatial_values(update.spatial, pads)]


def events_by_scan(update: Update) -> dict[int, list[dict[str, Any]]]:
    """Events as rows of events.csv, by the scan of the update that reports them."""
    found: dict[int, list[dict[str, Any]]] = {}
    for event in update.events:
        scan = min(int(np.searchsorted(update.slips.t_s, event.t_s)), len(update) - 1)
        found.setdefault(scan, []).append(event_row(event))
    return found


def event_row(event: Event) -> dict[str, Any]:
    """An event, its columns as keys."""
    return asdict(event)
