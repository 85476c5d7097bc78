"""Inspire RH56DFTP by Modbus TCP: `inspire-modbus://HOST:6000?rate=50`.

Readings are int16 in the holding registers from 3000 on, whose addresses count bytes. They are read pad by pad, as the
maker's library does: no source states that a hand answers a request for parts of two pads. Tested against an emulator
only.
"""

from __future__ import annotations

import logging
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.devices.base import POLL_S, Faults, WholeMessages
from taxelflow.acquire.devices.streams import PATIENCE, STREAM_OPTIONS, ByteSource, need_sensor, refuse_device_time
from taxelflow.errors import ExtraMissing, TaxelCountWrong

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True)
class _Modbus:
    """The registers of a hand."""

    port: int = 6000
    """Default port."""
    first: int = 3000
    """First register of the readings."""
    step: int = 2
    """Step of the addresses per reading."""


MODBUS = _Modbus()
PADS = 4 * (9, 96, 80) + 2 * (9, 96) + (112,)
"""Readings of each pad: tip, top and palm of four fingers; tip, top, middle and palm of the thumb; the palm. Modbus
gives up to 125 in one answer.
"""


class ModbusHand:
    """Reads all registers, again and again: a piece is a scan."""

    patient = True
    timeout_s = PATIENCE.timeout_s

    def __init__(self, host: str, port: int, values: int, rate_hz: float) -> None:
        try:
            from pymodbus.client import ModbusTcpClient
            from pymodbus.exceptions import ModbusException
        except ImportError as error:
            raise ExtraMissing("devices", "pymodbus") from error
        self._client: Any = ModbusTcpClient(host, port=port, timeout=1.0, retries=1)
        self._fault = ModbusException
        self._values, self._period_s = values, 1.0 / rate_hz
        self._due_s = 0.0

    def listen(self) -> None:
        """Nothing waits for a peer."""

    def open(self) -> bool:
        """See `Transport`."""
        with _unheard():
            if not self._client.connect():
                raise ConnectionError("no Modbus server answers")
        return True

    def receive(self) -> bytes:
        """See `Transport`. A scan is read in one call, its pads one after the other."""
        left = self._due_s - time.monotonic()
        if left > POLL_S:
            time.sleep(POLL_S)
            return b""
        time.sleep(max(0.0, left))
        self._due_s = max(self._due_s, time.monotonic() - self._period_s) + self._period_s
        registers: list[int] = []
        for count in PADS:
            if len(registers) == self._values:
                break
            registers += self._read(len(registers), min(count, self._values - len(registers)))
        return np.array(registers, np.uint16).tobytes()

    def _read(self, first: int, count: int) -> list[int]:
        """Readings from a first one on. Raises ConnectionError."""
        try:
            with _unheard():
                answer = self._client.read_holding_registers(MODBUS.first + MODBUS.step * first, count=count)
        except self._fault as error:
            raise ConnectionError(str(error)) from error
        if answer.isError():
            raise ConnectionError(f"the hand answers {answer}")
        registers: list[int] = answer.registers
        if len(registers) != count:
            raise ConnectionError(f"the hand has {first + len(registers)} of {self._values} readings")
        return registers

    def close(self) -> None:
        """See `Transport`."""
        self._client.close()

    def shut(self) -> None:
        """See `Transport`."""
        self._client.close()


@contextmanager
def _unheard() -> Iterator[None]:
    """Without what the library logs in this thread: each fault is reported here, once."""
    own, library = threading.get_ident(), logging.getLogger("pymodbus.logging")

    def of_others(record: logging.LogRecord) -> bool:
        return record.thread != own

    library.addFilter(of_others)
    try:
        yield
    finally:
        library.removeFilter(of_others)


def _scan_of(received: bytes) -> list[tuple[float | None, Floats]]:
    """See `WholeMessages`: a piece is a scan of int16."""
    return [(None, np.frombuffer(received, np.int16).astype(np.float64))]


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`inspire-modbus://HOST:PORT?rate=50`. Raises AddressInvalid, SensorNeeded, TaxelCountWrong,
    ExtraMissing.
    """
    address.check_options((*STREAM_OPTIONS, "rate"))
    address.refuse_path("inspire-modbus://HOST")
    refuse_device_time(address)
    sensor = need_sensor(address, sensor)
    if sensor.channel_map.columns not in accumulate(PADS):  # all pads, or the first ones
        raise TaxelCountWrong("the hand", sum(PADS), sensor.name, sensor.channel_map.columns)
    rate_hz = address.number("rate", 50.0, 0.1)
    hand = ModbusHand(address.host or "127.0.0.1", address.port or MODBUS.port, sensor.channel_map.columns, rate_hz)
    return ByteSource(address, sensor, hand, WholeMessages(_scan_of), Faults())
