"""Topics of ROS 1 or ROS 2 through a rosbridge server: `rosbridge://HOST:PORT/topic?type=tactile_msgs/TactileState`.

Without `?type=` the type is asked for (rosapi). The protocol is JSON over a WebSocket.
"""

from __future__ import annotations

import base64
import json
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.acquire.devices.base import Faults, WholeMessages
from taxelflow.acquire.devices.streams import STREAM_OPTIONS, ByteSource, is_timed, need_sensor
from taxelflow.acquire.devices.websocket import WebSocket
from taxelflow.acquire.ros.columns import columns_of
from taxelflow.acquire.ros.decode import follow, parts_of
from taxelflow.acquire.ros.kinds import kind_of, known_types
from taxelflow.acquire.ros.units import in_unit_of
from taxelflow.errors import AddressInvalid
from taxelflow.runtime.endpoints import authority

if TYPE_CHECKING:
    from taxelflow.acquire.ros.kinds import Kind
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

PORT = 9090
"""Default port of rosbridge."""


class RosbridgeParser:
    """Messages of one topic as JSON, by the table of message types."""

    def __init__(self, sensor: Sensor, kind: Kind | None, faults: Faults, *, timed: bool) -> None:
        self._sensor, self._kind, self._faults, self._timed = sensor, kind, faults, timed

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `WholeMessages`."""
        try:
            message = msgspec.json.decode(received, type=dict[str, Any])
            if message.get("op") == "service_response":
                self._kind = self._kind or kind_of(str(message["values"]["type"]))
                return []
            if message.get("op") != "publish":
                return []
            if self._kind is None:
                self._faults.count("bad message", "its type is not known; give ?type=PACKAGE/NAME")
                return []
            if in_unit_of(self._kind, self._sensor) != self._sensor:  # too late: the run has begun in the other unit
                seen = f"it holds {self._kind.unit}, sensor {self._sensor.name!r} {self._sensor.unit}"
                self._faults.count("bad message", f"{seen}; give ?type={self._kind.types[0].replace('/msg/', '/')}")
                return []
            return [self._scan(message["msg"], self._kind)]
        except Exception as error:  # a damaged message may be anything
            self._faults.count("bad message", f"{type(error).__name__}: {str(error)[:80]}")
            return []

    def _scan(self, message: dict[str, Any], kind: Kind) -> tuple[float | None, Floats]:
        """Time and values. Raises ValueError, and KeyError for a message of another type."""
        parts = parts_of([_numbers(item) for path in kind.values for item in follow(message, path)])
        named = [str(name) for name in follow(message, kind.names)] if kind.names else ()
        columns = columns_of(self._sensor, kind, [len(part) for part in parts], named)
        if columns is None:
            raise ValueError(f"{sum(map(len, parts))} values do not fit sensor {self._sensor.name!r}")
        t_s = _seconds(follow(message, kind.stamp)[0]) if kind.stamp and self._timed else None
        return t_s, np.concatenate(parts)[columns]


def _numbers(item: Any) -> Floats:
    if isinstance(item, str):  # rosbridge sends bytes so
        return np.frombuffer(base64.b64decode(item), np.uint8).astype(np.float64)
    return np.array(item, np.float64)


def _seconds(stamp: Any) -> float | None:
    """A stamp of ROS 1 or 2, None where it is not set."""
    if not isinstance(stamp, dict):
        return float(stamp)
    seconds, fraction = ("sec", "nanosec") if "sec" in stamp else ("secs", "nsecs")
    return float(stamp[seconds]) + 1e-9 * float(stamp[fraction]) or None


def asked_kind(address: Address) -> Kind | None:
    """The entry of the option type in the table of messages; None without it. Raises AddressInvalid."""
    name = address.options.get("type")
    if name is None:
        return None
    kind = kind_of(name)
    if kind is None:
        raise AddressInvalid(address.url, f"type={name}", f"type=PACKAGE/NAME, one of {', '.join(known_types())}")
    return kind


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`rosbridge://HOST:PORT/topic`. Raises AddressInvalid, SensorNeeded, ExtraMissing."""
    address.check_options((*STREAM_OPTIONS, "type"))
    topic = "/" + address.need_path("rosbridge://HOST:PORT/topic").lstrip("/")
    sensor, faults = need_sensor(address, sensor), Faults()
    kind = asked_kind(address)
    sensor = sensor if kind is None else in_unit_of(kind, sensor)
    timed = is_timed(address)
    asks = {"op": "call_service", "service": "/rosapi/topic_type", "args": {"topic": topic}}
    wants: dict[str, Any] = {"op": "subscribe", "topic": topic, "queue_length": 0}
    if kind is not None:
        wants["type"] = address.options["type"]
    greeting = [json.dumps(message) for message in ([wants] if kind is not None else [asks, wants])]
    socket = WebSocket(f"ws://{authority(address.host or '127.0.0.1', address.port or PORT)}", greeting)
    parser = RosbridgeParser(sensor, kind, faults, timed=timed)
    return ByteSource(address, sensor, socket, WholeMessages(parser.feed), faults)
