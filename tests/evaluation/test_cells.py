from __future__ import annotations

from typing import NamedTuple

from rich.console import Console

from taxelflow.evaluation.cells import shown


class Row(NamedTuple):
    speed: int
    error: float | None


def printed(rows: list[Row]) -> list[str]:
    table = shown(
        rows, ("mm/s", "speed"), ("mm", "error", 2), ("twice", lambda row: f"{2 * row.speed}"), section="speed"
    )
    console = Console(width=60)
    with console.capture() as captured:
        console.print(table)
    return [line.strip() for line in captured.get().splitlines()]


def test_a_cell_is_a_field_a_number_with_decimals_or_made_from_the_row() -> None:
    heading, _, first, *_ = printed([Row(25, 0.126)])
    assert heading.split() == ["mm/s", "mm", "twice"]
    assert first.split() == ["25", "0.13", "50"]


def test_an_unknown_number_is_a_dash_and_a_table_may_be_empty() -> None:
    assert printed([Row(25, None)])[2].split() == ["25", "-", "50"]
    assert printed([])[0].split() == ["mm/s", "mm", "twice"]


def test_a_line_follows_each_section() -> None:
    lines = printed([Row(25, 1.0), Row(25, 2.0), Row(50, 3.0)])
    assert [line[:2] for line in lines[2:]] == ["25", "25", "", "50"]
