"""Topics of ROS 2 without ROS, by cyclonedds: `ros2:/topic?type=tactile_msgs/TactileState`. Experimental.

Types of messages are made from the definitions that recordings are read by. `inspire-dds:` reads the Inspire hand.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.devices.base import POLL_S, Faults, WholeMessages
from taxelflow.acquire.devices.rosbridge import asked_kind
from taxelflow.acquire.devices.streams import PATIENCE, ByteSource, is_timed, need_sensor, refuse_device_time
from taxelflow.acquire.ros.columns import columns_of
from taxelflow.acquire.ros.decode import Decoder, store_of
from taxelflow.acquire.ros.kinds import Kind, ros2_name
from taxelflow.acquire.ros.topics import Topic
from taxelflow.acquire.ros.units import in_unit_of
from taxelflow.errors import AddressInvalid, ExtraMissing

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_OPTIONS = ("time", "timeout", "domain")
"""Those of all readers: a topic is never refused, nor does it end."""
_MOST_DOMAIN = 232
"""The last domain that has ports."""
_FINGERS = ("one", "two", "three", "four", "five")
_FIELDS = (
    *(f"finger{finger}_{part}_touch" for finger in _FINGERS[:4] for part in ("tip", "top", "palm")),
    *(f"fingerfive_{part}_touch" for part in ("tip", "top", "middle", "palm")),
    "palm_touch",
)
INSPIRE_TYPE = "inspire/msg/inspire_hand_touch"
INSPIRE = Kind((INSPIRE_TYPE,), _FIELDS, definition="".join(f"int16[] {field}\n" for field in _FIELDS))


def cyclonedds() -> Any:
    """The module. Raises ExtraMissing."""
    try:
        for part in ("core", "domain", "idl", "idl.types", "pub", "qos", "sub", "topic", "util"):
            import_module(f"cyclonedds.{part}")
    except ImportError as error:
        raise ExtraMissing("ros", "cyclonedds") from error
    return import_module("cyclonedds")


def dds_type(store: Typestore, name: str, made: dict[str, Any] | None = None) -> Any:
    """The class of cyclonedds for a message `package/msg/Name` of a store of rosbags."""
    made = {} if made is None else made
    if name not in made:
        dds = cyclonedds()
        package, _, short = name.partition("/msg/")
        ros = f"{package}::msg::dds_::{short}_" if name != INSPIRE_TYPE else "inspire::inspire_hand_touch"
        fields = {field: _field_type(store, kind, made) for field, kind in store.fielddefs[name][1]}
        made[name] = dds.idl.make_idl_struct(short, ros, fields)
    return made[name]


def _field_type(store: Typestore, kind: Any, made: dict[str, Any]) -> Any:
    types = cyclonedds().idl.types
    node, detail = kind
    if node.name == "BASE":
        base = {"string": str, "bool": bool, "octet": types.uint8, "byte": types.uint8, "char": types.uint8}
        return base.get(detail[0]) or getattr(types, detail[0])
    if node.name == "NAME":
        return dds_type(store, detail, made)
    element = _field_type(store, detail[0], made)
    return types.array[element, detail[1]] if node.name == "ARRAY" else types.sequence[element]


def quality_of_service(*, reliable: bool) -> Any:
    """Of sensors' topics best effort: such a reader takes from every writer. Of results reliable: such a writer reaches
    every reader, and `ros2 topic echo` asks for it. It keeps the last messages for a slow one, and never waits for it.
    """
    policy = cyclonedds().core.Policy
    kind = policy.Reliability.Reliable(max_blocking_time=0) if reliable else policy.Reliability.BestEffort
    return cyclonedds().qos.Qos(kind, policy.History.KeepLast(64))


class DdsReader:
    """A reader of one topic; a piece is a message in CDR."""

    patient = False
    timeout_s = PATIENCE.timeout_s

    def __init__(self, domain: int, topic: str, kind: Any) -> None:
        self._dds = cyclonedds()
        self._domain, self._topic, self._kind = domain, topic, kind
        self._reader: Any = None

    def listen(self) -> None:
        """Nothing waits for a peer."""

    def open(self) -> bool:
        """See `Transport`."""
        try:
            participant = self._dds.domain.DomainParticipant(self._domain)
            topic = self._dds.topic.Topic(participant, self._topic, self._kind)
            self._reader = self._dds.sub.DataReader(participant, topic, qos=quality_of_service(reliable=False))
        except self._dds.core.DDSException as error:
            raise OSError(str(error)) from error
        return True

    def receive(self) -> bytes:
        """See `Transport`."""
        wait = self._dds.util.duration(milliseconds=1e3 * POLL_S)
        try:
            sample = next(self._reader.take_iter(timeout=wait), None)
        except self._dds.core.DDSException as error:
            raise OSError(str(error)) from error
        return b"" if sample is None or not hasattr(sample, "serialize") else bytes(sample.serialize())

    def close(self) -> None:
        """See `Transport`."""
        self._reader = None

    def shut(self) -> None:
        """See `Transport`."""
        self.close()


class CdrParser:
    """Messages of one type in CDR, by the table of message types."""

    def __init__(self, sensor: Sensor, message_type: str, kind: Kind, faults: Faults, *, timed: bool) -> None:
        self._decoder = Decoder(Topic("", message_type, None, "cdr"), kind)
        self._sensor, self._kind, self._faults, self._timed = sensor, kind, faults, timed

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `WholeMessages`."""
        try:
            (t_s, parts), named = self._decoder.one(received), self._decoder.part_names(received)
        except Exception as error:  # the parser's errors for a damaged message
            self._faults.count("bad message", f"{type(error).__name__}: {error}")
            return []
        columns = columns_of(self._sensor, self._kind, [len(part) for part in parts], named)
        if columns is None:
            seen = sum(map(len, parts))
            self._faults.count("bad message", f"{seen} values do not fit sensor {self._sensor.name!r}")
            return []
        timed = self._timed and np.isfinite(t_s) and t_s > 0
        return [(t_s if timed else None, np.concatenate(parts)[columns])]


