"""The look of all tables in a terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text


def quiet_table(*headings: str, title: str | None = None, caption: str | None = None) -> Table:
    """A quiet table; headings that end in a colon stand left, numbers right."""
    # Names come from files: in cells and titles they are Text, in which brackets are brackets.
    table = Table(
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
        table.add_column(Text(heading.rstrip(":")), justify="left" if left else "right", no_wrap=left and not number)
    return table
