"""The command line: a dataclass per command, whose fields are its options. Thin: the work is done elsewhere.

Commands of the simulation and of the evaluation stand beside their work, in simulation/command.py and
evaluation/commands.py.
"""

from __future__ import annotations

import logging
import sys
import typing
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import docstring_parser
import tyro
from docstring_parser import DocstringStyle
from tyro.conf import Positional

from taxelflow import __version__
from taxelflow.acquire.options import Recorded
from taxelflow.errors import (
    NameUnknown,
    ParameterInvalid,
    RecordingsSeveral,
    written_at,
)
from taxelflow.evaluation.commands import Bench, Calibrate, Figures, Info, Plot, Score
from taxelflow.evaluation.control_command import Control
from taxelflow.evaluation.design_command import Design
from taxelflow.evaluation.media_commands import Film, Report, View
from taxelflow.pipeline.batch.command import Batch
from taxelflow.pipeline.batch.options import Estimating
from taxelflow.pipeline.live.command import Record, Run
from taxelflow.pipeline.live.emulators.command import Emulate
from taxelflow.runtime import registry
from taxelflow.runtime.command_line import parsed
from taxelflow.runtime.complaint import OUTPUT, as_far_as_read, complain
from taxelflow.runtime.exit_codes import ExitCode
from taxelflow.runtime.streams import settle_streams
from taxelflow.simulation.command import Simulate
from taxelflow.simulation.scenario import SCENARIOS

DESCRIPTION = """Touch-based motion sensing for robot hands: pressure scans in, object motion and slip out.

Version: taxelflow --version. Shell completion: taxelflow --tyro-print-completion bash (or zsh)."""


@dataclass(frozen=True, kw_only=True)
class Estimate(Recorded, Estimating):
    """Estimate motion and slip from a recording: slips.csv, object.csv, events.csv, contacts.csv, summary.json.

    Where the places of the pads in space are known (pose, or link and joint angles), object3d.csv, too.
    A method that learns the object's pressure pattern (template) writes patterns.npz, too.
    A method's own parameters follow as options, e.g. --gain 1.04 for lnorm and convolution.
    Exit code: 0; 1 if the recording is truncated and only a part could be read; 2 on bad input.
    """

    out: Path
    """Directory for the results; created if it does not exist."""
    json: bool = False
    """Print the summary as JSON instead of a table."""

    def run(self, rest: list[str]) -> int:
        """Read, estimate, write."""
        from taxelflow.pipeline import api
        from taxelflow.pipeline.run_summary import summarise
        from taxelflow.publish.summary import Totals, to_json
        from taxelflow.publish.tables import Tables
        from taxelflow.publish.terminal import note_on_stderr, print_summary, progress

        if further := [word for word in rest if not word.startswith("-") and Path(word).exists()]:
            raise RecordingsSeveral(str(self.recording), *further)
        pipeline = self.pipeline(rest, "estimate")
        recording = api.opened(self).with_contacts(self.contacts)
        totals = Totals(recording.layout)
        with Tables(self.out, recording.layout.pads) as tables:
            run = pipeline.start(recording)
            for output in progress(run, recording.scans, "estimating"):
                tables.write(
                    output.slips, output.slipping, output.motions, output.events, output.contacts, output.evidence
                )
                if output.spatial is not None:
                    tables.write_spatial(output.spatial)
                totals.add(output.slips, output.events)
            summary = summarise(self.method, pipeline, run, totals)
            tables.write_patterns(run.patterns)
            tables.write_summary(summary)
        if self.json:
            with as_far_as_read():
                sys.stdout.buffer.write(to_json(summary))
            note_on_stderr(summary)
        else:
            print_summary(summary, self.out)
        return ExitCode.PARTLY_DONE if summary.loss else 0


@dataclass(frozen=True, kw_only=True)
class Convert(Recorded):
    """Write a recording as .npz, .csv, .parquet or .mcap, exact; all but .csv keep sensor, mask and truth.

    --to lerobot writes a directory: a data set of one episode, in LeRobot's format v3.0 (extra `tables`).

    Exit code: 0; 1 if the recording is truncated and only a part could be written; 2 on bad input.
    """

    out: Annotated[Positional[Path], tyro.conf.arg(metavar="OUT")]
    """File to write; its suffix gives the format. With --to lerobot: a directory that is new or empty."""
    to: Literal["lerobot"] | None = None
    """Format that is not a file of its own."""
    method: str | None = None
    """Estimator whose velocities and slips go with the readings, with --to lerobot."""

    def run(self, _rest: list[str]) -> int:
        """Read, write, print."""
        from taxelflow.acquire.csv import left_out
        from taxelflow.pipeline import api
        from taxelflow.publish.terminal import progress

        if self.method is not None and self.to is None:
            raise ParameterInvalid("method", self.method, "be left out without --to lerobot: nothing is estimated")
        recording = api.opened(self)
        if self.to == "lerobot":
            from taxelflow.evaluation.episodes import recording_to_lerobot

            print(f"{recording_to_lerobot(recording, self.out, self.method)} scans in {self.out}")
            return 0
        reading = api.convert(recording, self.out, lambda blocks: progress(blocks, recording.scans, "converting"))
        with as_far_as_read():
            print(f"{reading.scans} scans of {recording.sensor.name} in {self.out}")
        if self.out.suffix.lower() == ".csv":
            print(f"taxelflow: {left_out(recording)}", file=sys.stderr)
        for note in (*reading.notes, *([reading.loss] if reading.loss else [])):
            print(f"taxelflow: {note}", file=sys.stderr)
        return ExitCode.PARTLY_DONE if reading.loss else 0


