"""Lines or binary frames over a serial line: `serial:/dev/ttyUSB0?baud=921600`, or any URL of pyserial."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from taxelflow.acquire.devices.base import POLL_S, Faults
from taxelflow.acquire.devices.streams import LINE_OPTIONS, PATIENCE, ByteSource, need_sensor, parser_of
from taxelflow.errors import ExtraMissing

try:
    from termios import error as _termios_error
except ImportError:  # Windows
    _FAULTS: tuple[type[Exception], ...] = (ValueError,)
else:
    _FAULTS = (ValueError, _termios_error)

if TYPE_CHECKING:
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

BAUD = 115200
"""Default baud rate."""


class SerialLine:
    """A serial device, opened by pyserial, which gives OSErrors for a cable that is pulled."""

    patient = False
    timeout_s = PATIENCE.timeout_s

    def __init__(self, device: str, baud: int) -> None:
        self._device, self._baud = device, baud
        self._port: Any = None
        try:
            import serial
        except ImportError as error:
            raise ExtraMissing("devices", "pyserial") from error
        self._serial: Any = serial

    def listen(self) -> None:
        """Nothing waits for a peer."""

    def open(self) -> bool:
        """See `Transport`."""
        try:
            self._port = self._serial.serial_for_url(
                self._device, baudrate=self._baud, timeout=POLL_S, exclusive=True if self._is_file else None
            )
        except _FAULTS as error:  # a URL or rate that pyserial does not know; pulled as it opened
            raise OSError(str(error.args[-1])) from error
        return True

    def receive(self) -> bytes:
        """See `Transport`."""
        try:
            waiting = self._port.in_waiting
            received: bytes = self._port.read(max(1, waiting))
        except TypeError as error:  # pyserial reads on a port that was closed under it
            raise OSError("the port was closed") from error
        return received

    def send(self, command: bytes) -> None:
        """Write to the device. Raises OSError."""
        self._port.write(command)

    def close(self) -> None:
        """See `Transport`."""
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError):  # a device that was pulled
                port.close()

    def shut(self) -> None:
        """See `Transport`."""
        self.close()

    @property
    def _is_file(self) -> bool:
        return "://" not in self._device


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`serial:DEVICE?baud=N`. Raises AddressInvalid, SensorNeeded, ExtraMissing."""
    address.check_options((*LINE_OPTIONS, "baud"))
    device = address.need_path("serial:/dev/ttyUSB0?baud=115200")
    sensor, faults = need_sensor(address, sensor), Faults()
    parser = parser_of(address, sensor, faults, joins_late=True)
    transport = SerialLine(device, round(address.number("baud", BAUD, 1)))
    return ByteSource(address, sensor, transport, parser, faults)
