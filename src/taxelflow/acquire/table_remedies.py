"""What to do about a table that does not fit `Columns`, in words for its error."""

from __future__ import annotations

import re
from collections.abc import Sequence

REMEDY = (
    "a recording has a header row `t_s,...` and then one row per scan: time in s, a number per taxel; "
    "for other shapes see --columns in --help"
)
"""For a file that is not such a table."""

_SEPARATORS = {",": "','", ";": "';'", "\t": "tab", "|": "'|'", " ": "space"}
"""Separators of fields that a header of one field suggests, as `--columns.delimiter` takes them."""
SHOWN = 60
"""Characters of a header, name or field that a message shows."""
_UNNAMED = r"Unnamed: \d+|__index_level_\d+__"
"""Names that pandas gives to columns without one."""
_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|nan"
_TIME = r"(?i)t|.*(time|stamp|date).*|(t|sec|seconds)([ _.(\[]*(?P<unit>s|ms|us|ns|secs?|seconds)[)\]]?)?"
"""Names of columns that likely hold the time."""


def for_time(names: Sequence[str], *, header: bool) -> str:
    """Where no column is named as the one with the time. header: whether the names are those of the first row."""
    first = names[0] if names else ""
    if not header:
        return "give the number of the time's column, such as --columns.time 0, or the rate with --columns.rate-hz"
    if re.search(r"[\x00-\x08\x0e-\x1f]", first):
        return "it is no text in UTF-8: unpack it (gunzip) or convert it (iconv -f UTF-16 -t UTF-8)"
    if first.startswith("#"):
        return "pass over lines of comments with --columns.skip N, or name the time with --columns.time"
    if len(names) == 1 and (remedy := for_separator(first)):
        return remedy
    if len(names) > 1 and all(re.fullmatch(_NUMBER, name.strip()) for name in names):
        return "where it has no header, add --columns.no-header and the time's column, such as --columns.time 0"
    return _by_name(names)


def for_separator(row: str) -> str:
    """Where a row has one field: the separator that it suggests; empty if it has none."""
    found = next((one for one in _SEPARATORS if one in row), None)
    return "" if found is None else f"set --columns.delimiter {_SEPARATORS[found]}"


def _by_name(names: Sequence[str]) -> str:
    likely = next((name for name in names if re.fullmatch(_TIME, name)), None)
    if likely is None:
        return REMEDY
    unit = re.search(r"(?<![a-z])(ms|us|ns)(?![a-z])", likely)
    return f"name the time with --columns.time {likely!r}" + (f" --columns.time-unit {unit[1]}" if unit else "")


def for_field(field: str, *, timed: bool) -> str:
    """Where a field is no number. timed: it should be a time."""
    if re.fullmatch(r"[+-]?[\d.]*,[\d.,]*([eE][+-]?\d+)?", field.strip()):
        return "write numbers with a decimal point and no other mark"
    if timed:
        return "give times as numbers, or as ISO 8601 dates such as 2024-05-01T12:34:05.250"
    return "leave the field of a missing reading empty; leave out columns that are no taxels with --columns.taxels"


def fewer_taxels(names: Sequence[str], chosen: Sequence[int], wanted: int) -> str:
    """What to do about more columns than taxels: such as an index of pandas, or what a trailing comma makes."""
    if len(chosen) <= wanted:
        return ""
    alike: dict[str, list[int]] = {}
    for number in chosen:
        alike.setdefault(re.sub(r"\d+", "#", names[number]), []).append(number)
    kinds = [list(kind) for kind in alike.values()]
    kinds.append([n for n in chosen if names[n].strip() and not re.fullmatch(_UNNAMED, names[n])])
    fits = next((kind for kind in kinds if len(kind) == wanted and kind[-1] - kind[0] == wanted - 1), None)
    if fits is None:
        return "leave out columns that are no taxels with --columns.taxels"
    left = ", ".join(repr(names[n]) for n in chosen if n not in fits)[:SHOWN]
    return f"leave out {left} with --columns.taxels {fits[0]}-{fits[-1]}"
