"""XELA uSkin by the WebSocket of its server: `xela://HOST:PORT`.

A message is `{"message": n, "1": {"time": s, "data": "hex,hex,...", ...}, "2": ...}`, three numbers a taxel. Tested
against an emulator only.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.acquire.devices.base import Faults, WholeMessages
from taxelflow.acquire.devices.streams import STREAM_OPTIONS, ByteSource, is_timed, need_sensor
from taxelflow.acquire.devices.websocket import WebSocket
from taxelflow.runtime.endpoints import authority

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

PORT = 5000
"""Default port of XELA's server."""


class XelaParser:
    """Reads a scan a message: the numbers of all its sensors, by their numbers. timed: whether their clock is used."""

    def __init__(self, columns: int, faults: Faults, *, timed: bool = True) -> None:
        self._columns, self._faults, self._timed = columns, faults, timed

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `WholeMessages`."""
        try:
            message: dict[str, Any] = msgspec.json.decode(received, type=dict[str, Any])
            sensors = [message[key] for key in sorted(filter(str.isdecimal, message), key=int)]
            if not sensors:  # a welcome
                return []
            numbers = [int(number, 16) for one in sensors for number in one["data"].split(",")]
            t_s, values = float(sensors[0]["time"]), np.array(numbers, np.float64)
        except Exception as error:  # a damaged message may be anything
            self._faults.count("bad message", f"{type(error).__name__}: {str(error)[:80]}")
            return []
        if len(values) != self._columns or not math.isfinite(t_s):
            self._faults.count("bad message", f"{len(values)} numbers, {self._columns} expected")
            return []
        return [(t_s if self._timed else None, values)]


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`xela://HOST:PORT`. Raises AddressInvalid, SensorNeeded, ExtraMissing."""
    address.check_options(STREAM_OPTIONS)
    address.refuse_path("xela://HOST:PORT")
    sensor, faults = need_sensor(address, sensor), Faults()
    url = f"ws://{authority(address.host or '127.0.0.1', address.port or PORT)}"
    parser = XelaParser(sensor.channel_map.columns, faults, timed=is_timed(address))
    return ByteSource(address, sensor, WebSocket(url), WholeMessages(parser.feed), faults)
