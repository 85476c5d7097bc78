"""The command line: a dataclass per command, whose fields are its options. Thin: the work is done elsewhere."""

from __future__ import annotations

import io
import logging
import os
import sys
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional

from taxelflow.acquire.columns import Columns
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import ParameterInvalid, TaxelflowError
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.fusion.parameters import RigidField
from taxelflow.simulation.scenario import DESCRIPTIONS, SCENARIOS, Scenario, Solver
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Callable

    from msgspec import Struct

    from taxelflow.acquire.base import Recording

BAD_INPUT, PARTLY_READ, INTERRUPTED = 2, 1, 130


@dataclass(frozen=True, kw_only=True)
class _Recorded:
    """The options of all commands that read a recording."""

    recording: Positional[Path]
    """A recording: .npz, .csv, .tsv, .txt, .parquet, .dsa, .mcap, a ROS 1 .bag, a ROS 2 bag (directory or .db3)."""
    sensor: str | None = None
    """A built-in sensor (see `taxelflow sensors`) or a TOML file; not needed where the recording names its own."""
    topic: str | None = None
    """Topic of a bag or .mcap; not needed where only one fits."""

    columns: Columns = field(default_factory=Columns)

    def opened(self) -> Recording:
        """The recording, ready to be read."""
        from taxelflow import api

        columns = None if self.columns == Columns() else self.columns
        return api.read(self.recording, self.sensor, topic=self.topic, columns=columns)


@dataclass(frozen=True, kw_only=True)
class Estimate(_Recorded):
    """Estimate motion and slip from a recording: slips.csv, object.csv, events.csv, contacts.csv, summary.json.

    A method that learns the object's pressure pattern (template) writes patterns.npz, too.
    A method's own parameters follow as options, e.g. --gain 1.04 for lnorm and convolution.
    Exit code: 0; 1 if the recording is truncated and only a part could be read; 2 on bad input.
    """

    out: Path
    """Directory for the results; made if it does not exist."""
    method: str = "convolution"
    """lnorm or convolution (the paper's methods I and II), template (learns the object's pressure pattern, with
    rotation), registration (of two scans, with rotation), the baselines sum (no direction) or principal_axis (with
    rotation), or one from another package."""
    mode: Literal["batch", "stream"] = "batch"
    """batch: learn tare and noise from the whole recording first. stream: scan by scan, as from a live device."""
    calibration: Path | None = None
    """Gains per pad and axis: a file by `taxelflow calibrate`, of the same sensor and method."""
    contacts: str | None = None
    """Tell contacts that move independently apart, as pads of their own (palm#1, palm#2): at most so many on every pad,
    or by pad, such as palm=2,thumb=3. What the sensor says, usually 1, if left out: a rigid object with several feet is
    one contact."""
    condition: Conditioner = field(default_factory=Conditioner)
    monitor: SlipMonitor = field(default_factory=SlipMonitor)
    fusion: RigidField = field(default_factory=RigidField)
    features: ContactFeatures = field(default_factory=ContactFeatures)
    smooth: Smoothing = field(default_factory=Smoothing)

    def run(self, rest: list[str]) -> int:
        """Read, estimate, write."""
        from taxelflow import api, registry
        from taxelflow.pipeline import Pipeline
        from taxelflow.publish.summary import Totals
        from taxelflow.publish.tables import Tables
        from taxelflow.publish.terminal import progress, say
        from taxelflow.sensors.calibration import load_calibration

        kind = registry.find("estimator", self.method)
        estimator = tyro.cli(kind, args=rest, prog=f"taxelflow estimate --method {self.method}")
        recording = self.opened().with_contacts(self.contacts)
        calibration = None if self.calibration is None else load_calibration(self.calibration)
        pipeline = Pipeline(
            estimator,
            self.mode,
            self.condition,
            self.monitor,
            self.fusion,
            calibration,
            self.features,
            self.smooth,
        )
        totals = Totals(recording.layout)
        with Tables(self.out, recording.layout.pads) as tables:
            run = pipeline.start(recording)
            for output in progress(run, recording.scans, "estimating"):
                tables.write(output.slips, output.slipping, output.motions, output.events, output.contacts)
                totals.add(output.slips, output.slipping, output.events)
            summary = api.summarise(self.method, pipeline, run, totals)
            tables.write_patterns(run.patterns)
            tables.write_summary(summary)
        say(summary, self.out)
        return PARTLY_READ if summary.loss else 0