def domain_of(address: Address) -> int:
    """The option domain, else ROS_DOMAIN_ID, else 0. Raises AddressInvalid."""
    own = os.environ.get("ROS_DOMAIN_ID") or "0"
    text = address.options.get("domain", own)
    if not (text.isdecimal() and int(text) <= _MOST_DOMAIN):
        seen = f"domain={text}" if "domain" in address.options else f"ROS_DOMAIN_ID is {own}"
        raise AddressInvalid(address.url, seen, f"?domain=NUMBER, 0 to {_MOST_DOMAIN}")
    return int(text)


def message_type(address: Address) -> tuple[str, Kind]:
    """Type and entry of the option type, which DDS needs. Raises AddressInvalid."""
    kind = asked_kind(address)
    name = ros2_name(address.options.get("type", ""))
    if kind is None:
        raise AddressInvalid(address.url, "it has no type", "?type=PACKAGE/NAME, as in ?type=tactile_msgs/TactileState")
    return name, kind


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`ros2:/topic?type=PACKAGE/NAME&domain=0`. Raises AddressInvalid, SensorNeeded, ExtraMissing."""
    address.check_options((*_OPTIONS, "type"))
    topic = address.need_path("ros2:/topic?type=tactile_msgs/TactileState")
    return _source(address, sensor, f"rt/{topic.lstrip('/')}", *message_type(address), timed=is_timed(address))


def inspire(address: Address, sensor: Sensor | None) -> ByteSource:
    """`inspire-dds:?side=r&domain=0`. Raises AddressInvalid, SensorNeeded, ExtraMissing."""
    address.check_options((*_OPTIONS, "side"))
    address.refuse_path("inspire-dds:?side=r")
    side = address.choice("side", ("r", "l"))
    refuse_device_time(address)
    return _source(address, sensor, f"rt/inspire_hand/touch/{side}", INSPIRE_TYPE, INSPIRE, timed=False)


def _source(address: Address, sensor: Sensor | None, topic: str, name: str, kind: Kind, *, timed: bool) -> ByteSource:
    sensor, faults = in_unit_of(kind, need_sensor(address, sensor)), Faults()
    reader = DdsReader(domain_of(address), topic, dds_type(store_of(name, "", "", kind.definition), name))
    parser = CdrParser(sensor, name, kind, faults, timed=timed)
    return ByteSource(address, sensor, reader, WholeMessages(parser.feed), faults)
