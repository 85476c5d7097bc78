"""Binary frames, `header time readings checksum`, as a sensor's file describes them."""

from __future__ import annotations

import binascii
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.acquire.devices.wrapping import WrappingClock

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.acquire.devices.base import Faults
    from taxelflow.messages import Floats
    from taxelflow.sensors.frame import Frame


class _Clock(NamedTuple):
    """A device's clock: type of its number, its units in a second, and after how many it wraps (0: never)."""

    number: str
    per_second: float
    wraps: float


_CLOCKS = {
    "uint32_ms": _Clock("u4", 1e3, 2.0**32),
    "uint32_us": _Clock("u4", 1e6, 2.0**32),
    "uint64_us": _Clock("u8", 1e6, 0.0),
    "float64_s": _Clock("f8", 1.0, 0.0),
}


def crc16(content: bytes, table: list[int]) -> int:
    """CRC-16 from FFFF, by `crc_table`."""
    crc = 0xFFFF
    for byte in content:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc


def crc_table(polynomial: int) -> list[int]:
    """(256,) of a CRC-16 that shifts right; polynomial reversed."""
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (polynomial if crc & 1 else 0)
        table.append(crc)
    return table


_MODBUS = crc_table(0xA001)

_CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "none": (0, lambda _: 0),
    "sum8": (1, lambda content: sum(content) & 0xFF),
    "xor8": (1, lambda content: reduce(xor, content, 0)),
    "sum16": (2, lambda content: sum(content) & 0xFFFF),
    "crc16-modbus": (2, lambda content: crc16(content, _MODBUS)),
    "crc16-ccitt": (2, lambda content: binascii.crc_hqx(content, 0xFFFF)),
    "crc32": (4, binascii.crc32),
}


class FrameForm:
    """Sizes and numbers of a sensor's frames."""

    def __init__(self, frame: Frame, columns: int) -> None:
        self.header = bytes.fromhex(frame.header)
        self.clock = _CLOCKS.get(frame.time)
        self.number = np.dtype(frame.type).newbyteorder(frame.order)
        self.time = np.dtype(self.clock.number).newbyteorder(frame.order) if self.clock else None
        self.time_bytes = self.time.itemsize if self.time is not None else 0
        self.check_bytes, self.checksum = _CHECKSUMS[frame.checksum]
        self.order = frame.order
        self.content_bytes = self.time_bytes + columns * self.number.itemsize
        self.size = len(self.header) + self.content_bytes + self.check_bytes

    def pack(self, t_s: float, values: Floats) -> bytes:
        """A scan as a frame; readings of integer types are rounded and limited to their range."""
        content = b""
        if self.time is not None and self.clock is not None:
            ticks = t_s * self.clock.per_second
            if self.time.kind == "u":
                ticks = float(round(ticks)) % self.clock.wraps if self.clock.wraps else float(round(ticks))
            content = np.array(ticks, self.time).tobytes()
        if self.number.kind in "iu":
            limits = np.iinfo(self.number)
            values = np.clip(np.round(np.nan_to_num(values)), limits.min, limits.max)
        content += values.astype(self.number).tobytes()
        return self.header + content + self.checksum(content).to_bytes(self.check_bytes, self.order)


class FrameParser:
    """Finds frames in a stream of bytes, and finds its way again after one that is damaged."""

    def __init__(self, frame: Frame, columns: int, faults: Faults, *, timed: bool) -> None:
        self._form, self._faults, self._timed = FrameForm(frame, columns), faults, timed
        self._clock = WrappingClock(self._form.clock.wraps if self._form.clock else 0.0)
        self.restart()

    def restart(self) -> None:
        """See `Parser`; the device's clock may have gone on all the same."""
        self._buffer = bytearray()

    def feed(self, received: bytes) -> list[tuple[float | None, Floats]]:
        """See `Parser`."""
        form, buffer = self._form, self._buffer
        buffer += received
        scans = []
        while len(buffer) >= form.size:
            at = buffer.find(form.header)
            if at != 0:
                end = at if at > 0 else len(buffer) - len(form.header) + 1
                self._faults.count("garbage between frames", f"{end} bytes", end)
                del buffer[:end]
                continue
            whole = bytes(buffer[len(form.header) : form.size])
            content, check = whole[: form.content_bytes], whole[form.content_bytes :]
            if form.checksum(content).to_bytes(form.check_bytes, form.order) != check:
                self._faults.count("wrong checksum", check.hex())
                del buffer[:1]
                continue
            if not form.check_bytes and buffer[form.size : form.size + 1] not in (b"", form.header[:1]):
                self._faults.count("half a frame", "no header follows")
                del buffer[:1]
                continue
            del buffer[: form.size]
            scans.append(self._scan(content))
        return scans

    def end(self) -> list[tuple[float | None, Floats]]:
        """See `Parser`: a part of a frame is no scan."""
        if self._buffer:
            self._faults.count("half a frame", f"{len(self._buffer)} bytes at the end")
        self.restart()
        return []

    def _scan(self, content: bytes) -> tuple[float | None, Floats]:
        form = self._form
        with np.errstate(invalid="ignore"):  # a signalling NaN is a missing reading like any other
            values = np.frombuffer(content, form.number, offset=form.time_bytes).astype(np.float64)
        if form.time is None or form.clock is None or not self._timed:
            return None, values
        ticks = float(np.frombuffer(content, form.time, 1)[0])
        return self._clock.unwrapped(ticks) / form.clock.per_second, values
