"""Scans, slips and events to Foxglove, live: `foxglove://HOST:PORT`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taxelflow.errors import ExtraMissing, PortTaken, SinkUnusable
from taxelflow.numerics.clock import nanoseconds
from taxelflow.publish.sinks.foxglove_messages import Drawing
from taxelflow.publish.sinks.json_topics import SCHEMAS, json_schema
from taxelflow.publish.sinks.lines import event_row, object_rows, pad_rows, spatial_objects
from taxelflow.runtime.endpoints import authority

if TYPE_CHECKING:
    from taxelflow.messages import RawScans
    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.runtime.addresses import Address


@dataclass(frozen=True, slots=True)
class _Server:
    """The server of Foxglove."""

    port: int = 8765
    """Default port of Foxglove."""
    backlog: int = 256
    """Messages held for a client that does not read; the oldest are dropped for it."""


_SERVER = _Server()


class FoxgloveServer:
    """A WebSocket server by foxglove-sdk. Only the newest of scans that came together are drawn."""

    lossless = False
    raw = True
    dropped = 0
    gathers_s = 0.02

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        try:
            import foxglove
        except ImportError as error:
            raise ExtraMissing("view", "foxglove-sdk") from error
        self._foxglove: Any = foxglove

    def open(self, head: Head) -> None:
        """See `Sink`."""
        foxglove = self._foxglove
        self._pads, self._drawing = head.pads, Drawing(head.sensor)
        self._context = context = foxglove.Context()  # channels live as long as it
        self._drawn = {
            topic: foxglove.Channel(topic, schema=schema, message_encoding="protobuf", context=context)
            for topic, schema in self._drawing.schemas.items()
        }
        self._results = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(name=name, encoding="jsonschema", data=json_schema(name, properties)),
                message_encoding="json",
                context=context,
            )
            for topic, (name, properties) in SCHEMAS.items()
        }
        try:
            self._server = foxglove.start_server(
                name="taxelflow",
                host=self._host,
                port=self._port,
                context=context,
                message_backlog_size=_SERVER.backlog,
            )
        except (RuntimeError, OSError) as error:
            url = f"foxglove://{authority(self._host, self._port)}"
            if "in use" in str(error):  # its error has no number
                raise PortTaken(url, self._port) from error
            raise SinkUnusable(url, str(error)) from error

    def write_raw(self, scans: RawScans, *, late: bool) -> None:
        """See `Sink`."""
        if late:
            return
        for message in self._drawing.scan(float(scans.t_s[-1]), scans.values[-1]):
            self._drawn[message.topic].log(message.content, log_time=message.t_ns)

    def write(self, update: Update) -> None:
        """See `Sink`."""
        arrows = self._drawing.arrows(update)
        self._drawn["/arrows"].log(arrows.content, log_time=arrows.t_ns)
        t_s = float(update.output.slips.t_s[-1])
        now = {"log_time": nanoseconds(t_s)}
        self._results["/slips"].log({"t_s": t_s, "pads": _known(pad_rows(update, self._pads)[-1])}, **now)
        self._results["/object"].log(_known(object_rows(update.output.motions)[-1]), **now)
        for row in spatial_objects(update, self._pads)[-1:]:
            self._results["/object3d"].log(_known(row), **now)
        for event in update.output.events:
            self._results["/events"].log(_known(event_row(event)), log_time=nanoseconds(event.t_s))

    def tick(self) -> None:
        """The server has threads of its own."""

    def hurry(self) -> None:
        """Nothing is waited for."""

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        self._server.stop()


def _known(values: dict[str, Any]) -> dict[str, Any]:
    """Without NaN, for which JSON has no number."""
    import msgspec

    known: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(values))
    return known


def listen(address: Address) -> FoxgloveServer:
    """`foxglove://HOST:PORT`. Raises AddressInvalid, ExtraMissing."""
    address.check_options(())
    address.refuse_path("foxglove://HOST:PORT")
    return FoxgloveServer(address.host or "127.0.0.1", _SERVER.port if address.port is None else address.port)
