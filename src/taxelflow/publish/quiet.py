"""Tables in a terminal: one style for all, and no word or number cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rich.box import SIMPLE_HEAD
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult


@dataclass(frozen=True, slots=True)
class _Text:
    """Width of what is printed, in characters."""

    line: int = 1_000_000
    """Characters of a line at most: more than any table has."""
    word: int = 24
    """Characters of a word in a column of text that are kept together."""


_TEXT = _Text()


class _Whole(Table):
    """A table whose words and numbers are never cut: a terminal that is too narrow for them wraps its lines instead.

    Rich alone would shorten the widest columns, whatever their content.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        wide = options.update(max_width=_TEXT.line)
        excess = Measurement.get(console, wide, self).maximum - options.max_width
        if excess > 0:
            excess = self._narrow(console, wide, excess)
        needed = options.max_width + max(excess, 0)
        if excess > 0:  # what is beyond the console's width is cropped; once it is set, it follows no resizing
            console.width = max(console.width, needed)
        yield from super().__rich_console__(console, options.update(max_width=needed))

    def _narrow(self, console: Console, options: ConsoleOptions, excess: int) -> int:
        """Narrow the widest columns by an excess of characters, none below its longest number or word (of text:
        `_TEXT.word`); the excess that is left.
        """
        widths, least = [], []
        for column in self.columns:
            spans = [Measurement.get(console, options, cell) for cell in (column.header, *column.cells)]
            widths.append(max(span.maximum for span in spans))
            word = max(span.minimum for span in spans)
            least.append(widths[-1] if column.no_wrap else min(word, _TEXT.word) if column.justify == "left" else word)
        while excess and widths != least:
            widest = max((width, number) for number, width in enumerate(widths) if width > least[number])[1]
            widths[widest] -= 1
            excess -= 1
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        return excess


def quiet_table(*headings: str, title: str | None = None, caption: str | None = None) -> Table:
    """A table with few lines. A column is aligned left if its heading ends in a colon, else right, for numbers."""
    # Names come from files: in cells and titles they are Text, in which brackets are brackets.
    table = _Whole(
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
        title=Text(title) if title else None,
        title_justify="left",
        caption=caption,
        caption_justify="left",
    )
    for number, heading in enumerate(headings):
        left = heading.endswith(":")
        justify: Literal["left", "right"] = "left" if left else "right"
        table.add_column(Text(heading.rstrip(":")), justify=justify, no_wrap=left and not number, overflow="fold")
    return table
