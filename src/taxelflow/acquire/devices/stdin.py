"""Lines or binary frames on standard input: `stdin:`."""

from __future__ import annotations

import os
import select
import sys
from typing import TYPE_CHECKING

from taxelflow.acquire.devices.base import PIECE_BYTES, POLL_S, Faults
from taxelflow.acquire.devices.streams import ByteSource, Ended, need_sensor, parser_of
from taxelflow.errors import SourceUnreachable

if TYPE_CHECKING:
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor


class _StandardInput:
    """The process's own input; its end ends the source."""

    patient = True
    timeout_s = 0.0

    def listen(self) -> None:
        """It is open, unless the process was started without. Raises SourceUnreachable."""
        if sys.stdin is None:
            raise SourceUnreachable("stdin:", "standard input is closed", 0.0, "send the scans through a pipe")

    def open(self) -> bool:
        """It is open."""
        return True

    def receive(self) -> bytes:
        """See `Transport`."""
        descriptor = sys.stdin.fileno()
        ready, _, _ = select.select([descriptor], [], [], POLL_S)
        if not ready:
            return b""
        try:
            received = os.read(descriptor, PIECE_BYTES)
        except OSError as error:  # it cannot be opened again
            raise SourceUnreachable("stdin:", f"{error.strerror}", 0.0, "send the scans through a pipe") from error
        if not received:
            raise Ended
        return received

    def close(self) -> None:
        """It stays open for who comes after."""

    def shut(self) -> None:
        """It stays open for who comes after."""


def read(address: Address, sensor: Sensor | None) -> ByteSource:
    """`stdin:`. Raises AddressInvalid, SensorNeeded."""
    address.check_options(("time", "format", "time-unit"))
    address.refuse_path("stdin: with the scans on standard input, or replay:FILE for a recording")
    sensor, faults = need_sensor(address, sensor), Faults()
    return ByteSource(address, sensor, _StandardInput(), parser_of(address, sensor, faults), faults)