@dataclass(frozen=True)
class Sensors:
    """List the built-in sensors, or draw one."""

    name: Annotated[Positional[str | None], tyro.conf.arg(metavar="NAME")] = None
    """Name of a built-in sensor, a plain grid (grid:16x16@4mm) or a TOML file to draw."""
    plot: Path | None = None
    """Draw a picture: a .svg, .png or .pdf file, or a directory for NAME.svg. Without a name: all built-in sensors."""
    joints: str | None = None
    """Joint angles at which --plot draws the hand in space, such as `spread=60deg f1=1.2`, or a named pose of it."""

    def run(self, _rest: list[str]) -> int:
        """Print a table or a drawing, or write pictures."""
        from taxelflow.publish.drawing import draw_sensor
        from taxelflow.publish.terminal import list_sensors
        from taxelflow.sensors.catalogue import catalogue, load_sensor

        if self.joints is not None:
            from taxelflow.publish.plots.space import draw_space

            if self.plot is None or self.name is None:
                raise ParameterInvalid("joints", self.joints, "be given with the name of one sensor and --plot FILE")
            print(draw_space(load_sensor(self.name), self.joints, self.plot))
        elif self.plot is not None:
            from taxelflow.publish.figures import draw_sensors

            sensors = [sensor for _, sensor in catalogue()] if self.name is None else [load_sensor(self.name)]
            for path in draw_sensors(sensors, self.plot):
                print(path)
        elif self.name is None:
            list_sensors(catalogue())
        else:
            draw_sensor(load_sensor(self.name))
        return 0


Command = (
    Annotated[Estimate, tyro.conf.subcommand("estimate")]
    | Annotated[Batch, tyro.conf.subcommand("batch")]
    | Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Record, tyro.conf.subcommand("record")]
    | Annotated[Emulate, tyro.conf.subcommand("emulate")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Info, tyro.conf.subcommand("info")]
    | Annotated[Convert, tyro.conf.subcommand("convert")]
    | Annotated[Plot, tyro.conf.subcommand("plot")]
    | Annotated[Film, tyro.conf.subcommand("film")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Sensors, tyro.conf.subcommand("sensors")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Figures, tyro.conf.subcommand("figures")]
    | Annotated[Score, tyro.conf.subcommand("score")]
    | Annotated[Design, tyro.conf.subcommand("design")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Control, tyro.conf.subcommand("control")]
)


def _check_words(args: list[str]) -> None:
    """Raises NameUnknown for a command or scenario that does not exist, with the nearest one that does; and
    ParameterInvalid for an empty --out, which as a path would be the working directory.
    """
    if "--out=" in args or ("--out", "") in pairwise(args):
        raise ParameterInvalid("out", "", "name a directory or file")
    commands = [typing.get_args(command)[1].name for command in typing.get_args(Command)]
    known = [("command", commands), ("scenario", list(SCENARIOS))]
    for (kind, names), word in zip(known[: 2 if args[:1] == ["simulate"] else 1], args, strict=False):
        if not word.startswith("-") and word not in names:
            raise NameUnknown(kind, word, names)


def _method(args: list[str]) -> str | None:
    """The value of --method among words of the command line."""
    for word, following in zip(args, [*args[1:], ""], strict=True):
        option, equals, value = word.partition("=")
        if option == "--method":
            return value if equals else following
    return None


def _show_method(command: str, method: str) -> None:
    """Print the help of a command, then that of the method, whose own options it also takes."""
    kind = registry.find("estimator", method)
    with suppress(SystemExit):
        parsed(Command, [command, "--help"], "taxelflow", description=DESCRIPTION)
    parsed(kind, ["--help"], f"taxelflow {command} --method {method}")


@cache
def _join_lines_of_help() -> None:
    """Let help texts flow: tyro keeps a line break of a field's docstring before a line that is indented."""
    parse = docstring_parser.parse_from_object

    @cache
    def joined(kind: object, style: DocstringStyle = DocstringStyle.AUTO) -> docstring_parser.Docstring:
        found = parse(kind, style)
        for field in found.params:
            field.description = field.description and " ".join(field.description.split())
        return found

    docstring_parser.parse_from_object = joined


def _run(args: list[str]) -> int:
    """Run the command of these words. Raises TaxelflowError, OSError, KeyboardInterrupt."""
    if args[:1] == ["--version"]:
        print(f"taxelflow {__version__}")
        return 0
    _check_words(args)
    if args[:1] in (["estimate"], ["batch"]) and {"-h", "--help"} & set(args) and (method := _method(args)):
        _show_method(args[0], method)
    own = args[1:] if args[:1] == ["score"] else []  # a score parses its own words
    words = args[: len(args) - len(own)]
    command, rest = parsed(Command, words, "taxelflow", description=DESCRIPTION, return_unknown_args=True)
    if rest and not isinstance(command, Estimating | Run | Design):
        parsed(Command, words, "taxelflow", description=DESCRIPTION)  # raises, with the options that are alike
    code: int = command.run([*rest, *own])
    return code


def main(args: list[str] | None = None) -> int:
    """Run one command; errors that were foreseen become one line on stderr and exit code 2."""
    args = sys.argv[1:] if args is None else args
    try:
        settle_streams()
        logging.basicConfig(format="taxelflow: %(message)s", level=logging.WARNING)
        _join_lines_of_help()
        code = _run(args)
        with written_at(OUTPUT):
            sys.stdout.flush()
        return code
    except (Exception, KeyboardInterrupt, SystemExit) as error:
        return complain(error, args)


if __name__ == "__main__":
    sys.exit(main())
