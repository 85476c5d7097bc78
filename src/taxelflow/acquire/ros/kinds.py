"""The table of messages: which fields of each type hold a scan. A new message type is one more entry.

Sources: ipa320/schunk_modular_robotics (schunk_sdh), ubi-agni/tactile_toolbox (tactile_msgs),
RobotnikAutomation/barrett_hand (bhand_controller), mcsix/xela_server_ros2, std_msgs.
"""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Literal

from taxelflow.runtime import registry


@dataclass(frozen=True)
class Kind:
    """A message type: its fields with stamp and readings, and its sensor."""

    types: tuple[str, ...]
    """Names `package/msg/Name` as in ROS 2, with wildcards."""
    values: tuple[str, ...]
    """Paths of the fields that hold the readings, pad by pad: a dot enters a field, `[]` iterates over a list, commas
    separate fields that are all read; `[field]` iterates in the order of that field of the items."""
    names: str = ""
    """Path of the parts' names: where they are those of the sensor's pads, they give the order."""
    stamp: str = ""
    """Path of the time: a ROS time, or a number in s. Empty: the message has none."""
    sensors: tuple[str, ...] = ()
    """Built-in sensors of this message; the first whose number of cells matches is used."""
    unit: Literal["", "Pa", "count"] = ""
    """Unit of the readings where it differs from that of the built-in sensor."""
    pads: tuple[str, ...] = ()
    """Order of the sensor's pads in the message where it differs from the sensor's."""
    definition: str = ""
    """Message definition for files without one (ROS 2 with sqlite3); `{package}` is replaced by the type's package."""
    note: str = ""
    """Remark to the user."""


_SUB = "\n" + 80 * "=" + "\nMSG: "
_SDH = ("thumb_proximal", "thumb_distal", "finger1_proximal", "finger1_distal", "finger2_proximal", "finger2_distal")

SCAN = Kind(
    types=("taxelflow_msgs/msg/Scan",),
    values=("values",),
    stamp="t_s",
    definition="float64 t_s\nfloat64[] values\n",
)
"""Message of `taxelflow convert`: exact, in the sensor's own unit and order."""

JOINT_STATE = Kind(
    types=("sensor_msgs/msg/JointState",),
    values=("position",),
    stamp="header.stamp",
    definition="std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
)
"""Joint angles, beside the scans: no sensor's message."""

KINDS = (
    SCAN,
    Kind(
        types=("schunk_sdh/msg/TactileSensor",),
        values=("tactile_matrix[].tactile_array",),
        stamp="header.stamp",
        sensors=("schunk-sdh2",),
        pads=_SDH,  # the driver's default dsa_reorder: thumb first; matrix_id counts in that order
        definition="std_msgs/Header header\n{package}/TactileMatrix[] tactile_matrix"
        + _SUB
        + "{package}/TactileMatrix\nuint32 matrix_id\nint16 cells_x\nint16 cells_y\nint16[] tactile_array\n",
    ),
    Kind(
        types=("schunk_sdh/msg/PressureArrayList",),
        values=("pressure_list[].pressure",),
        names="pressure_list[].sensor_name",
        stamp="header.stamp",
        sensors=("schunk-sdh2",),
        unit="Pa",
        pads=_SDH,
        definition="std_msgs/Header header\n{package}/PressureArray[] pressure_list"
        + _SUB
        + "{package}/PressureArray\nstring sensor_name\nuint16 cells_x\nuint16 cells_y\nfloat64[] pressure\n",
        note="pressures are read as Pa; some versions of the message use N/mm2: then give a sensor file with --sensor",
    ),
    Kind(
        types=("schunk_sdh/msg/PressureArray",),
        values=("pressure",),
        definition="string sensor_name\nuint16 cells_x\nuint16 cells_y\nfloat64[] pressure\n",
    ),
    Kind(
        types=("tactile_msgs/msg/TactileState",),
        values=("sensors[].values",),
        names="sensors[].name",
        stamp="header.stamp",
        definition="std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors\n",
    ),
    Kind(
        types=("*/msg/TactileArray",),
        values=("finger1", "finger2", "finger3", "palm"),
        stamp="header.stamp",
        sensors=("barretthand-bh280-96",),
        definition="std_msgs/Header header\nfloat32[] finger1\nfloat32[] finger2\nfloat32[] finger3\nfloat32[] palm\n",
    ),
    Kind(
        types=("*/msg/SensStream",),
        values=("sensors[sensor_pos].taxels[].x,y,z",),  # the server lists sensors as they answer
        stamp="sensors[sensor_pos].time",
        sensors=("xela-4x4",),
        definition="{package}/SensorFull[] sensors"
        + _SUB
        + "{package}/SensorFull\nuint32 message\nfloat64 time\nstring model\nuint8 sensor_pos\n"
        + "{package}/Taxel[] taxels\n{package}/Forces[] forces"
        + _SUB
        + "{package}/Taxel\nuint16 x\nuint16 y\nuint16 z"
        + _SUB
        + "{package}/Forces\nfloat32 x\nfloat32 y\nfloat32 z\n",
    ),
    Kind(
        types=tuple(
            f"std_msgs/msg/{number}MultiArray" for number in ("Float32", "Float64", "UInt16", "Int16", "UInt8")
        ),
        values=("data",),
    ),
)


def all_kinds() -> list[Kind]:
    """The table, and what other packages announce. Raises PluginBroken."""
    kinds = list(KINDS)
    for name in registry.names("message"):
        kind = registry.find("message", name)
        if not isinstance(kind, Kind):
            raise registry.broken("message", name, TypeError(f"it is a {type(kind).__name__}, not a Kind"))
        kinds.append(kind)
    return kinds


def kind_of(message_type: str) -> Kind | None:
    """The entry of a type `package/msg/Name` or `package/Name` in the table; None if it has none."""
    wanted = ros2_name(message_type)
    return next((kind for kind in all_kinds() if any(fnmatchcase(wanted, name) for name in kind.types)), None)


def ros2_name(name: str) -> str:
    """`package/Name` of ROS 1 as `package/msg/Name`."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


def known_types() -> list[str]:
    """All types of the table as `package/Name`; * stands for any package."""
    return [name.replace("/msg/", "/") for kind in all_kinds() for name in kind.types]
