"""The command line: a dataclass per command, whose fields are its options. Thin: the work is done elsewhere."""

from __future__ import annotations

import io
import logging
import os
import sys
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from taxelflow.acquire.rig.scenario import DESCRIPTIONS, SCENARIOS, Scenario
from taxelflow.condition.conditioner import Conditioner
from taxelflow.errors import ParameterInvalid, TaxelflowError
from taxelflow.estimation.smoothing import Smoothing
from taxelflow.fuse.rigid import RigidField
from taxelflow.monitor.slip import SlipMonitor

BAD_INPUT, PARTLY_READ, INTERRUPTED = 2, 1, 130


@dataclass(frozen=True)
class Estimate:
    """Estimate motion and slip from a recording: slips.csv, object.csv, events.csv, summary.json.

    A method's own parameters follow as options, e.g. --gain 1.04 for lnorm and convolution.
    Exit code: 0; 1 if the recording is truncated and only a part could be read; 2 on bad input.
    """

    recording: Positional[Path]
    """An .npz, .csv or .dsa file."""
    out: Path
    """Directory for the results; made if it does not exist."""
    sensor: str | None = None
    """A built-in sensor (see `taxelflow sensors`) or a TOML file; not needed where the recording names its own."""
    method: str = "convolution"
    """lnorm or convolution (the paper's methods I and II), registration (of two scans, with rotation), the baselines
    sum (no direction) or principal_axis (with rotation), or one from another package."""
    mode: Literal["batch", "stream"] = "batch"
    """batch: learn tare and noise from the whole recording first. stream: scan by scan, as from a live device."""
    calibration: Path | None = None
    """Gains per pad and axis: a file by `taxelflow calibrate`, of the same sensor and method."""
    condition: Conditioner = field(default_factory=Conditioner)
    monitor: SlipMonitor = field(default_factory=SlipMonitor)
    fusion: RigidField = field(default_factory=RigidField)
    smooth: Smoothing = field(default_factory=Smoothing)

    def run(self, rest: list[str]) -> int:
        """Read, estimate, write."""
        from taxelflow import api, registry
        from taxelflow.calibration import load_calibration
        from taxelflow.pipeline import Pipeline
        from taxelflow.publish.summary import Totals
        from taxelflow.publish.tables import Tables
        from taxelflow.publish.terminal import progress, say

        kind = registry.find("estimator", self.method)
        estimator = tyro.cli(kind, args=rest, prog=f"taxelflow estimate --method {self.method}")
        recording = api.read(self.recording, self.sensor)
        calibration = None if self.calibration is None else load_calibration(self.calibration)
        pipeline = Pipeline(estimator, self.mode, self.condition, self.monitor, self.fusion, calibration, self.smooth)
        totals = Totals(recording.layout.pads)
        with Tables(self.out, recording.layout.pads) as tables:
            run = pipeline.start(recording)
            for output in progress(run, recording.scans, "estimating"):
                tables.write(output.slips, output.slipping, output.motions, output.events)
                totals.add(output.slips, output.slipping, output.events)
            summary = api.summarise(self.method, pipeline, run, totals)
            tables.write_summary(summary)
        say(summary, self.out)
        return PARTLY_READ if summary.loss else 0


@dataclass(frozen=True)
class Calibrate:
    """Fit a method's gains per pad and axis, the paper's mm factor, from a known trajectory of the object.

    Frames and time offset between robot and sensor are fitted too. Contacts cut by a pad's border count less.
    """

    recording: Positional[Path]
    """A recording in which the object slides over the pads."""
    out: Path
    """The .toml file to write, for `taxelflow estimate --calibration`."""
    truth: Path | None = None
    """csv t_s,x_m,y_m[,theta_rad] of the contact's centre, in the robot's frame (seen from outside the skin) and on its
    clock; if left out, the truth inside a simulated recording."""
    sensor: str | None = None
    """A built-in sensor or a TOML file; not needed where the recording names its own."""
    method: str = "convolution"
    """lnorm or convolution."""
    pad: str | None = None
    """This pad only; all that can be calibrated if left out."""
    search_s: float = 1.0
    """The robot's clock and the sensor's agree within so many seconds; 0: exactly."""
    edge: float = 1.0
    """Weight of what the pad's border may hide; 0 trusts contacts that are cut as much as whole ones."""
    within_m: float | None = None
    """Use only positions at most so far from the pad's centre along each axis, m."""

    def run(self, _rest: list[str]) -> int:
        """Read, fit, write, print."""
        from taxelflow import api
        from taxelflow.acquire.trajectory import read_trajectory
        from taxelflow.calibration import save_calibration
        from taxelflow.publish.terminal import show_calibration
        from taxelflow.score.calibrate import calibrate

        if self.out.suffix != ".toml":
            raise ParameterInvalid("out", str(self.out), "it ends in .toml")
        recording = api.read(self.recording, self.sensor)
        truth = None if self.truth is None else read_trajectory(self.truth)
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


