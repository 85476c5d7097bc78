"""Names from files: safe to show in a terminal and to open as a table in a spreadsheet.

A name with control characters can rewrite a terminal, and a spreadsheet runs a field that begins with `= + - @` as a
formula. A sensor file with such a name is refused; in a recording the name is escaped, since nobody can edit it there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from taxelflow.errors import SensorFileInvalid, printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.sensors.pads import Group, Pad

_FORMULA = ("=", "+", "-", "@")
_REMEDY = "use printable characters, and begin with none of = + - @"


def safe_name(name: str) -> str:
    """The name with control characters as escapes, and an apostrophe before what would begin a formula."""
    shown = printable(name)
    return f"'{shown}" if shown.startswith(_FORMULA) else shown


def with_safe_names(table: object) -> object:
    """A sensor's mapping in JSON, of any shape, with its names and notes escaped."""
    if not isinstance(table, dict):
        return table
    safe = _escaped(table)
    for field in ("pads", "groups"):
        if isinstance(safe.get(field), list):
            safe[field] = [_escaped(item) if isinstance(item, dict) else item for item in safe[field]]
    return safe


def _escaped(item: dict[str, Any]) -> dict[str, Any]:
    safe = {
        key: safe_name(value) if key in ("name", "pad") and isinstance(value, str) else value
        for key, value in item.items()
    }
    if isinstance(safe.get("note"), str):
        safe["note"] = printable(safe["note"])
    if isinstance(safe.get("patches"), list):
        safe["patches"] = [_escaped(patch) if isinstance(patch, dict) else patch for patch in safe["patches"]]
    return safe


def check_names(name: str, note: str, pads: Sequence[Pad], groups: Sequence[Group], source: str) -> None:
    """Raises SensorFileInvalid for the first name that is not safe, and for a note with control characters."""
    of_pads = [(f"table [[pads]] number {number}", pad.name, pad.note) for number, pad in enumerate(pads, 1)]
    of_groups = [(f"table [[groups]] number {number}", one.name, "") for number, one in enumerate(groups, 1)]
    for where, seen_name, seen_note in [("top level", name, note), *of_pads, *of_groups]:
        if not seen_name.isprintable():
            seen = f"{seen_name!r} holds a control character"
            raise SensorFileInvalid(source, f"{where}, field name", seen, _REMEDY)
        if seen_name.startswith(_FORMULA):
            seen = f"{seen_name!r} begins with {seen_name[0]!r}, as a spreadsheet's formula does"
            raise SensorFileInvalid(source, f"{where}, field name", seen, _REMEDY)
        if not seen_note.replace("\n", "").replace("\t", "").isprintable():
            seen = f"{seen_note[:80]!r} holds a control character"
            raise SensorFileInvalid(source, f"{where}, field note", seen, "use printable characters")
