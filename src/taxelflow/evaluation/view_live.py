"""`taxelflow view SOURCE`: a live source in the browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.acquire.devices.foreign import source_of
from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.loop import Limits, run_live
from taxelflow.pipeline.live.view import LiveView
from taxelflow.runtime.addresses import parse_address

if TYPE_CHECKING:
    from taxelflow.publish.view.server import PageServer
    from taxelflow.sensors.sensor import Sensor


def view_source(url: str, sensor: Sensor | None, method: str, contacts: str | None, server: PageServer) -> None:
    """Show a live source until it ends. Raises NameUnknown, and what the source raises."""
    source = source_of(parse_address(url), sensor)
    live = Live(source.recording, method, contacts=contacts)
    sink = LiveView(live, f"{url}, {method}", server)
    run_live(source, {"view": sink}, live, Limits(), method, sink.watch)