@dataclass(frozen=True)
class Info:
    """Look at a recording: sensor, pads, scans, rate with jitter and gaps, values, idle and saturated taxels."""

    recording: Positional[Path]
    """An .npz, .csv or .dsa file."""
    sensor: str | None = None
    """A built-in sensor or a TOML file; not needed where the recording names its own."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self, _rest: list[str]) -> int:
        """Read once, count, print."""
        from taxelflow import api
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import progress, show_checkup
        from taxelflow.score.checkup import check_up

        recording = api.read(self.recording, self.sensor)
        checkup = check_up(recording, lambda blocks: progress(blocks, recording.scans, "reading"))
        if self.json:
            sys.stdout.buffer.write(to_json(checkup))
        else:
            show_checkup(checkup)
        if checkup.loss:
            print(f"taxelflow: {checkup.loss}", file=sys.stderr)
        return PARTLY_READ if checkup.loss else 0


@dataclass(frozen=True)
class Sensors:
    """List the built-in sensors, or draw one."""

    name: Positional[str | None] = None
    """A built-in sensor or a TOML file to draw."""

    def run(self, _rest: list[str]) -> int:
        """Print a table or a drawing."""
        from taxelflow.layout import builtin_sensors, load_sensor
        from taxelflow.publish.terminal import draw_sensor, list_sensors

        if self.name is None:
            list_sensors([load_sensor(name) for name in builtin_sensors()])
        else:
            draw_sensor(load_sensor(self.name))
        return 0


@dataclass(frozen=True, kw_only=True)
class Simulated(Scenario):
    """Simulate a recording: one object moved over a pad or the hand; truth and all parameters go into the file."""

    out: Path
    """The .npz file to write."""


_Scenarios = tyro.extras.subcommand_type_from_defaults(
    {
        name: Simulated(**{item.name: getattr(scenario, item.name) for item in fields(scenario)}, out=tyro.MISSING)
        for name, scenario in SCENARIOS.items()
    },
    descriptions=DESCRIPTIONS,
    prefix_names=False,
)


@dataclass(frozen=True)
class Simulate:
    """Simulate a recording: an object moved by a robot over a pad or the hand, truth and all parameters in the file."""

    scenario: Annotated[_Scenarios, tyro.conf.arg(name="")]  # type: ignore[valid-type]
    """What moves over what; each scenario's options follow its name."""

    def run(self, _rest: list[str]) -> int:
        """Simulate and write."""
        from taxelflow.acquire.rig.simulate import save

        asked: Simulated = self.scenario
        if asked.out.suffix != ".npz":
            raise ParameterInvalid("out", str(asked.out), "it ends in .npz")
        recording = save(Scenario(**{item.name: getattr(asked, item.name) for item in fields(Scenario)}), asked.out)
        print(f"{recording.scans} scans of {recording.sensor.name} in {asked.out}")
        return 0


