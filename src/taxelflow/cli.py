"""The command line: a dataclass per command, whose fields are its options. Thin: the work is done elsewhere.

Commands of the simulation and of the evaluation stand beside their work, in simulation/command.py and
evaluation/commands.py.
"""

from __future__ import annotations

import io
import logging
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from taxelflow.acquire.options import Recorded
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import TaxelflowError
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.evaluation.commands import PARTLY_READ, Bench, Calibrate, Figures, Info, Plot, Score
from taxelflow.fusion.parameters import RigidField
from taxelflow.simulation.command import Simulate
from taxelflow.slip.parameters import SlipMonitor

BAD_INPUT, INTERRUPTED = 2, 130


@dataclass(frozen=True, kw_only=True)
class Estimate(Recorded):
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
    """Split contacts that move independently, as pads of their own (palm#1, palm#2): at most this many on every pad, or
    by pad, such as palm=2,thumb=3. As in the sensor file, usually 1, if left out: a rigid object with several feet is
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
        recording = api.read(self.recording, self.sensor, topic=self.topic, columns=self.own_columns)
        recording = recording.with_contacts(self.contacts)
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
                tables.write(
                    output.slips, output.slipping, output.motions, output.events, output.contacts, output.evidence
                )
                totals.add(output.slips, output.slipping, output.events)
            summary = api.summarise(self.method, pipeline, run, totals)
            tables.write_patterns(run.patterns)
            tables.write_summary(summary)
        say(summary, self.out)
        return PARTLY_READ if summary.loss else 0


@dataclass(frozen=True, kw_only=True)
class Convert(Recorded):
    """Write a recording as .npz, .csv, .parquet or .mcap, exact; all but .csv keep sensor, mask and truth.

    Exit code: 0; 1 if the recording is truncated and only a part could be written; 2 on bad input.
    """

    out: Positional[Path]
    """The file to write; its suffix gives the format."""

    def run(self, _rest: list[str]) -> int:
        """Read, write, print."""
        from taxelflow import api
        from taxelflow.publish.terminal import progress

        recording = api.read(self.recording, self.sensor, topic=self.topic, columns=self.own_columns)
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
    args = sys.argv[1:] if args is None else args
    own = args[1:] if args[:1] == ["score"] else []  # a score parses its own words
    try:
        command, rest = tyro.cli(
            Command,
            args=args[: len(args) - len(own)],
            prog="taxelflow",
            description="Touch-based motion sensing for robot hands: pressure scans in, object motion and slip out.",
            return_unknown_args=True,
        )
        if rest and not isinstance(command, Estimate):
            print(f"taxelflow: unrecognised options: {' '.join(rest)}; see --help", file=sys.stderr)
            return BAD_INPUT
        return command.run([*rest, *own])
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
