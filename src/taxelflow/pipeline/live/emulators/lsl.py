"""An emulated device on Lab Streaming Layer: a stream of float64, stamped with the scans' times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.devices.lsl import linger, pylsl

if TYPE_CHECKING:
    from typing import Self

    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_LONG_S = 3600.0
"""Longest wait for a consumer."""
_ZERO_S = 1e-12
"""Stamp of a scan at 0 s: LSL replaces a stamp of 0 by the present time."""


class Lsl:
    """Sends to all who read."""

    def __init__(self, address: Address, sensor: Sensor) -> None:
        self.url = address.url
        self._name, self._columns, self._lsl = address.need_path("lsl:NAME"), sensor.channel_map.columns, pylsl(address)
        self._outlet: Any = None

    def __enter__(self) -> Self:
        rate, form = self._lsl.IRREGULAR_RATE, self._lsl.cf_double64
        info = self._lsl.StreamInfo(self._name, "Tactile", self._columns, rate, form, self.url)
        self._outlet = self._lsl.StreamOutlet(info)
        return self

    def __exit__(self, *_details: object) -> None:
        if self._outlet is not None:
            linger(self._outlet)
        self._outlet = None

    def wait(self) -> None:
        """See `Emulator`."""
        self._outlet.wait_for_consumers(_LONG_S)

    def encode(self, t_s: float, values: Floats) -> bytes:
        """See `Emulator`."""
        return np.concatenate([[t_s], values]).tobytes()

    def send(self, message: bytes) -> bool:
        """See `Emulator`: bytes that are no scan cannot be sent, for the stream has one shape."""
        if self._outlet is None:  # the cable is back
            self.__enter__()
        numbers = np.frombuffer(message).tolist() if len(message) == 8 * (self._columns + 1) else []
        if numbers:
            self._outlet.push_sample(numbers[1:], numbers[0] or _ZERO_S)
        return bool(numbers) and bool(self._outlet.have_consumers())

    def cut(self) -> None:
        """See `Emulator`."""
        self._outlet = None
