"""A recording, or a scenario of the rig, as a live source at any pace."""

from __future__ import annotations

import math
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from taxelflow.acquire.devices.base import POLL_S, Arrival, Faults
from taxelflow.errors import AddressInvalid, NameUnknown, RecordingError, SourceUnreachable, TopicUnclear
from taxelflow.pipeline import api
from taxelflow.pipeline.live.adoptions import OPTION, asked_missed
from taxelflow.simulation.scenario import SCENARIOS
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Self

    from taxelflow.acquire.base import Recording
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor


@contextmanager
def without_columns() -> Iterator[None]:
    """Add to an error that asks for --columns, which commands on live sources do not take, where to give them."""
    try:
        yield
    except RecordingError as error:
        if "--columns" not in str(error):
            raise
        remedy = "this command takes no --columns: give them to `taxelflow convert`, and this command the .npz"
        raise RecordingError(f"{error}; {remedy}") from error


class Replay:
    """Scans of a recording, each when its time has come.

    speed: 1 for true time, 0 for no waiting at all. stepped: a scan for each line on standard input. missed: times of
    scans to leave out, s.
    """

    patient = True
    paced = False

    def __init__(
        self, recording: Recording, speed: float, *, stepped: bool = False, missed: frozenset[float] = frozenset()
    ) -> None:
        self.recording = recording
        self.faults = Faults()
        self._speed, self._stepped, self._missed = speed, stepped, missed

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_details: object) -> None:
        """Nothing is open."""

    def __iter__(self) -> Iterator[Arrival | None]:
        with without_columns():
            yield from self._arrivals()

    def _arrivals(self) -> Iterator[Arrival | None]:
        reading = self.recording.source_blocks()
        began, first_s, noted = time.monotonic(), None, len(self.recording.notes)
        for block in reading:
            for note in reading.notes[noted:]:
                self.faults.report("recording doubted", note)
            noted = len(reading.notes)
            for t_s, values in zip(block.t_s.tolist(), block.values, strict=True):
                if t_s in self._missed:
                    continue
                if self._stepped and not sys.stdin.readline():
                    return
                if self._speed:
                    first_s = t_s if first_s is None else first_s
                    yield from _until(began + (t_s - first_s) / self._speed)
                yield Arrival(time.monotonic(), t_s, values)
        if reading.loss is not None:
            self.faults.count("recording truncated", str(reading.loss))


def _until(when: float) -> Iterator[None]:
    while (left := when - time.monotonic()) > 0.0:
        time.sleep(min(left, POLL_S))
        if left > POLL_S:
            yield None


def replay(address: Address, sensor: Sensor | None) -> Replay:
    """`replay:FILE?speed=1`; speed=max, speed=step; adoptions: see `asked_adoptions`.

    Raises what `read` raises, and AddressInvalid.
    """
    address.check_options(("speed", "topic", OPTION))
    path = address.file_path("replay:FILE?speed=1")
    try:
        with without_columns():
            recording = api.read(path, sensor, topic=address.options.get("topic"))
    except TopicUnclear as error:
        raise error.asked_by("?topic=NAME") from None
    return _paced(address, recording, asked_missed(address))


def rig(address: Address, sensor: Sensor | None) -> Replay:
    """`rig:SCENARIO?seed=1`: a simulated hand. Raises AddressInvalid, NameUnknown, and what simulating raises."""
    address.check_options(("speed", "seed"))
    name = address.need_path("rig:SCENARIO?seed=1")
    if name not in SCENARIOS:
        raise NameUnknown("scenario", name, SCENARIOS)
    if sensor is not None:
        raise AddressInvalid(address.url, "a scenario has its own sensor", "no --sensor")
    return _paced(address, simulate(replace(SCENARIOS[name], seed=address.whole("seed", 0))))


def _paced(address: Address, recording: Recording, missed: frozenset[float] = frozenset()) -> Replay:
    speed = address.options.get("speed", "1")
    if speed == "step":
        if sys.stdin is None:
            raise SourceUnreachable(address.url, "standard input is closed", 0.0, "give a line for each scan by a pipe")
        return Replay(recording, 0.0, stepped=True, missed=missed)
    if speed == "max":
        return Replay(recording, 0.0, missed=missed)
    try:
        factor = float(speed)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor < math.inf:
        raise AddressInvalid(address.url, f"speed={speed}", "speed=NUMBER above 0, speed=max or speed=step")
    return Replay(recording, factor, missed=missed)
