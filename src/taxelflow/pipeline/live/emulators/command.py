"""The command `taxelflow emulate DEVICE`: a device that is not there, from a recording or a scenario."""

from __future__ import annotations

import errno
import sys
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from taxelflow.errors import NameUnknown, PortTaken, SourceUnreachable
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import Address, parse_address
from taxelflow.runtime.checks import not_negative
from taxelflow.runtime.signals import Signals

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats
    from taxelflow.pipeline.live.emulators.base import Emulator


@dataclass(frozen=True, kw_only=True)
class Emulate:
    """Emulate a device: send a recording, or simulated scans, by its protocol, with faults if asked for.

    The device is given by the URL that `taxelflow run` reads it by, or by its scheme alone for a usual place.
    Ctrl-C and SIGTERM end in order. Exit code: 0; 2 on bad input.
    """

    device: Annotated[Positional[str], tyro.conf.arg(metavar="DEVICE")]
    """URL of the device: tcp://127.0.0.1:5000 (listens), tcp-listen://HOST:PORT (connects to a run that listens),
    udp-listen://HOST:PORT, serial: (a pseudo-terminal, whose path is printed), stdin: (prints), or that of another
    source."""
    scans: Annotated[str, tyro.conf.arg(name="from", metavar="RECORDING|SCENARIO")]
    """Recording to send, or a scenario of `taxelflow simulate`."""
    sensor: str | None = None
    """Name of a built-in sensor, or a TOML file, for a recording that does not name its own."""
    speed: float = 1.0
    """Factor on the pace of the scans; 0: as fast as they are taken."""
    loop: bool = False
    """Repeat the scans without end, with times that go on."""
    seed: int = 0
    """Seed of the scenario; a recording needs none."""
    fault: Annotated[UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="NAME@S[:EXTENT]")] = ()
    """Fault at a time in s: cable, stall, gone, clock-jump (extent in s), half-frame, checksum, garbage, duplicate,
    reorder, taxel-count. May be given several times."""

    def run(self, _rest: list[str]) -> int:
        """Open, send, print what was sent."""
        from taxelflow.pipeline.live.emulators.base import Playback, parse_fault

        not_negative("speed", self.speed)
        faults = [parse_fault(text) for text in self.fault]
        recording = self._recording()
        with ExitStack() as opened:
            emulator = self._opened(recording, opened)
            print(f"taxelflow: emulating {emulator.url}", file=sys.stderr, flush=True)
            playback = Playback(emulator, faults, self.speed)
            with suppress(KeyboardInterrupt), Signals():  # which raise it
                playback.run(self._scans(recording))
        spoiled = ", ".join(f"{name} {count}" for name, count in playback.done.items()) or "none"
        print(f"taxelflow: {playback.whole} whole scans sent, faults: {spoiled}", file=sys.stderr)
        return 0

    def _recording(self) -> Recording:
        from dataclasses import replace

        from taxelflow.pipeline import api
        from taxelflow.pipeline.live.replay import without_columns
        from taxelflow.simulation.scenario import SCENARIOS

        if Path(self.scans).exists():
            with without_columns():
                return api.read(self.scans, self.sensor)
        if self.scans not in SCENARIOS:
            raise NameUnknown("recording or scenario", self.scans, SCENARIOS)
        from taxelflow.simulation.simulate import simulate

        return simulate(replace(SCENARIOS[self.scans], seed=self.seed))

    def _opened(self, recording: Recording, opened: ExitStack) -> Emulator:
        """The device, which closes with the stack. Raises PortTaken, SourceUnreachable."""
        from taxelflow.acquire.devices.streams import words
        from taxelflow.pipeline.live.emulators.base import USUAL

        named = self.device if ":" in self.device else USUAL.get(self.device, f"{self.device}:")
        address: Address = parse_address(named)
        made: Emulator = registry.find("emulator", address.scheme)(address, recording.sensor)
        try:
            return opened.enter_context(made)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise PortTaken(named, address.port) from error
            remedy = "check the address, and that this machine has it"
            raise SourceUnreachable(named, words(error), 0.0, remedy) from error

    def _scans(self, recording: Recording) -> Iterator[tuple[float, Floats]]:
        """Times and values as the source sent them, again and again if asked for."""
        ahead_s = 0.0
        while True:
            first_s = last_s = step_s = 0.0
            for number, block in enumerate(recording.source_blocks()):
                first_s = first_s if number else float(block.t_s[0])
                for t_s, values in zip(block.t_s.tolist(), block.values, strict=True):
                    yield t_s + ahead_s, values
                    step_s, last_s = t_s - last_s, t_s
            if not self.loop:
                return
            ahead_s += last_s - first_s + step_s
