"""The command `design`; NumPy is imported when it runs, so that help is fast."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import write_tables
from taxelflow.evaluation.commands import check_csv, name_files


@dataclass(frozen=True)
class Design:
    """Sweep a skin's design: errors of translation and turn by taxel pitch, layout, noise, object size and shape.

    Options of the sweep follow: taxelflow design --help-sweep lists them.
    """

    plot: Path | None = None
    """Draw the sweep: a .svg, .png or .pdf file."""
    json: bool = False
    """Print JSON instead of a table."""
    csv: Path | None = None
    """Write the rows to this .csv file too."""

    def __post_init__(self) -> None:
        check_csv(self.csv)
        if self.plot is not None and self.plot.suffix not in (".svg", ".png", ".pdf"):
            raise ParameterInvalid("plot", str(self.plot), "end in .svg, .png or .pdf")

    def run(self, rest: list[str]) -> int:
        """Sweep, print, draw."""
        from taxelflow.evaluation.design import Design as Sweep
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import counted

        words = ["--help"] if rest == ["--help-sweep"] else rest
        sweep = tyro.cli(Sweep, args=words, prog="taxelflow design")
        report = sweep.run(counted)
        written = [] if self.csv is None else write_tables(report.tables(), self.csv)
        if self.plot is not None:
            from taxelflow.evaluation.design_plot import draw_design

            written.append(draw_design(report.rows, self.plot))
        if self.json:
            sys.stdout.buffer.write(to_json(report))
            return 0
        report.show()
        name_files(written)
        return 0