@dataclass(frozen=True)
class Score:
    """Measure accuracy against truth on the simulated rig."""

    what: Positional[Literal["table1", "field"]]
    """table1: the paper's Table I beside ours, by both of the paper's methods. field: translation and rotation of an
    object over the whole hand, by number of slip vectors."""
    strokes: int = 1000
    """table1: strokes at each speed, half of them backward."""
    seeds: int = 10
    """field: seeds of each scenario."""
    seed: int = 0
    """table1: seed of the first stroke; the others follow from it."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self, _rest: list[str]) -> int:
        """Run and print."""
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import counted, show_field, show_table1
        from taxelflow.score.field import score_field
        from taxelflow.score.table1 import table1

        _at_least("strokes", self.strokes, 2)
        _at_least("seeds", self.seeds, 1)
        _at_least("seed", self.seed, 0)
        if self.what == "table1":
            table = table1(self.strokes, self.seed, lambda trials: counted(trials, "trials"))
            show_table1(table) if not self.json else sys.stdout.buffer.write(to_json(table))
        else:
            field = score_field(self.seeds, lambda seeds: counted(seeds, "seeds"))
            show_field(field) if not self.json else sys.stdout.buffer.write(to_json(field))
        return 0


@dataclass(frozen=True)
class Plot:
    """Draw results: position against time, path over the pads, and one scan in the paper's three views."""

    results: Positional[tuple[Path, ...]]
    """Directories that `taxelflow estimate --out` wrote, of one recording; several methods are drawn together."""
    out: Path | None = None
    """Directory for the pictures; the first result's if left out."""
    format: Literal["svg", "png", "pdf"] = "svg"

    def run(self, _rest: list[str]) -> int:
        """Draw and name the files."""
        from taxelflow.figures import draw_results

        if not self.results:
            raise ParameterInvalid("results", "nothing", "give at least one directory")
        for path in draw_results(self.results, self.out or self.results[0], self.format):
            print(path)
        return 0


@dataclass(frozen=True)
class Figures:
    """Draw the paper's figures 2, 4, 5, 6, 7 and 9, its Table I, and rotation error by number of slip vectors."""

    out: Path
    """Directory for the pictures; made if it does not exist."""
    format: Literal["svg", "png", "pdf"] = "svg"
    strokes: int = 1000
    """Strokes a speed in Table I."""
    seeds: int = 10
    """Seeds a scenario in the curve of rotation error."""

    def run(self, _rest: list[str]) -> int:
        """Simulate, estimate, draw."""
        from taxelflow.paper import draw_paper

        _at_least("strokes", self.strokes, 2)
        _at_least("seeds", self.seeds, 1)
        for path in draw_paper(self.out, self.format, strokes=self.strokes, seeds=self.seeds):
            print(path)
        return 0


@dataclass(frozen=True)
class Bench:
    """Measure speed: kernels against the literal equations, where the time goes, start of the command line."""

    recording: Path | None = None
    """Recording whose reading and estimating is measured; a simulated one if left out."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self, _rest: list[str]) -> int:
        """Run and print."""
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import show_bench
        from taxelflow.score.bench import bench

        figures = bench(self.recording)
        if self.json:
            sys.stdout.buffer.write(to_json(figures))
        else:
            show_bench(figures)
        return 0


def _at_least(name: str, value: int, least: int) -> None:
    if value < least:
        raise ParameterInvalid(name, value, f"it is {least} or more")


Command = (
    Annotated[Estimate, tyro.conf.subcommand("estimate")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Info, tyro.conf.subcommand("info")]
    | Annotated[Plot, tyro.conf.subcommand("plot")]
    | Annotated[Sensors, tyro.conf.subcommand("sensors")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Figures, tyro.conf.subcommand("figures")]
    | Annotated[Score, tyro.conf.subcommand("score")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
)


def main(args: list[str] | None = None) -> int:
    """Run one command; errors that were foreseen become one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a letter shows a mark instead
    logging.basicConfig(format="taxelflow: %(message)s", level=logging.WARNING)
    try:
        command, rest = tyro.cli(
            Command,
            args=args,
            prog="taxelflow",
            description="Touch-based motion sensing for robot hands: pressure scans in, object motion and slip out.",
            return_unknown_args=True,
        )
        if rest and not isinstance(command, Estimate):
            print(f"taxelflow: unrecognised options: {' '.join(rest)}; see --help", file=sys.stderr)
            return BAD_INPUT
        return command.run(rest)
    except TaxelflowError as error:
        print(f"taxelflow: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("taxelflow: interrupted; rows computed so far stand in the .part files", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of a pipe, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        print(f"taxelflow: {error.strerror or error}: {error.filename}; check path and rights", file=sys.stderr)
        return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
