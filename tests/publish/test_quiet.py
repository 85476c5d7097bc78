from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from taxelflow.publish.quiet import quiet_table

NUMBERS = [f"{10**power / 7:.4f}" for power in range(8)]


def printed(width: int, *, note: str = "", title: str | None = None) -> tuple[list[str], Console]:
    """Lines of a table of numbers and a note in a console of that width."""
    console = Console(file=StringIO(), width=width)
    table = quiet_table("pad:", *(f"number {k}" for k in range(len(NUMBERS))), "note:", title=title)
    table.add_row("finger1_proximal", *NUMBERS, note)
    console.print(table)
    file = console.file
    assert isinstance(file, StringIO)
    return file.getvalue().splitlines(), console


@pytest.mark.parametrize("width", [1, 20, 80, 200])
def test_no_number_is_cut(width: int) -> None:
    lines, _ = printed(width)
    assert "…" not in "".join(lines)
    assert lines[-1].split() == ["finger1_proximal", *NUMBERS]


def test_texts_are_wrapped_before_the_table_is_wider_than_the_console() -> None:
    note = "a note of several words " * 4
    lines, console = printed(140, note=note)
    assert console.width == 140
    assert max(map(len, lines)) <= 140
    words = " ".join(lines).split()
    assert [words.count(word) for word in ("several", "words", *NUMBERS)] == [4, 4, *[1] * len(NUMBERS)]


def test_a_long_word_of_a_text_is_folded() -> None:
    word = "https://example.org/" + "a" * 60
    lines, console = printed(140, note=word)
    assert console.width == 140
    assert "".join(line.split()[-1] for line in lines[2:]) == word


def test_a_console_that_is_wide_enough_keeps_its_own_width() -> None:
    _, console = printed(200, title="a title of [brackets]")
    assert console._width == 200  # a terminal's would be None: it follows the window
    lines, console = printed(40, title="a title of [brackets]")
    assert console.width == len(lines[-1])
