"""The commands whose work is done in this folder: calibrate, info, plot, figures, score, bench.

A dataclass per command, whose fields are its options. NumPy is imported when a command runs, so that help is fast.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, make_dataclass
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional

from taxelflow.acquire.options import Recorded
from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import ParameterInvalid
from taxelflow.evaluation.base import write_tables
from taxelflow.runtime import registry
from taxelflow.runtime.checks import at_least
from taxelflow.runtime.command_line import parsed
from taxelflow.runtime.complaint import as_far_as_read
from taxelflow.runtime.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from taxelflow.evaluation.base import Score as AnyScore
    from taxelflow.evaluation.base import Table


@dataclass(frozen=True, kw_only=True)
class Calibrate(Recorded):
    """Fit a method's gains per pad and axis, the paper's mm factor, from a known trajectory of the object.

    Frames and time offset between robot and sensor are fitted too. Contacts cut by a pad's border count less.
    """

    out: Path
    """TOML file to write, for `taxelflow estimate --calibration`."""
    truth: Path | None = None
    """Trajectory of the contact's centre in the robot's frame (seen from outside the skin) and on its clock: a csv
    t_s,x_m,y_m[,theta_rad], a TUM file (.tum, .txt), or a bag or .mcap with PoseStamped messages. If left out, the
    truth inside a simulated recording."""
    truth_topic: str | None = None
    """Topic of the PoseStamped messages, where --truth is a bag with several."""
    method: str = "convolution"
    """Estimator to calibrate: lnorm, convolution, or one of another package that can be calibrated."""
    pad: str | None = None
    """Pad to calibrate; all that can be calibrated if left out."""
    search_s: float = 1.0
    """Largest clock offset to search, s; 0: the clocks of robot and sensor agree."""
    edge: float = 1.0
    """Weight of the error at a pad's border, a ratio; at 0 contacts that the border cuts count as much as whole
    ones."""
    within_m: float | None = None
    """Largest distance of a position from the pad's centre along each axis, m; others are not used."""

    def run(self, _rest: list[str]) -> int:
        """Read, fit, write, print."""
        from taxelflow.acquire.trajectory import read_trajectory
        from taxelflow.evaluation.calibrate import calibrate
        from taxelflow.pipeline import api
        from taxelflow.publish.terminal import show_calibration
        from taxelflow.sensors.calibration import save_calibration

        if self.out.suffix != ".toml":
            raise ParameterInvalid("out", str(self.out), "end in .toml")
        if self.truth is None and self.truth_topic is not None:
            raise ParameterInvalid("truth_topic", self.truth_topic, "be left out without --truth")
        recording = api.opened(self)
        truth = None if self.truth is None else read_trajectory(self.truth, self.truth_topic)
        found = calibrate(
            recording,
            truth,
            self.method,
            pad=self.pad,
            search_s=self.search_s,
            edge=self.edge,
            within_m=self.within_m,
        )
        save_calibration(found, self.out)
        show_calibration(found, self.out)
        return 0


@dataclass(frozen=True, kw_only=True)
class Info(Recorded):
    """Check a sensor by a recording: rate, gaps, repeated scans; noise, drift, load and bad taxels of each pad.

    Faulty taxels are listed with the evidence; `taxelflow estimate --condition.mask auto` leaves them out.
    """

    json: bool = False
    """Print JSON instead of tables."""
    condition: Conditioner = field(default_factory=Conditioner)

    def run(self, _rest: list[str]) -> int:
        """Read once, count, print."""
        from taxelflow.evaluation.checkup import check_up
        from taxelflow.evaluation.checkup_table import show_checkup
        from taxelflow.pipeline import api
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import progress

        recording = api.opened(self)
        checkup = check_up(recording, lambda blocks: progress(blocks, recording.scans, "reading"), self.condition)
        with as_far_as_read():
            if self.json:
                sys.stdout.buffer.write(to_json(checkup))
            else:
                show_checkup(checkup)
        for note in (*checkup.notes, *([checkup.loss] if checkup.loss else [])):
            print(f"taxelflow: {note}", file=sys.stderr)
        return ExitCode.PARTLY_DONE if checkup.loss else 0


@dataclass(frozen=True)
class Plot:
    """Draw results: position against time, path over the pads, and one scan in the paper's three views."""

    results: Annotated[
        Positional[tuple[Path, ...]], tyro.conf.arg(metavar="RESULT", help_behavior_hint="(one or more)")
    ]
    """Directories that `taxelflow estimate --out` wrote, of one recording; several methods are drawn together. Of a
    hand, the four pads with the longest contacts are drawn."""
    out: Path | None = None
    """Directory for the pictures; the first result's if left out."""
    format: Literal["svg", "png", "pdf"] = "svg"
    """File format of the pictures."""

    def run(self, _rest: list[str]) -> int:
        """Draw and name the files."""
        from taxelflow.evaluation.plot import plot_results
        from taxelflow.publish.figures import remove_older
        from taxelflow.publish.results import read_summary

        if not self.results:
            raise ParameterInvalid("results", "nothing", "name at least one directory")
        out, summary = self.out or self.results[0], read_summary(self.results[0])
        made = plot_results(self.results, out, self.format)
        for path in made:
            print(path)
        if self.out is None:
            remove_older(out, made, summary.layout.layout.pads, registry.names("estimator"))
        source = summary.input
        if not Path(source).exists():
            print(f"taxelflow: recording {source} not found: truth and pictures of scans are left out", file=sys.stderr)
        return 0


