"""Live runs in a thread, and devices that send to them."""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from synthetic import dome, grid_sensor
from taxelflow.acquire.devices.line import line_of
from taxelflow.messages import RawScans
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.command import opened_sinks
from taxelflow.pipeline.live.loop import Limits, run_live
from taxelflow.runtime import registry
from taxelflow.runtime.addresses import parse_address

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from taxelflow.pipeline.live.loop import Report
    from taxelflow.sensors.sensor import Sensor

PALM = grid_sensor(4, 7)
SCANS = 80


def slid(scans: int = SCANS) -> RawScans:
    """20 idle scans, then a dome that slides to the right, at 100 Hz."""
    values = np.random.default_rng(0).normal(0, 100, (scans, 28))
    for scan in range(20, scans):
        values[scan] += dome(PALM, 0.0005 * (scan - 40))
    return RawScans(0.01 * np.arange(1, scans + 1), values)


def lines(scans: RawScans, *, timed: bool = True) -> list[bytes]:
    return [line_of(t if timed else None, v) for t, v in zip(scans.t_s.tolist(), scans.values, strict=True)]


def opened(url: str, sensor: Sensor = PALM) -> Any:
    address = parse_address(url)
    return registry.find("source", address.scheme)(address, None if url.startswith(("replay", "rig")) else sensor)


@contextmanager
def running(
    source: str,
    *sinks: str,
    limits: Limits | None = None,
    record: bool = False,
    sensor: Sensor = PALM,
    method: str = "convolution",
) -> Iterator[list[Report]]:
    """A run in a thread; its report is in the list when the context ends."""
    device = opened(source, sensor)
    live = None if record else Live(device.recording, method)
    reports: list[Any] = []

    def work() -> None:
        try:
            reports.append(run_live(device, opened_sinks(sinks), live, limits or Limits(), method))
        except Exception as error:
            reports.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    yield reports
    thread.join(20)
    assert not thread.is_alive()
    if isinstance(reports[0], Exception):
        raise reports[0]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


def connected(port: int) -> socket.socket:
    for _ in range(1000):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            threading.Event().wait(0.01)
    raise AssertionError(f"nobody listens at {port}")


def published(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def awaited(done: Callable[[], bool]) -> None:
    """Let other threads work until something is so."""
    end = time.monotonic() + 60.0
    while not done():
        assert time.monotonic() < end
        time.sleep(0.001)
