"""Schunk SDH-2, the Weiss DSACON32m on its serial line: `dsa:/dev/ttyUSB0`.

A frame is AA AA AA, number, length (uint16), payload, CRC-16, little-endian. Tested against an emulator only; no source
states the polynomial of the checksum, so it is an option.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from enum import IntEnum, IntFlag
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.devices.base import Faults
from taxelflow.acquire.devices.frames import crc16, crc_table
from taxelflow.acquire.devices.serial import BAUD, SerialLine
from taxelflow.acquire.devices.streams import STREAM_OPTIONS, ByteSource, is_timed
from taxelflow.acquire.devices.wrapping import WrappingClock
from taxelflow.errors import AddressInvalid
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from taxelflow.messages import Floats
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.layout import Indices, Layout
    from taxelflow.sensors.sensor import Sensor

PREAMBLE = b"\xaa\xaa\xaa"


class Message(IntEnum):
    """Identifiers of the controller's messages."""

    SCAN = 0x00
    ACQUIRE = 0x03
    """The request for scans."""


class Flag(IntFlag):
    """Flags of a scan, and of the request for scans."""

    RUN_LENGTHS = 0x01
    """The readings are run-length encoded."""
    CONTINUOUS = 0x80
    """Scans are sent one after the other."""


SCAN_HEAD = struct.Struct("<IB")
"""What a scan begins with: the time in ms, and flags."""
_LONGEST_REPLY = 256
"""Bytes at most of a message that is no scan."""
POLYNOMIAL = "8408"
"""CRC-16-CCITT, reversed: an assumption."""
_MOST = 0xFFFF
"""Largest number of 16 bits."""
_CLOCK_MS = 2.0**32
"""Range of the controller's clock, 49.7 days."""
_RATE = 30
"""Default scan rate, Hz."""


def frame(number: int, payload: bytes, table: list[int]) -> bytes:
    """A frame, with a checksum over number, length and payload; without payload it has none."""
    content = struct.pack("<BH", number, len(payload)) + payload
    return PREAMBLE + content + (struct.pack("<H", crc16(content, table)) if payload else b"")


def cells_of(layout: Layout) -> tuple[Indices, int]:
    """(taxels,): cell of a frame that each taxel is read from, pad after pad with missing cells; number of cells."""
    cells, start = [], 0
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        rows, cols = layout.shapes[pad]
        cells.append(start + layout.row[own] * cols + layout.col[own])
        start += rows * cols
    return np.concatenate(cells), start


class DsaParser:
    """Finds frames with scans, also after one that is damaged. timed: whether their clock is used."""

    def __init__(self, layout: Layout, faults: Faults, polynomial: int, *, timed: bool = True) -> None:
        self._timed = timed
        self._taxel_cells, self._cells = cells_of(layout)
        self._faults, self._table = faults, crc_table(polynomial)
        self._longest = max(SCAN_HEAD.size + 2 * self._cells, _LONGEST_REPLY)  # scans that follow would wait for more
        self._clock = WrappingClock(_CLOCK_MS)
        self.restart()

    def restart(self) -> None:
        """See `Parser`; the device's clock may have gone on all the same."""
        self._buffer = bytearray()

    def end(self) -> list[tuple[float | None, Floats]]:
        """See `Parser`: a part of a frame is no scan."""
        self.restart()
        return []

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `Parser`."""
        self._buffer += received
        scans: list[tuple[float | None, Floats]] = []
        while (found := self._next()) is not None:
            number, payload = found
            if number != Message.SCAN:
                continue
            scan = self._scan(payload)
            if scan is None:
                self._faults.count("bad frame", f"{len(payload)} bytes are not {self._cells} cells")
            else:
                scans.append(scan)
        return scans

    def _next(self) -> tuple[int, bytes] | None:
        """Number and payload of the next whole frame; None if none is there yet."""
        buffer = self._buffer
        while True:
            at = buffer.find(PREAMBLE)
            skipped = at if at >= 0 else max(0, len(buffer) - len(PREAMBLE) + 1)
            if skipped:
                self._faults.count("garbage between frames", f"{skipped} bytes", skipped)
                del buffer[:skipped]
            if at < 0 or len(buffer) < 6:
                return None
            number, size = struct.unpack_from("<BH", buffer, 3)
            if size > self._longest:
                self._faults.count("bad frame", f"a length of {size}, {self._longest} at most of {self._cells} cells")
                del buffer[:1]
                continue
            whole = 6 + size + (2 if size else 0)
            if len(buffer) < whole:
                return None
            payload = bytes(buffer[6 : 6 + size])
            check = int.from_bytes(buffer[6 + size : whole], "little")
            if size and crc16(bytes(buffer[3 : 6 + size]), self._table) != check:
                self._faults.count("wrong checksum", f"{check:04x}")
                del buffer[:1]
                continue
            del buffer[:whole]
            return number, payload

    def _scan(self, payload: bytes) -> tuple[float | None, Floats] | None:
        if len(payload) < SCAN_HEAD.size or len(payload) % 2 == 0:
            return None
        t_ms, flags = SCAN_HEAD.unpack_from(payload)
        words = np.frombuffer(payload, "<u2", offset=SCAN_HEAD.size)
        if flags & Flag.RUN_LENGTHS:
            words = np.repeat(words & 0xFFF, words >> 12)
        if len(words) != self._cells:
            return None
        t_s = self._clock.unwrapped(float(t_ms)) / 1e3 if self._timed else None
        return t_s, words[self._taxel_cells].astype(np.float64)


class _DsaLine(SerialLine):
    """Asks for scans when it has opened."""

    def __init__(self, device: str, command: bytes) -> None:
        super().__init__(device, BAUD)
        self._command = command

    def open(self) -> bool:
        """See `Transport`."""
        super().open()
        self.send(self._command)
        return True


def connect(address: Address, sensor: Sensor | None) -> ByteSource:
    """`dsa:DEVICE?rate=30&crc=8408`. Raises AddressInvalid, ExtraMissing."""
    address.check_options((*STREAM_OPTIONS, "rate", "crc"))
    device = address.need_path("dsa:/dev/ttyUSB0")
    sensor, faults = sensor or load_sensor("schunk-sdh2"), Faults()
    polynomial = polynomial_of(address)
    payload = struct.pack("<BH", Flag.CONTINUOUS | Flag.RUN_LENGTHS, round(address.number("rate", _RATE, 1, _MOST)))
    line = _DsaLine(device, frame(Message.ACQUIRE, payload, crc_table(polynomial)))
    parser = DsaParser(sensor.layout, faults, polynomial, timed=is_timed(address))
    return ByteSource(address, sensor, line, parser, faults)


def polynomial_of(address: Address) -> int:
    """The option crc, a reversed polynomial in hexadecimal. Raises AddressInvalid."""
    text = address.options.get("crc", POLYNOMIAL)
    with suppress(ValueError):
        if 0 < (polynomial := int(text, 16)) <= _MOST:
            return polynomial
    raise AddressInvalid(address.url, f"crc={text}", "crc=HEX, a reversed polynomial of 16 bits such as 8408")