@dataclass(frozen=True)
class Figures:
    """Draw the paper's figures 2, 4, 5, 6, 7, 9 and Table I, rotation error by slip vectors, error over the bound."""

    out: Path
    """Directory for the pictures; created if it does not exist."""
    format: Literal["svg", "png", "pdf"] = "svg"
    """File format of the pictures."""
    strokes: int = 1000
    """Number of strokes at each speed in Table I."""
    seeds: int = 10
    """Number of seeds per scenario in the curves of rotation error and of error against the bound."""

    def run(self, _rest: list[str]) -> int:
        """Simulate, estimate, draw."""
        from taxelflow.evaluation.paper import draw_paper
        from taxelflow.publish.terminal import counted

        at_least("strokes", self.strokes, 2)
        at_least("seeds", self.seeds, 1)
        for path in draw_paper(self.out, self.format, strokes=self.strokes, seeds=self.seeds, watched=counted):
            print(path)
        return 0


@dataclass(frozen=True)
class Output:
    """What is done with a report."""

    json: bool = False
    """Print JSON instead of tables."""
    csv: Path | None = None
    """Write the rows to this .csv file, too; further tables go to NAME-TABLE.csv beside NAME.csv."""

    def __post_init__(self) -> None:
        if self.csv is not None and self.csv.suffix != ".csv":
            raise ParameterInvalid("csv", str(self.csv), "end in .csv")
        check_directory("csv", self.csv)

    def give(
        self,
        report: Any,
        show: Callable[[], object],
        *,
        tables: Callable[[], Sequence[Table]] | None = None,
        drawn: Sequence[Path] = (),
    ) -> int:
        """Write and print a report; the exit code. show: prints its tables.

        tables: those for CSV, if they are not the report's own. drawn: files with pictures of it.
        """
        from taxelflow.publish.summary import to_json

        written = [] if self.csv is None else write_tables((tables or report.tables)(), self.csv)
        if self.json:
            sys.stdout.buffer.write(to_json(report))
        else:
            show()
            for path in (*written, *drawn):
                print(f"{'rows' if path.suffix == '.csv' else 'drawn'} in {path}")
        return 0


@dataclass(frozen=True)
class Bench(Output):
    """Measure speed: kernels against the literal equations, where the time goes, start of the command line."""

    recording: Path | None = None
    """Recording to measure reading and estimating on; a simulated one if left out."""

    def run(self, _rest: list[str]) -> int:
        """Run and print."""
        from taxelflow.evaluation.bench import bench
        from taxelflow.evaluation.bench_table import show_bench
        from taxelflow.publish.terminal import counted

        found = bench(self.recording, counted)
        return self.give(found, lambda: show_bench(found))


@dataclass(frozen=True)
class Score:
    """Measure accuracy and slip events: against truth on the simulated rig, or on recordings without truth.

    Each score has options of its own: taxelflow score NAME --help.
    """

    def run(self, rest: list[str]) -> int:
        """Run the score that the first of the words names, with the others as its options; list all without a name.

        Raises NameUnknown, PluginBroken, and what the score raises.
        """
        if not rest or rest[0].startswith("-"):
            return _list_scores(rest)

        from taxelflow.publish.terminal import counted

        score, output = _parsed(registry.find("score", rest[0]), rest)
        report = score.run(counted)
        if not hasattr(report, "show"):
            error = TypeError(f"it gives a {type(report).__name__}, not a report with show")
            raise registry.broken("score", rest[0], error)
        return output.give(report, report.show)


@dataclass(frozen=True)
class _Unloaded:
    """Stands for a score whose module is not imported, in the list of scores."""


def _list_scores(words: list[str]) -> int:
    """Print the list of scores, or that a name is missing, and exit; modules of scores are not imported."""
    names = registry.names("score")
    listed = tyro.extras.subcommand_type_from_defaults(
        dict.fromkeys(names, _Unloaded()),
        descriptions={name: registry.summary("score", name) for name in names},
        prefix_names=False,
    )
    parsed(listed, words, "taxelflow score", description=cleandoc(Score.__doc__ or ""))
    return 0


def _parsed(kind: Any, words: list[str]) -> tuple[AnyScore, Output]:
    """The score of this kind, and what to do with its report, from the words of the command line."""
    asked: Any = make_dataclass("Asked", [("score", kind), ("output", Output)])
    found = parsed(
        asked,
        words[1:],
        f"taxelflow score {words[0]}",
        description=registry.summary("score", words[0]),
        config=(tyro.conf.OmitArgPrefixes,),
    )
    return found.score, found.output


def check_directory(option: str, path: Path | None) -> None:
    """Raises ParameterInvalid for a file, asked for by an option, that has no directory to lie in."""
    if path is not None and not path.parent.is_dir():
        raise ParameterInvalid(option, str(path), "lie in a directory that exists")
