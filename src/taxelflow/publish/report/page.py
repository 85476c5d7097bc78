"""The page of a report, from its content."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import msgspec

from taxelflow.errors import ExtraMissing
from taxelflow.runtime.whole_file import whole_file

if TYPE_CHECKING:
    from pathlib import Path

Row = list[str]


@dataclass(frozen=True)
class Sheet:
    """A table: heading, rows of words, and per row whether it is marked."""

    heading: Row
    rows: list[Row]
    marked: list[bool] = field(default_factory=list)


@dataclass(frozen=True)
class Section:
    """One recording. charts: what the page's script draws. health, pads, events, parameters: tables. notes: remarks."""

    title: str
    about: str
    charts: dict[str, Any]
    pads: Sheet
    health: Sheet
    events: Sheet
    parameters: Sheet
    notes: list[str]
    findings: list[str]
    events_left_out: int


@dataclass(frozen=True)
class Report:
    """Everything on the page. overview: a row per result."""

    title: str
    made_by: str
    overview: Sheet
    sections: list[Section]


def render(report: Report) -> str:
    """HTML in one piece: style, script and numbers stand within it. Raises ExtraMissing without jinja2."""
    try:
        import jinja2
    except ImportError as error:
        raise ExtraMissing("report", "jinja2") from error
    own = files("taxelflow.publish.report")
    parts = {name: own.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", "page.js", "uplot.min.js")}
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    page = environment.from_string(own.joinpath("page.html.j2").read_text(encoding="utf-8"))
    numbers = msgspec.json.encode([section.charts for section in report.sections]).decode()
    return page.render(
        report=report,
        css=parts["page.css"],
        script=parts["page.js"],
        uplot=parts["uplot.min.js"],
        numbers=numbers.replace("<", "\\u003c"),  # no name can end the script
    )


def write_report(report: Report, path: Path) -> int:
    """Write the page, whole or not at all; return its size in bytes. Raises ExtraMissing."""
    content = render(report).encode()
    with whole_file(path) as part:
        part.write_bytes(content)
    return len(content)