@dataclass(frozen=True, kw_only=True)
class Calibrate(_Recorded):
    """Fit a method's gains per pad and axis, the paper's mm factor, from a known trajectory of the object.

    Frames and time offset between robot and sensor are fitted too. Contacts cut by a pad's border count less.
    """

    out: Path
    """The .toml file to write, for `taxelflow estimate --calibration`."""
    truth: Path | None = None
    """csv t_s,x_m,y_m[,theta_rad] of the contact's centre, in the robot's frame (seen from outside the skin) and on its
    clock; if left out, the truth inside a simulated recording."""
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
        from taxelflow.acquire.trajectory import read_trajectory
        from taxelflow.evaluation.calibrate import calibrate
        from taxelflow.publish.terminal import show_calibration
        from taxelflow.sensors.calibration import save_calibration

        if self.out.suffix != ".toml":
            raise ParameterInvalid("out", str(self.out), "end in .toml")
        recording = self.opened()
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


@dataclass(frozen=True, kw_only=True)
class Info(_Recorded):
    """Check a sensor up by a recording: rate, gaps, repeated scans; noise, drift, load and bad taxels of each pad.

    Taxels that are not well are named with the evidence; `taxelflow estimate --condition.mask auto` leaves them out.
    """

    json: bool = False
    """Print JSON instead of tables."""

    def run(self, _rest: list[str]) -> int:
        """Read once, count, print."""
        from taxelflow.evaluation.checkup import check_up
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import progress, show_checkup

        recording = self.opened()
        checkup = check_up(recording, lambda blocks: progress(blocks, recording.scans, "reading"))
        if self.json:
            sys.stdout.buffer.write(to_json(checkup))
        else:
            show_checkup(checkup)
        for note in (*checkup.notes, *([checkup.loss] if checkup.loss else [])):
            print(f"taxelflow: {note}", file=sys.stderr)
        return PARTLY_READ if checkup.loss else 0


@dataclass(frozen=True, kw_only=True)
class Convert(_Recorded):
    """Write a recording as .npz, .csv, .parquet or .mcap, exact; all but .csv keep sensor, mask and truth.

    Exit code: 0; 1 if the recording is truncated and only a part could be written; 2 on bad input.
    """

    out: Positional[Path]
    """The file to write; its suffix says the format."""

    def run(self, _rest: list[str]) -> int:
        """Read, write, print."""
        from taxelflow import api
        from taxelflow.publish.terminal import progress

        recording = self.opened()
        reading = api.convert(recording, self.out, lambda blocks: progress(blocks, recording.scans, "converting"))
        print(f"{reading.scans} scans of {recording.sensor.name} in {self.out}")
        if self.out.suffix.lower() == ".csv":
            lost = "neither sensor nor truth" if recording.truth is not None else "no sensor"
            print(f"taxelflow: a csv holds {lost}: give --sensor when it is read", file=sys.stderr)
        for note in (*reading.notes, *([reading.loss] if reading.loss else [])):
            print(f"taxelflow: {note}", file=sys.stderr)
        return PARTLY_READ if reading.loss else 0


@dataclass(frozen=True)
class Sensors:
    """List the built-in sensors, or draw one."""

    name: Positional[str | None] = None
    """A built-in sensor, a plain grid (grid:16x16@4mm) or a TOML file to draw."""
    plot: Path | None = None
    """Draw a picture: a .svg, .png or .pdf file, or a directory for NAME.svg. Without a name: all built-in sensors."""

    def run(self, _rest: list[str]) -> int:
        """Print a table or a drawing, or write pictures."""
        from taxelflow.publish.drawing import draw_sensor
        from taxelflow.publish.terminal import list_sensors
        from taxelflow.sensors.catalogue import catalogue, load_sensor

        if self.plot is not None:
            from taxelflow.publish.figures import draw_sensors

            sensors = [sensor for _, sensor in catalogue()] if self.name is None else [load_sensor(self.name)]
            for path in draw_sensors(sensors, self.plot):
                print(path)
        elif self.name is None:
            list_sensors(catalogue())
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
        from taxelflow.simulation.simulate import save

        asked: Simulated = self.scenario
        if asked.out.suffix != ".npz":
            raise ParameterInvalid("out", str(asked.out), "end in .npz")
        recording = save(Scenario(**{item.name: getattr(asked, item.name) for item in fields(Scenario)}), asked.out)
        print(f"{recording.scans} scans of {recording.sensor.name} in {asked.out}")
        return 0


