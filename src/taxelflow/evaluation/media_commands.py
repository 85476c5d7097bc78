"""The commands that show results to people: film, report, view.

A dataclass per command, whose fields are its options. NumPy is imported when a command runs, so that help is fast.
"""

from __future__ import annotations

import signal
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from taxelflow.errors import ParameterInvalid, RecordingMissing, holds_results
from taxelflow.runtime import registry
from taxelflow.runtime.threads import quick_turns, uncollected

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from taxelflow.acquire.base import Recording
    from taxelflow.acquire.devices.base import Source
    from taxelflow.publish.view.server import PageServer

_METHOD = "convolution"
_FILMED = ("from_s", "to_s", "speed", "fps")
"""Options of `view` that mean something with --film only."""


@dataclass(frozen=True)
class Film:
    """Film a result: pressure on the hand, slip vectors, load and events against time."""

    result: Annotated[Positional[Path], tyro.conf.arg(metavar="RESULT")]
    """Directory that `taxelflow estimate --out` wrote; its recording must still be where it was."""
    out: Annotated[Positional[Path], tyro.conf.arg(metavar="OUT")]
    """File to write: .gif, or .mp4 (extra `video`)."""
    fps: float = 10.0
    """Frames per second of the film, 1/s."""
    speed: float = 1.0
    """Speed of the film relative to the recording; 0.25 is slow motion, 4 is time lapse."""
    from_s: float = 0.0
    """Time at which the film begins, s since the first scan."""
    to_s: float | None = None
    """Time at which the film ends, s since the first scan; the last scan if left out."""

    def run(self, _rest: list[str]) -> int:
        """Read, draw, write, print."""
        from taxelflow.evaluation.film import make_film
        from taxelflow.publish.terminal import counted

        count = make_film(
            self.result,
            self.out,
            fps=self.fps,
            speed=self.speed,
            from_s=self.from_s,
            to_s=self.to_s,
            watched=counted,
        )
        print(f"{count} frames in {self.out}")
        return 0


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write results as one HTML file that opens offline: timeline, trajectories, key scans, health, parameters."""

    results: Annotated[
        Positional[tuple[Path, ...]], tyro.conf.arg(metavar="RESULT", help_behavior_hint="(one or more)")
    ]
    """Directories that `taxelflow estimate --out` wrote: methods of one recording are drawn together, recordings one
    after the other."""
    out: Path = Path("report.html")
    """File to write: .html."""

    def run(self, _rest: list[str]) -> int:
        """Read, gather, write, print."""
        from taxelflow.evaluation.report import make_report

        size = make_report(self.results, self.out)
        print(f"{self.out}: {size / 1e6:.2f} MB")
        return 0


@dataclass(frozen=True, kw_only=True)
class View:
    """Play a recording or a live source in the browser: the hand in 3-D, slip vectors, time plots; step and scrub.

    The page is served to this computer only. Results come while it is open; end with Ctrl-C.
    """

    shown: Annotated[Positional[str], tyro.conf.arg(metavar="RECORDING|SOURCE")]
    """Recording, as for `taxelflow estimate`, or live source, as for `taxelflow run`: tcp://HOST:PORT,
    serial:/dev/ttyUSB0, replay:FILE, ..."""
    sensor: str | None = None
    """Name of a built-in sensor (see `taxelflow sensors`), or a TOML file; not needed where the recording or source
    names its own."""
    topic: str | None = None
    """Topic of a bag or .mcap; not needed where only one fits."""
    method: UseAppendAction[tuple[str, ...]] = ()
    """Estimator, see `taxelflow estimate`; convolution if left out. Give it twice to compare two on a recording, as in
    --method template --method convolution."""
    joints: str | None = None
    """Joint angles of the hand, by which its fingers move, see `taxelflow estimate`; recordings only."""
    flat: bool = False
    """Draw the hand laid flat even if its joint angles are known: there the object's path is drawn."""
    contacts: str | None = None
    """Largest number of contacts that are separated, see `taxelflow estimate`."""
    port: int = 8080
    """Port of the page; the next free one if it is taken."""
    host: str = "127.0.0.1"
    """Address to bind to. 0.0.0.0 shows the page to the network, without a password."""
    film: Path | None = None
    """File to write the scene of a recording to, instead of serving the page: .mp4 (extra `video`) or .gif. Needs a
    browser."""
    from_s: Annotated[float, tyro.conf.arg(aliases=("--from",))] = 0.0
    """Time at which the film begins, s since the first scan."""
    to_s: Annotated[float | None, tyro.conf.arg(aliases=("--to",))] = None
    """Time at which it ends, s since the first scan; the last scan if left out."""
    speed: float = 1.0
    """Speed of the film relative to the recording; 0.25 is slow motion."""
    fps: float = 20.0
    """Frames per second of the film, 1/s."""

    def run(self, _rest: list[str]) -> int:
        """Serve until interrupted, or until the source ends."""
        methods = self.method or (_METHOD,)
        scheme, colon, _ = self.shown.partition(":")
        live = bool(colon) and scheme in registry.names("source")
        if live and (len(methods) > 1 or self.joints is not None or self.film is not None):
            raise ParameterInvalid("source", self.shown, "be a recording for two methods, --joints or --film")
        if len(set(methods)) < len(methods):
            raise ParameterInvalid("method", " ".join(methods), "be different ones")
        for name in methods:
            registry.check("estimator", name)
        self._check_film()
        if not live and self.shown.startswith(f"{scheme}://"):
            registry.check("source", scheme)
        if not live and (not Path(self.shown).exists() or holds_results(Path(self.shown))):
            raise RecordingMissing(Path(self.shown))
        if self.sensor is not None:
            from taxelflow.sensors.catalogue import load_sensor

            load_sensor(self.sensor)  # an unknown one is refused before a page is there
        if self.film is not None:
            return self._film(self.film, methods)
        source = self._source() if live else None  # and so is a source that cannot be
        with uncollected() as started:
            from taxelflow.publish.view.server import PageServer

            with PageServer(self.host, self.port) as server, _asked_to_end() as asked, quick_turns():
                print(f"{server.url} (end with Ctrl-C)", flush=True)  # browsers load it, while the rest is imported
                if source is None:
                    self._serve_recording(server, methods, asked, started)
                else:
                    self._serve_source(source, server, methods[0], asked, started)
        return 0  # interrupted: the way to end it

    def _check_film(self) -> None:
        """Raises ParameterInvalid for an option of a film that is not written."""
        for option in fields(self):
            given = getattr(self, option.name)
            if self.film is None and option.name in _FILMED and given != option.default:
                raise ParameterInvalid(option.name, given, "be left out without --film")

    def _serve_recording(
        self, server: PageServer, methods: tuple[str, ...], asked: Event, started: Callable[[], None]
    ) -> None:
        from taxelflow.evaluation.view import Playing

        playing = Playing(self._recording(), methods, server, flat=self.flat)
        try:
            playing.run(asked, started)
        finally:
            playing.close()

    def _serve_source(
        self, source: Source, server: PageServer, method: str, asked: Event, started: Callable[[], None]
    ) -> None:
        from taxelflow.pipeline.live.api import Live
        from taxelflow.pipeline.live.loop import Limits, run_live
        from taxelflow.pipeline.live.view import LiveView

        started()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with suppress(KeyboardInterrupt):
            if not asked.is_set():
                live = Live(source.recording, method, contacts=self.contacts)
                sink = LiveView(live, f"{self.shown}, {method}", server)
                run_live(source, {"view": sink}, live, Limits(), method, sink.watch)

    def _source(self) -> Source:
        from taxelflow.acquire.devices.foreign import source_of
        from taxelflow.runtime.addresses import parse_address
        from taxelflow.sensors.catalogue import load_sensor

        return source_of(parse_address(self.shown), None if self.sensor is None else load_sensor(self.sensor))

    def _film(self, out: Path, methods: tuple[str, ...]) -> int:
        from taxelflow.evaluation.view_film import Part, film_recording
        from taxelflow.publish.terminal import counted

        part = Part(self.from_s, self.to_s, self.speed, self.fps, self.flat)
        count = film_recording(self._recording(), methods, out, part, counted)
        print(f"{count} frames in {out}")
        return 0

    def _recording(self) -> Recording:
        from taxelflow.pipeline import api

        found = api.read(Path(self.shown), self.sensor, topic=self.topic, joints=self.joints)
        return found.with_contacts(self.contacts)


@contextmanager
def _asked_to_end() -> Iterator[Event]:
    """Set by SIGINT. Raised while a module is imported, an interrupt may be lost."""
    asked = Event()
    before = signal.signal(signal.SIGINT, lambda *_: asked.set())
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)
