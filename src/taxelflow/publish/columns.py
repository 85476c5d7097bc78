"""Columns of the result tables: names, kinds, and values from the messages of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from taxelflow.messages import QUALITY
from taxelflow.publish import spatial

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from taxelflow.messages import Bools, Contacts, Event, Floats, Motions, Slips

    Kind = Literal["time", "text", "flag", "count", "number"]

# fmt: off
SLIPS = (
    "t_s", "pad", "contact", "dx_m", "dy_m", "dtheta_rad", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s",
    "omega_rad_s", "std_x_m", "std_y_m", "std_theta_rad", "slipping", "border_x", "border_y", "lag_s",
    "load_pa", "cov_xy", "cov_xtheta", "cov_ytheta", "quality", "evidence",
)
OBJECT = (
    "t_s", "vx_m_s", "vy_m_s", "omega_rad_s", "rotor_1_s", "cx_m", "cy_m", "x_m", "y_m", "theta_rad", "pads",
    "std_vx_m_s", "std_vy_m_s", "std_omega_rad_s", "std_rotor_1_s", "std_cx_m", "std_cy_m",
    "std_x_m", "std_y_m", "std_theta_rad",
)
CONTACTS = (
    "t_s", "pad", "force_n", "area_m2", "peak_pa", "x_m", "y_m", "major_m", "minor_m", "eccentricity",
    "orientation_rad", "std_force_n", "std_orientation_rad",
)
EVENTS = (
    "t_s", "pad", "event", "onset_s", "direction_rad", "speed_m_s", "turn_rad_s", "evidence", "quality",
    "path_m", "turn_rad", "duration_s", "std_speed_m_s", "std_path_m", "std_turn_rad", "std_duration_s",
)
# fmt: on
_KINDS: dict[str, Kind] = {
    **dict.fromkeys(("t_s", "onset_s"), "time"),
    **dict.fromkeys(("pad", "event", "quality", *spatial.TEXTS), "text"),
    **dict.fromkeys(("contact", "slipping", "border_x", "border_y"), "flag"),
    **dict.fromkeys(("pads", *spatial.COUNTS), "count"),
}
_JUDGED = np.array([judged or None for judged in QUALITY], dtype=object)
"""Words of quality by number; None where there is no pose to judge."""


def kind_of(column: str) -> Kind:
    """What the values of a column are, in all tables that have it; numbers where nothing else is known."""
    return _KINDS.get(column, "number")


def as_text(columns: Sequence[str], rows: Iterable[Iterable[Any]]) -> Iterable[list[str]]:
    """Rows as text: times to the microsecond, numbers with nine significant digits, empty where unknown."""
    written = [_WRITTEN[kind_of(column)] for column in columns]
    for row in rows:
        yield [text(value) for text, value in zip(written, row, strict=True)]


def _number(value: float) -> str:
    return f"{value:.9g}" if value == value else ""  # noqa: PLR0124  NaN alone differs from itself


def _time(value: float) -> str:
    return f"{value:.6f}" if value == value else ""  # noqa: PLR0124


_WRITTEN: dict[Kind, Callable[[Any], str]] = {
    "time": _time,
    "text": lambda value: value or "",
    "flag": {False: "0", True: "1"}.__getitem__,
    "count": str,
    "number": _number,
}


def slip_columns(slips: Slips, slipping: Bools, evidence: Floats, pads: tuple[str, ...]) -> dict[str, Any]:
    """The columns of `slips.csv`, each (scans * pads,): flags as bool, quality as text or None, NaN where
    unknown.
    """
    std = np.sqrt(np.diagonal(slips.covariance, axis1=2, axis2=3))
    vectors = [slips.displacement, slips.pose, slips.velocity, std]
    covariance = slips.covariance
    of_pads = [
        slips.contact,
        *(vector[..., axis] for vector in vectors for axis in range(3)),
        slipping,
        slips.border[..., 0],
        slips.border[..., 1],
        slips.lag_s,
        slips.load,
        covariance[..., 0, 1],
        covariance[..., 0, 2],
        covariance[..., 1, 2],
        _JUDGED[slips.quality],
        evidence,
    ]
    times, names = np.repeat(slips.t_s, len(pads)), np.tile(np.array(pads), len(slips))
    return dict(zip(SLIPS, [times, names, *(column.reshape(-1) for column in of_pads)], strict=True))


def slip_rows(slips: Slips, slipping: Bools, evidence: Floats, pads: tuple[str, ...]) -> Iterable[tuple[Any, ...]]:
    """Rows of `SLIPS`, scan by scan and pad by pad, see `slip_columns`."""
    return zip(*(column.tolist() for column in slip_columns(slips, slipping, evidence, pads).values()), strict=True)


def motion_rows(motions: Motions) -> Iterable[list[float]]:
    """Rows of `OBJECT` as numbers; the number of pads is whole."""
    known, doubt = np.empty((len(motions), 9)), np.empty((len(motions), 9))
    known[:, :3], known[:, 3], known[:, 4:6] = motions.velocity, motions.rotor, motions.centre
    known[:, 6:] = motions.pose
    np.sqrt(motions.velocity_covariance.diagonal(axis1=1, axis2=2), out=doubt[:, :3])
    doubt[:, 3], doubt[:, 4:6] = motions.rotor_std, motions.centre_std
    np.sqrt(motions.pose_covariance.diagonal(axis1=1, axis2=2), out=doubt[:, 6:])
    for t, values, pads, std in zip(
        motions.t_s.tolist(), known.tolist(), motions.pads.tolist(), doubt.tolist(), strict=True
    ):
        yield [t, *values, pads, *std]


def event_rows(events: list[Event]) -> Iterable[list[Any]]:
    """Rows of `EVENTS`: NaN where unknown, None where no pose is judged."""
    for event in events:
        yield [getattr(event, name) or None if name == "quality" else getattr(event, name) for name in EVENTS]


def contact_rows(contacts: Contacts, pads: tuple[str, ...]) -> Iterable[list[Any]]:
    """Rows of `CONTACTS`, of pads in contact only; NaN where unknown."""
    scan, pad = np.nonzero(contacts.contact)
    single = [contacts.eccentricity, contacts.orientation, contacts.force_std, contacts.orientation_std]
    size = np.stack([contacts.force, contacts.area, contacts.peak], axis=2)
    numbers = np.concatenate([size, contacts.centroid, contacts.axes, np.stack(single, axis=2)], axis=2)[scan, pad]
    for t, number, values in zip(contacts.t_s[scan].tolist(), pad.tolist(), numbers.tolist(), strict=True):
        yield [t, pads[number], *values]
