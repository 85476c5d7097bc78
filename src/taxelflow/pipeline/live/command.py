"""The commands `taxelflow run`, `record` and `emulate`: sources in, estimates out, without end."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from taxelflow.condition.parameters import Conditioner
from taxelflow.errors import AddressInvalid, ParameterInvalid
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address
from taxelflow.runtime.command_line import parsed
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from typing import Any

    from taxelflow.acquire.devices.base import Source
    from taxelflow.pipeline.live.loop import Limits, Report
    from taxelflow.runtime.addresses import Address
    from taxelflow.runtime.signals import Signals


@dataclass(frozen=True, kw_only=True)
class FromSource:
    """What is read, and for how long."""

    source: Annotated[Positional[str], tyro.conf.arg(metavar="SOURCE")]
    """URL to read: tcp://HOST:PORT, tcp-listen://HOST:PORT, udp-listen://HOST:PORT, serial:/dev/ttyUSB0?baud=921600,
    stdin:, replay:FILE?speed=1 (max), rig:SCENARIO?seed=1, or that of a device; see docs/live.md."""
    sensor: str | None = None
    """Name of a built-in sensor (see `taxelflow sensors`), or a TOML file; not needed where the source names its
    own."""
    max_scans: int | None = None
    """Number of scans after which to end."""
    duration: float | None = None
    """Duration after which to end, s."""
    quiet: bool = False
    """Run without a status screen, for services."""

    def __post_init__(self) -> None:
        if self.max_scans is not None and self.max_scans < 1:
            raise ParameterInvalid("max_scans", self.max_scans, "be 1 or more")
        if self.duration is not None and not self.duration > 0:
            raise ParameterInvalid("duration", self.duration, "be above 0 s")

    def run(self, rest: list[str]) -> int:
        """Run until the source ends or a signal asks for the end; print the totals."""
        from taxelflow.pipeline.live.files import take_output
        from taxelflow.pipeline.live.status import say_totals
        from taxelflow.runtime.signals import EndedEarly, Signals

        with Signals() as signals:
            try:
                report = self._report(rest, signals)
            except EndedEarly:
                print("taxelflow: ended before the source was open", file=sys.stderr)
                return 0
            sinks = {worker.label: worker.sink for worker in report.workers}
            say_totals(report, sys.stderr if take_output(sinks) else sys.stdout)
        return 0

    def _report(self, rest: list[str], signals: Signals) -> Report:
        """Open, and run to the end."""
        raise NotImplementedError

    def opened(self) -> Source:
        """The source. Raises NameUnknown, AddressInvalid, SensorNeeded, and what its device raises."""
        from taxelflow.acquire.devices.foreign import source_of
        from taxelflow.sensors.catalogue import load_sensor

        address = parse_address(self.source, f"replay:{self.source} for a recording")
        return source_of(address, None if self.sensor is None else load_sensor(self.sensor))

    @property
    def limits(self) -> Limits:
        """When the run ends by itself."""
        from taxelflow.pipeline.live.loop import Limits

        return Limits(self.max_scans, self.duration)


@dataclass(frozen=True, kw_only=True)
class Run(FromSource):
    """Estimate motion and slip live, from a device to files and programs, until the source ends.

    A method's own parameters follow as options, as for `estimate`. Ctrl-C and SIGTERM end in order.
    Exit code: 0; 2 on bad input, or where the source cannot be opened.
    """

    to: Annotated[UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="SINK")] = ()
    """Address that results go to: tables:DIR, parquet:DIR, mcap:FILE, jsonl:FILE (jsonl:- for stdout), jsonl-listen://HOST:PORT,
    foxglove://HOST:PORT, lsl:NAME, ros2:. May be given several times."""
    method: str = "convolution"
    """Method of estimation, as for `estimate`."""
    calibration: Path | None = None
    """Gains per pad and axis: a file by `taxelflow calibrate`, of the same sensor and method."""
    contacts: str | None = None
    """Split contacts that move independently, as for `estimate`."""
    condition: Conditioner = field(default_factory=Conditioner)
    monitor: SlipMonitor = field(default_factory=SlipMonitor)
    smooth: Smoothing = field(default_factory=Smoothing)

    def _report(self, rest: list[str], signals: Signals) -> Report:
        from taxelflow.pipeline.live.adoptions import asked_adoptions
        from taxelflow.pipeline.live.api import Live
        from taxelflow.pipeline.live.files import check_files
        from taxelflow.pipeline.live.loop import run_live
        from taxelflow.pipeline.live.status import StatusScreen

        sinks = opened_sinks(self.to)
        kind = registry.find("estimator", self.method)
        estimator = parsed(kind, rest, f"taxelflow run --method {self.method}")
        source = self.opened()
        check_files(sinks, source)
        live = Live(
            source.recording,
            estimator,
            condition=self.condition,
            monitor=self.monitor,
            calibration=self.calibration,
            smooth=self.smooth,
            contacts=self.contacts,
            adoptions=asked_adoptions(self.source),
        )
        with StatusScreen(quiet=self.quiet) as screen:
            return run_live(source, sinks, live, self.limits, self.method, screen.show, signals)


@dataclass(frozen=True, kw_only=True)
class Record(FromSource):
    """Record a device's scans as they come, with its sensor, into an .mcap file that survives a kill.

    The file is complete but for the last second at any moment, and is read without --sensor or --topic.
    Exit code: 0; 2 on bad input, or where the source cannot be opened.
    """

    out: Annotated[Positional[Path], tyro.conf.arg(metavar="OUT")]
    """File to write: .mcap."""

    def _report(self, _rest: list[str], signals: Signals) -> Report:
        from taxelflow.pipeline.live.files import check_files
        from taxelflow.pipeline.live.loop import run_live
        from taxelflow.pipeline.live.mcap_sink import McapSink
        from taxelflow.pipeline.live.status import StatusScreen

        if self.out.suffix.lower() != ".mcap":
            raise ParameterInvalid("out", str(self.out), "end in .mcap")
        sinks, source = {str(self.out): McapSink(self.out, drawn=False)}, self.opened()
        check_files(sinks, source)
        with StatusScreen(quiet=self.quiet) as screen:
            return run_live(source, sinks, None, self.limits, watch=screen.show, signals=signals)


def opened_sinks(urls: tuple[str, ...]) -> dict[str, Any]:
    """Sinks by URL, not open yet. Raises NameUnknown, PluginBroken, AddressInvalid, and what a sink raises."""
    sinks = {}
    for url in urls:
        address = parse_address(url, f"tables:{url} for a directory of tables")
        if url in sinks:
            raise AddressInvalid(url, "it is given twice", "each sink once")
        sinks[url] = _sink_of(address)
    return sinks


def _sink_of(address: Address) -> Any:
    """The sink of a URL; one of another package is checked. Raises what `opened_sinks` raises."""
    from taxelflow.publish.sinks.base import Sink

    made = registry.find("sink", address.scheme)(address)
    needed = [*Sink.__annotations__, *(name for name in vars(Sink) if not name.startswith("_"))]
    if missing := [name for name in needed if not hasattr(made, name)]:
        error = TypeError(f"its {type(made).__name__} has no {', '.join(missing)}")
        raise registry.broken("sink", address.scheme, error)
    return made
