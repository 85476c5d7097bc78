"""The command `design`; NumPy is imported when it runs, so that help is fast."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.commands import Output, check_directory


@dataclass(frozen=True)
class Design(Output):
    """Sweep a skin's design: errors of translation and turn by taxel pitch, layout, noise, object size and shape.

    Options of the sweep follow: taxelflow design --help-sweep lists them.
    """

    plot: Path | None = None
    """Draw the sweep: a .svg, .png or .pdf file."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plot is not None and self.plot.suffix not in (".svg", ".png", ".pdf"):
            raise ParameterInvalid("plot", str(self.plot), "end in .svg, .png or .pdf")
        check_directory("plot", self.plot)

    def run(self, rest: list[str]) -> int:
        """Sweep, print, draw."""
        from taxelflow.evaluation.design import Design as Sweep
        from taxelflow.publish.terminal import counted
        from taxelflow.runtime.command_line import parsed

        words = ["--help"] if rest == ["--help-sweep"] else rest
        sweep = parsed(Sweep, words, "taxelflow design", "--help-sweep")
        report = sweep.run(counted)
        drawn = []
        if self.plot is not None:
            from taxelflow.evaluation.design_plot import draw_design

            drawn.append(draw_design(report.rows, self.plot))
        return self.give(report, report.show, drawn=drawn)
