"""The command line: a dataclass per command, whose fields are its options. Thin: the work is done elsewhere."""

from __future__ import annotations

import logging
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from taxelflow.condition.conditioner import Conditioner
from taxelflow.errors import TaxelflowError
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
    """lnorm or convolution (the paper's methods I and II), or one from another package."""
    mode: Literal["batch", "stream"] = "batch"
    """batch: learn tare and noise from the whole recording first. stream: scan by scan, as from a live device."""
    condition: Conditioner = field(default_factory=Conditioner)
    monitor: SlipMonitor = field(default_factory=SlipMonitor)

    def run(self, rest: list[str]) -> int:
        """Read, estimate, write."""
        from taxelflow import api, registry
        from taxelflow.pipeline import Pipeline
        from taxelflow.publish.summary import Totals
        from taxelflow.publish.tables import Tables
        from taxelflow.publish.terminal import progress, say

        kind = registry.find("estimator", self.method)
        estimator = tyro.cli(kind, args=rest, prog=f"taxelflow estimate --method {self.method}")
        recording = api.read(self.recording, self.sensor)
        pipeline = Pipeline(estimator, self.mode, self.condition, self.monitor)
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


Command = (
    Annotated[Estimate, tyro.conf.subcommand("estimate")]
    | Annotated[Info, tyro.conf.subcommand("info")]
    | Annotated[Sensors, tyro.conf.subcommand("sensors")]
)


def main(args: list[str] | None = None) -> int:
    """Run one command; errors that were foreseen become one line on stderr and exit code 2."""
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
