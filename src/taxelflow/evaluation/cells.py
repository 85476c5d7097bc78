"""Names and numbers as they appear in the terminal tables of several scores."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

_SHORT = {"lnorm": "L norm", "convolution": "flow", "principal_axis": "axis"}


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


def solved_by(solver: str) -> str:
    """The end of a title that names the contact solver; nothing for the usual one."""
    return "" if solver == "analytic" else f", {solver} solver"


def caption(console: Console, text: str) -> None:
    """Print what the columns of a table mean."""
    console.print(text, style="dim", highlight=False)