@dataclass(frozen=True)
class Score:
    """Measure accuracy and slip events: against truth on the simulated rig, or on real recordings without it."""

    what: Positional[Literal["table1", "hard", "field", "slip", "limits", "peers", "real", "contacts"]]
    """table1: the paper's Table I beside ours. hard: its strokes streamed, with dead or saturated taxels, read taxel by
    taxel, of a small object. field: translation and rotation of an object over the whole hand, by number of slip
    vectors. slip: slips found and missed, and false alarms an hour. limits: estimators against the Cramér-Rao bound,
    and whether their covariances hold. peers: Table I's strokes through OpenCV, scikit-image and OpenPIV beside ours
    (extra `bench`). real: on recordings without truth, how well the template predicts the next scan, and its turn
    beside the principal axis. contacts: two objects on one pad, told apart and not, and feet that lift."""
    of: Positional[tuple[str, ...]] = ()
    """limits: one of the scenarios of `taxelflow simulate`; stroke if left out. real: the recordings."""
    sensor: str | None = None
    """real: as for `taxelflow estimate`."""
    topic: str | None = None
    """real: as for `taxelflow estimate`."""
    strokes: int = 1000
    """table1, peers: strokes at each speed, half of them backward."""
    seeds: int = 10
    """field, limits, contacts: seeds of each scenario. hard: recordings of each case and speed. slip: recordings of
    each object that sticks and slips."""
    seed: int = 0
    """table1, hard, peers, limits, contacts: the first seed; the others follow from it. slip: added to the seeds, which
    begin at 1000."""
    methods: tuple[str, ...] = ()
    """table1, peers: our methods to score; the paper's, and the template, if left out. hard: the template if left
    out. limits: all if left out. slip: template, principal_axis and convolution if left out. contacts: template and
    lnorm if left out."""
    mode: Literal["batch", "stream"] = "batch"
    """limits: as for `taxelflow estimate`."""
    solver: Solver = "analytic"
    """table1, hard, peers, limits: as for `taxelflow simulate`; elastic takes seconds a contact (extra `sim`)."""
    hours: float = 0.1
    """slip: hours of each scenario that holds an object still."""
    alarms_per_hour: float = 1.0
    """slip: the rate of false alarms that is asked for."""
    processes: int = 1
    """slip: work on so many recordings at a time."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self, _rest: list[str]) -> int:
        """Run and print."""
        from taxelflow.publish.summary import to_json

        _at_least("strokes", self.strokes, 2)
        _at_least("seeds", self.seeds, 0 if self.what == "slip" else 1)
        _at_least("seed", self.seed, 0)
        self._check_of()
        kinds = {
            "table1": self._table1,
            "hard": self._hard,
            "field": self._field,
            "slip": self._slip,
            "limits": self._limits,
            "peers": self._peers,
            "real": self._real,
            "contacts": self._contacts,
        }
        scored, show = kinds[self.what]()
        show(scored) if not self.json else sys.stdout.buffer.write(to_json(scored))
        return 0

    def _check_of(self) -> None:
        """What is scored is named for `limits` and `real` only."""
        if self.what == "real":
            if not self.of:
                raise ParameterInvalid("recordings", "nothing", "name at least one recording")
            return
        for name, value in (("sensor", self.sensor), ("topic", self.topic)):
            if value is not None:
                raise ParameterInvalid(name, value, f"be left out: score {self.what} reads no recording")
        if self.of and self.what != "limits":
            raise ParameterInvalid(
                "of", " ".join(self.of), f"be left out: score {self.what} simulates its own recordings"
            )
        if len(self.of) > 1:
            raise ParameterInvalid(
                "scenario", " ".join(self.of), "be one name: score limits takes one scenario at a time"
            )

    def _real(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow import api
        from taxelflow.evaluation.prediction import score_real
        from taxelflow.evaluation.prediction_table import show_real
        from taxelflow.publish.terminal import counted

        opened = [api.read(path, self.sensor, topic=self.topic) for path in self.of]
        return score_real(opened, partial(counted, what="recordings")), show_real

    def _contacts(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.contacts import score_contacts
        from taxelflow.evaluation.contacts_table import show_contacts
        from taxelflow.publish.terminal import counted

        watched = partial(counted, what="seeds")
        return score_contacts(self.seeds, seed=self.seed, methods=self.methods, watched=watched), show_contacts

    def _table1(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.table1 import table1
        from taxelflow.evaluation.tables import show_table1
        from taxelflow.publish.terminal import counted

        watched = partial(counted, what="trials")
        return table1(self.strokes, self.seed, watched, self.methods, self.solver), show_table1

    def _hard(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.hard import hard
        from taxelflow.evaluation.tables import show_hard
        from taxelflow.publish.terminal import counted

        watched = partial(counted, what="seeds")
        scored = hard(self.seeds, seed=self.seed, methods=self.methods, solver=self.solver, watched=watched)
        return scored, show_hard

    def _field(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.field import score_field
        from taxelflow.evaluation.tables import show_field
        from taxelflow.publish.terminal import counted

        return score_field(self.seeds, partial(counted, what="seeds")), show_field

    def _slip(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.slip import METHODS, score_slip
        from taxelflow.evaluation.tables import show_slip
        from taxelflow.publish.terminal import counted

        _at_least("processes", self.processes, 1)
        if not 0 <= self.hours < float("inf"):
            raise ParameterInvalid("hours", self.hours, "be 0 or more")
        scored = score_slip(
            self.methods or METHODS,
            self.seeds,
            seed=self.seed,
            hours=self.hours,
            alarms_per_hour=self.alarms_per_hour,
            processes=self.processes,
            watched=partial(counted, what="recordings"),
        )
        return scored, show_slip

    def _limits(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.limits import limits
        from taxelflow.evaluation.tables import show_limits
        from taxelflow.publish.terminal import counted

        scored = limits(
            self.of[0] if self.of else "stroke",
            self.seeds,
            seed=self.seed,
            mode=self.mode,
            solver=self.solver,
            methods=self.methods,
            watched=partial(counted, what="seeds"),
        )
        return scored, show_limits

    def _peers(self) -> tuple[Struct, Callable[[Any], None]]:
        from taxelflow.evaluation.peers import score_peers
        from taxelflow.evaluation.tables import show_peers
        from taxelflow.publish.terminal import counted

        watched = partial(counted, what="trials")
        return score_peers(self.strokes, self.seed, watched, self.methods, self.solver), show_peers


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
        from taxelflow.publish.figures import draw_results

        if not self.results:
            raise ParameterInvalid("results", "nothing", "name at least one directory")
        for path in draw_results(self.results, self.out or self.results[0], self.format):
            print(path)
        return 0


@dataclass(frozen=True)
class Figures:
    """Draw the paper's figures 2, 4, 5, 6, 7, 9 and Table I, rotation error by slip vectors, error over the bound."""

    out: Path
    """Directory for the pictures; made if it does not exist."""
    format: Literal["svg", "png", "pdf"] = "svg"
    strokes: int = 1000
    """Strokes a speed in Table I."""
    seeds: int = 10
    """Seeds a scenario in the curves of rotation error and of error against the bound."""

    def run(self, _rest: list[str]) -> int:
        """Simulate, estimate, draw."""
        from taxelflow.evaluation.paper import draw_paper

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
        from taxelflow.evaluation.bench import bench
        from taxelflow.publish.summary import to_json
        from taxelflow.publish.terminal import show_bench

        figures = bench(self.recording)
        if self.json:
            sys.stdout.buffer.write(to_json(figures))
        else:
            show_bench(figures)
        return 0


def _at_least(name: str, value: int, least: int) -> None:
    if value < least:
        raise ParameterInvalid(name, value, f"be at least {least}")


Command = (
    Annotated[Estimate, tyro.conf.subcommand("estimate")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Info, tyro.conf.subcommand("info")]
    | Annotated[Convert, tyro.conf.subcommand("convert")]
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
