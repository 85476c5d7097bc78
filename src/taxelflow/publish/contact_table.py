"""The contacts of a summary as a table for people."""

from __future__ import annotations

from math import degrees
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from taxelflow.publish.summary import Summary


class ContactTable(NamedTuple):
    """Contacts for people: headings, those of columns of text with a colon at the end, rows of cells, and the number of
    contacts that are left out.
    """

    headings: list[str]
    rows: list[list[str]]
    hidden: int


def contact_table(summary: Summary, most: int = 20) -> ContactTable:
    """A row per contact of a pad, times from the first scan; groups lie on pads, and are not shown. most: contacts."""
    groups = {group.name for group in summary.layout.groups}
    contacts = [contact for contact in summary.contacts if contact.pad not in groups]
    turns = any(contact.turn_rad is not None for contact in contacts)
    headings = ["pad:", "begin\ns", "lasts\ns", "slips", "slip path\nmm", "slip speed\nmm/s", "net x, y\nmm"]
    headings.append("turn\ndeg" if turns else "at\nborder")  # both need more than 80 letters
    rows = []
    for contact in contacts[:most]:
        cells = [
            contact.pad,
            f"{contact.t_s - summary.t_first_s:.2f}",
            f"{contact.duration_s:.2f}",
            str(contact.slips),
            _measured(contact.path_m, contact.std_path_m),
            _measured(contact.speed_m_s, contact.std_speed_m_s),
            ", ".join("-" if m is None else f"{1e3 * m:z.1f}" for m in contact.net_m),
        ]
        turn = "-" if contact.turn_rad is None else f"{degrees(contact.turn_rad):z.1f}"
        rows.append([*cells, turn if turns else f"{100 * contact.border_share:.0f} %"])
    return ContactTable(headings, rows, max(len(contacts) - most, 0))


def _measured(value: float | None, std: float | None) -> str:
    """A length or speed in mm with its standard deviation; two decimals where that is below 0.1 mm."""
    if not value:
        return "-"
    if std is None:
        return f"{1e3 * value:.1f}"
    digits = 2 if std < 1e-4 else 1
    return f"{1e3 * value:.{digits}f}±{1e3 * std:.{digits}f}"
