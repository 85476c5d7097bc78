"""Emulated devices on ROS: a rosbridge server, and a publisher by DDS. Both send tactile_msgs/TactileState."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.acquire.devices import dds, rosbridge
from taxelflow.acquire.ros.decode import store_of
from taxelflow.errors import AddressInvalid
from taxelflow.pipeline.live.emulators.base import POLL_S
from taxelflow.pipeline.live.emulators.devices import WebSocketServer
from taxelflow.pipeline.live.ros2_sink import Ros2Types
from taxelflow.runtime.endpoints import authority
from taxelflow.sensors.channels import plausible

if TYPE_CHECKING:
    from typing import Self

    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_TYPE = "tactile_msgs/msg/TactileState"


def _check_type(address: Address) -> None:
    """Raises AddressInvalid if a run with this URL would decode the messages as another type."""
    asked = address.options.get("type", _TYPE)
    if asked.replace("/msg/", "/") != _TYPE.replace("/msg/", "/"):
        seen = f"type={asked}, but the emulated device sends tactile_msgs/TactileState"
        raise AddressInvalid(address.url, seen, "type=tactile_msgs/TactileState, or none")


class Rosbridge(WebSocketServer):
    """Answers what the type of the topic is, and publishes to all who subscribe."""

    def __init__(self, address: Address, _sensor: Sensor) -> None:
        _check_type(address)
        super().__init__(address.host or "127.0.0.1", rosbridge.PORT if address.port is None else address.port)
        self._topic = "/" + address.path.lstrip("/")

    @property
    def url(self) -> str:
        """See `Emulator`."""
        return f"rosbridge://{authority(self._place[0], self.port)}{self._topic}"

    def greet(self, client: Any) -> None:
        """Answer until the topic is subscribed to."""
        for message in client:
            asked = msgspec.json.decode(message)
            if asked["op"] == "subscribe":
                return
            known = {"op": "service_response", "service": asked["service"], "values": {"type": _TYPE}, "result": True}
            client.send(json.dumps(known))

    def encode(self, t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        sec, nanosec = divmod(round(1e9 * t_s) or 1, 10**9)  # a stamp of 0 is one that is not set
        header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "hand"}
        message = {"header": header, "sensors": [{"name": "all", "values": values.tolist()}]}
        return msgspec.json.encode({"op": "publish", "topic": self._topic, "msg": message})


class _Publisher:
    """Publishes messages of a type on a topic of DDS."""

    def __init__(self, address: Address, topic: str, kind: Any) -> None:
        self.url = address.url
        self._topic, self._kind, self._domain = topic, kind, dds.domain_of(address)
        self._dds = dds.cyclonedds()
        self._encoded: dict[bytes, Any] = {}

    def __enter__(self) -> Self:
        participant = self._dds.domain.DomainParticipant(self._domain)
        topic = self._dds.topic.Topic(participant, self._topic, self._kind)
        self._writer = self._dds.pub.DataWriter(participant, topic, qos=dds.quality_of_service(reliable=False))
        return self

    def __exit__(self, *_details: object) -> None:
        del self._writer

    def wait(self) -> None:
        """See `Emulator`."""
        while not self._writer.get_matched_subscriptions():
            time.sleep(POLL_S)

    def encoded(self, message: Any) -> bytes:
        """A message in CDR."""
        content = bytes(message.serialize())
        self._encoded = dict([*self._encoded.items()][-1:]) | {content: message}  # the last but one may be sent late
        return content

    def send(self, message: bytes) -> bool:
        """See `Emulator`: bytes that are no message are not sent, for DDS would not."""
        found = self._encoded.get(message)
        if found is not None:
            self._writer.write(found)
        return found is not None

    def cut(self) -> None:
        """There is no connection."""


class Ros2(_Publisher):
    """Publishes on a topic of ROS 2."""

    def __init__(self, address: Address, _sensor: Sensor) -> None:
        _check_type(address)
        self._types = Ros2Types()
        super().__init__(address, f"rt/{address.need_path('ros2:/topic').lstrip('/')}", self._types.touch_type)
        if "type" not in address.options:
            self.url = f"{address.url}{'&' if '?' in address.url else '?'}type=tactile_msgs/TactileState"

    def encode(self, t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        return self.encoded(self._types.touch(t_s, {"all": plausible(values).tolist()}))


class InspireDds(_Publisher):
    """The touch topic of an Inspire hand."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        kind = dds.dds_type(store_of(dds.INSPIRE_TYPE, "", "", dds.INSPIRE.definition), dds.INSPIRE_TYPE)
        super().__init__(address, f"rt/inspire_hand/touch/{address.choice('side', ('r', 'l'))}", kind)
        counts = [sensor.layout.starts[pad + 1] - sensor.layout.starts[pad] for pad in range(sensor.layout.pad_count)]
        if len(counts) != len(dds.INSPIRE.values):
            seen = f"a scan has {len(counts)} pads, and the hand {len(dds.INSPIRE.values)}"
            raise AddressInvalid(address.url, seen, "--from a recording of inspire-rh56dftp")
        self._ends = np.cumsum(counts)[:-1]

    def encode(self, _t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        pads = np.split(np.clip(np.round(np.nan_to_num(values)), -32768, 32767).astype(np.int16), self._ends)
        fields = {name: pad.tolist() for name, pad in zip(dds.INSPIRE.values, pads, strict=True)}
        return self.encoded(self._kind(**fields))
