"""What msgspec finds in a sensor's mapping, in the terms of TOML: table, field, what was seen, what is allowed."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from msgspec import inspect

from taxelflow.errors import SensorFileInvalid, nearest

if TYPE_CHECKING:
    from collections.abc import Iterable

SCHEMA = (
    "a sensor has name, unit (Pa, kPa, MPa, psi, N/cm2, N or count) and [[pads]] with name and either rows, cols, "
    "pitch_m = [x, y] or taxels = a table"
)
ROWS = "give all rows as [x, y], or all as [x, y, z, nx, ny, nz], in m"
_LONGEST = 40
"""Characters of a value at most that a message quotes."""
_STEP = re.compile(r"\.(\w+)|\[(\d+)\]")
_QUOTED = re.compile(r"`(.+)`")
_EXPECTED = re.compile(r"Expected `(?P<kinds>[^`]+)`(?P<limit>.*?)(, got (`(?P<kind>\w+)`|(?P<length>\d+)))?")
_KINDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "a boolean",
    "array": "a list",
    "object": "a table",
}
"""Words for msgspec's types; others, such as dates, keep their names."""
_LIMITS = {
    "length >=": "length at least",
    "length <=": "length at most",
    ">=": "of at least",
    "<=": "of at most",
    ">": "above",
    "<": "below",
}
_REQUIRED = re.compile(r"(\.pads)?(\[\d+\])?(\.(rows|cols|pitch_m)(\[\d+\])?)?")
"""Paths at which the message states what a sensor needs."""


def schema_error(source: str, message: str, mapping: object, kind: type) -> SensorFileInvalid:
    """The error of msgspec's message `... - at `$.pads[0].rows``. mapping: what was converted to kind."""
    what, _, path = message.partition(" - at `$")
    path = path.rstrip("`")
    known = _kinds_at(inspect.type_info(kind), path)
    if "unknown field" in what:
        name, names = _quoted(what), _fields(known)
        seen, remedy = f"unknown field {name!r}", f"{nearest(name, names)}known are {', '.join(names)}"
    elif what.startswith("Invalid enum value"):
        value, values = _value_at(mapping, path), _values(known)
        near = nearest(value, [one for one in values if isinstance(one, str)]) if isinstance(value, str) else ""
        seen, remedy = f"unknown value {_short(value)}", f"{near}known are {', '.join(map(repr, values))}"
        if path == ".unit":
            remedy += "; use count for volts and all other numbers without a known pressure"
    elif "missing required field" in what:
        seen, remedy = f"field {_quoted(what)} is missing", _remedy(path, known)
    else:
        seen, remedy = _plain(what, _value_at(mapping, path)), _remedy(path, known)
    return SensorFileInvalid(source, _where(path), seen, remedy)


def _where(path: str) -> str:
    """Table and field of a path such as `.pads[0].rows`."""
    table = re.match(r"\.(?:(pads|groups)\[(\d+)\]|(hand|frame)\b)", path)
    field = path[table.end() if table else 0 :].lstrip(".")
    where = "top level"
    if table:
        where = f"table [{table[3]}]" if table[3] else f"table [[{table[1]}]] number {int(table[2]) + 1}"
    return where + (f", field {field}" if field else "")


def _remedy(path: str, known: list[inspect.Type]) -> str:
    """What is allowed at a path. known: types of the value there."""
    if _REQUIRED.fullmatch(path):
        return SCHEMA
    if re.match(r"\.pads\[\d+\]\.taxels\b", path):
        return ROWS
    if values := _values(known):
        return f"known are {', '.join(map(repr, values))}"
    return f"its fields are {', '.join(_fields(known))}" if _fields(known) else "give such a value"


def _plain(what: str, value: object) -> str:
    """Types and limits in words: "Expected `array | null`, got `float`" becomes "expected a list, got a number"."""
    found = _EXPECTED.fullmatch(what)
    if found is None:
        return what[:1].lower() + what[1:]
    kinds = " or ".join(_KINDS.get(one, one) for one in found["kinds"].split(" | ") if one != "null")
    if "matching regex" in found["limit"]:  # of a frame's header, and of names, see `pads.Name`
        wanted = "text in one line without comma and quotation mark"
        if "A-F" in found["limit"]:
            wanted = "1 to 8 bytes, each as two hexadecimal digits, such as 'AA55'"
        return f"expected {wanted}, got {_short(value)}"
    limit = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.15g}", found["limit"])
    for sign, words in _LIMITS.items():
        limit = limit.replace(f" {sign} ", f" {words} ")
    got = f"length {found['length']}" if found["length"] else _short(value)
    if found["kind"]:
        got = _KINDS.get(found["kind"], found["kind"]) + ("" if isinstance(value, list | dict) else f" ({got})")
    return f"expected {kinds}{limit}, got {got}"


def _kinds_at(kind: inspect.Type, path: str) -> list[inspect.Type]:
    """Types that a value at a path may have."""
    kinds = [kind]
    for name, number in _STEP.findall(path):
        inside = [one for outer in kinds for one in _inside(outer, name, number)]
        kinds = [one for outer in inside for one in (outer.types if isinstance(outer, inspect.UnionType) else [outer])]
    return kinds


def _inside(kind: inspect.Type, name: str, number: str) -> list[inspect.Type]:
    """The type of a table's field, or of a list's item."""
    if isinstance(kind, inspect.StructType):
        return [field.type for field in kind.fields if field.encode_name == name]
    if isinstance(kind, inspect.VarTupleType):
        return [kind.item_type]
    return [kind.item_types[int(number)]] if isinstance(kind, inspect.TupleType) else []


def _fields(kinds: Iterable[inspect.Type]) -> list[str]:
    return [field.encode_name for one in kinds if isinstance(one, inspect.StructType) for field in one.fields]


def _values(kinds: Iterable[inspect.Type]) -> list[object]:
    return [value for one in kinds if isinstance(one, inspect.LiteralType) for value in one.values]


def _value_at(mapping: Any, path: str) -> object:
    for name, number in _STEP.findall(path):
        mapping = mapping[name or int(number)]
    return mapping


def _quoted(what: str) -> str:
    found = _QUOTED.search(what)
    return found[1] if found else ""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."
