"""`taxelflow view SOURCE`: a live source in the browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.pipeline.live.api import Live
from taxelflow.pipeline.live.loop import Limits, run_live
from taxelflow.pipeline.live.view import LiveView

if TYPE_CHECKING:
    from taxelflow.acquire.devices.base import Source
    from taxelflow.publish.view.server import PageServer


def view_source(source: Source, url: str, method: str, contacts: str | None, server: PageServer) -> None:
    """Show the live source of a URL until it ends. Raises NameUnknown, and what the source raises."""
    live = Live(source.recording, method, contacts=contacts)
    sink = LiveView(live, f"{url}, {method}", server)
    run_live(source, {"view": sink}, live, Limits(), method, sink.watch)
