"""Names and numbers as they appear in the terminal tables of several scores."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from taxelflow.publish.quiet import quiet_table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_SHORT = {"lnorm": "L norm", "convolution": "flow", "principal_axis": "axis"}


Column = tuple[str, str] | tuple[str, str, int] | tuple[str, Callable[[Any], str]]
"""Heading and field of a row, a number with that many decimals; or heading and what makes a cell of a row."""


def shown(rows: Iterable[Any], *columns: Column, title: str | None = None, section: str | None = None) -> Table:
    """Rows as a table for the terminal, a dash where a number is unknown. section: a line follows where it changes."""
    table, held = quiet_table(*(column[0] for column in columns), title=title), list(rows)
    for row, after in zip_longest(held, held[1:]):
        ends = section is not None and (after is None or getattr(after, section) != getattr(row, section))
        table.add_row(*(_cell(row, *column[1:]) for column in columns), end_section=ends)
    return table


def _cell(row: Any, field: str | Callable[[Any], str], digits: int | None = None) -> str:
    if not isinstance(field, str):
        return field(row)
    value = getattr(row, field)
    return str(value) if digits is None else number(value, digits)


def short(method: str) -> str:
    """A method's name in a narrow column."""
    return _SHORT.get(method, method)


def number(value: float | None, digits: int) -> str:
    """A number with that many decimals; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(share: float | None, digits: int = 0) -> str:
    """A share in percent with that many decimals; a dash where there is none."""
    return number(None if share is None else 100 * share, digits)


def decimals(percent: float) -> int:
    """Decimals of an error in percent: one more below 1 %."""
    return 3 if percent < 1 else 2


def seeds_from(first: int, count: int) -> str:
    """The seeds of a score: `seed 40`, or `3 seeds from 40`."""
    return f"seed {first}" if count == 1 else f"{count} seeds from {first}"


def solved_by(solver: str) -> str:
    """The end of a title that names the contact solver; nothing for the usual one."""
    return "" if solver == "analytic" else f", {solver} solver"


def caption(console: Console, text: str) -> None:
    """Print what the columns of a table mean, in at most 88 columns."""
    console.print(text, style="dim", highlight=False, width=min(console.width, 88))
