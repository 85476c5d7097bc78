"""Bags that tests write with rosbags, of every message in the table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from taxelflow.acquire.ros.kinds import kind_of
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from pathlib import Path

    from rosbags.typesys.store import Typestore

EPOCH_S = 1_700_000_000
STORAGES = ("ros1", "sqlite3", "mcap")
SCANS = 12
SDH = "schunk_sdh/msg/TactileSensor"
SDH_CELLS = [84, 78, 84, 78, 84, 78]
PLAIN = load_sensor("grid:1x4@4mm")
ROWS = np.arange(40.0).reshape(10, 4)
_RANDOM = np.random.default_rng(3)


def scans_of(*cells: int, scans: int = SCANS) -> list[list[Any]]:
    """Random readings: per scan one array per part, with `cells` elements."""
    return [[_RANDOM.integers(0, 4000, n) for n in cells] for _ in range(scans)]


def bag_of(folder: Path, storage: str = "ros1") -> Path:
    return folder / ("a.bag" if storage == "ros1" else "bag")


def plain(cells: int) -> Sensor:
    """One row of taxels, in counts."""
    return Sensor("plain", "count", (Pad("pad", 1, cells, (0.004, 0.004)),))


def store_of(message_type: str, stores: Stores = Stores.ROS2_HUMBLE) -> Typestore:
    store = get_typestore(stores)
    kind = kind_of(message_type)
    if kind is not None and message_type not in store.fielddefs:
        text = kind.definition.replace("{package}", message_type.split("/", maxsplit=1)[0])
        store.register(get_types_from_msg(text, message_type))
    return store


def header(store: Typestore, stamp_s: float) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](sec=int(stamp_s), nanosec=round(stamp_s % 1 * 1e9))
    kind = store.types["std_msgs/msg/Header"]
    return kind(seq=7, stamp=time, frame_id="x") if "seq" in kind.__annotations__ else kind(stamp=time, frame_id="x")


def message(store: Typestore, message_type: str, stamp_s: float, parts: list[Any]) -> Any:  # noqa: PLR0911 - one per type
    """A message whose pads hold these readings."""
    package, _, name = message_type.split("/")

    def make(sub: str, **values: Any) -> Any:
        return store.types[f"{package}/msg/{sub}"](**values)

    if name == "TactileSensor":
        matrices = [
            make(
                "TactileMatrix",
                matrix_id=n,
                cells_x=6,
                cells_y=len(part) // 6,
                tactile_array=np.asarray(part, np.int16),
            )
            for n, part in enumerate(parts)
        ]
        return make(name, header=header(store, stamp_s), tactile_matrix=matrices)
    if name.startswith("PressureArray"):
        arrays = [
            make(
                "PressureArray",
                sensor_name=f"pad{n}",
                cells_x=6,
                cells_y=len(part) // 6,
                pressure=np.asarray(part, "f8"),
            )
            for n, part in enumerate(parts)
        ]
        return make(name, header=header(store, stamp_s), pressure_list=arrays) if name.endswith("List") else arrays[0]
    if name == "TactileState":
        channel = store.types["sensor_msgs/msg/ChannelFloat32"]
        named = parts.items() if isinstance(parts, dict) else ((f"pad{n}", part) for n, part in enumerate(parts))
        sensors = [channel(name=name, values=np.asarray(part, np.float32)) for name, part in named]
        return make(name, header=header(store, stamp_s), sensors=sensors)
    if name == "TactileArray":
        fingers = {key: np.asarray(part, np.float32) for key, part in zip(FINGERS, parts, strict=True)}
        return make(name, header=header(store, stamp_s), **fingers)
    if name == "SensStream":
        sensors = [
            make(
                "SensorFull",
                message=int(100 * stamp_s) % 2**32,
                time=stamp_s,
                model="uSPa44",
                sensor_pos=n,
                taxels=[make("Taxel", x=int(x), y=int(y), z=int(z)) for x, y, z in np.reshape(part, (-1, 3))],
                forces=[],
            )
            for n, part in enumerate(parts, 1)
        ]
        return make(name, sensors=sensors)
    if name.endswith("MultiArray"):
        layout = make("MultiArrayLayout", dim=[], data_offset=0)
        return make(name, layout=layout, data=np.asarray(parts[0], MULTI[name]))
    if name == "Touch":
        return make(name, header=header(store, stamp_s), readings=np.asarray(parts[0], np.float32))
    if name == "String":
        return make(name, data=str(parts))
    raise NotImplementedError(message_type)


FINGERS = ("finger1", "finger2", "finger3", "palm")
MULTI = {"Float32MultiArray": "f4", "Float64MultiArray": "f8", "UInt16MultiArray": "u2"}


def write_bag(
    path: Path,
    topics: dict[str, tuple[str, list[list[Any]]]],
    *,
    storage: str = "ros1",
    stamps_s: Any = None,
    period_s: float = 0.01,
    defined: bool = True,
) -> Path:
    """A bag with these topics: name -> type, and per message the readings per pad.

    storage: ros1, sqlite3 or mcap (a ROS 2 directory, whose storage file may be read alone). stamps_s: of the headers,
    if not those of receipt less 5 ms. defined: False leaves out the messages' text, as old ROS 2 recorders do.
    """
    writer: Any
    if storage == "ros1":
        writer = Writer1(path)
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    with writer:
        for name, (message_type, scans) in topics.items():
            store = store_of(message_type, Stores.ROS1_NOETIC if storage == "ros1" else Stores.ROS2_HUMBLE)
            link = writer.add_connection(name, message_type, typestore=store)
            for number, parts in enumerate(scans):
                received_s = EPOCH_S + period_s * number
                stamp_s = received_s - 0.005 if stamps_s is None else stamps_s[number]
                content_of = message(store, message_type, stamp_s, parts)
                content = (store.serialize_ros1 if storage == "ros1" else store.serialize_cdr)(content_of, message_type)
                writer.write(link, EPOCH_S * 10**9 + round(1e9 * period_s * number), content)
    if not defined:
        forget_definitions(path)
    return path


def forget_definitions(path: Path) -> None:
    import apsw

    with apsw.Connection(str(next(path.glob("*.db3")))) as database:
        database.execute("DELETE FROM message_definitions")


def write_mcap_file(
    path: Path, schema: tuple[str, str, str], encoding: str, contents: list[bytes], **options: object
) -> Path:
    """A file with one topic; schema: name, encoding, text."""
    with path.open("wb") as file:
        writer = McapWriter(file, **options)  # type: ignore[arg-type]
        writer.start()
        number = writer.register_schema(schema[0], schema[1], schema[2].encode())
        channel = writer.register_channel("/touch", encoding, number)
        for k, content in enumerate(contents):
            at_ns = EPOCH_S * 10**9 + k * 10**7
            writer.add_message(channel, at_ns, content, at_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
