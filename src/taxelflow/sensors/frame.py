"""A sensor's binary frames as its file describes them: header, time, readings, checksum."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

FrameNumber = Literal["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"]
FrameClock = Literal["none", "uint32_ms", "uint32_us", "uint64_us", "float64_s"]
Checksum = Literal["none", "sum8", "xor8", "sum16", "crc16-modbus", "crc16-ccitt", "crc32"]


class Frame(Struct, frozen=True, forbid_unknown_fields=True):
    """A frame is header, time, readings, checksum, without gaps. The checksum is over time and readings."""

    header: Annotated[str, Meta(pattern="^([0-9A-Fa-f]{2}){1,8}$")]
    """Bytes that begin a frame, in hexadecimal: AA55."""
    type: FrameNumber = "uint16"
    """Of a reading."""
    order: Literal["little", "big"] = "little"
    """Of the bytes of all numbers."""
    time: FrameClock = "none"
    """The device's clock, which may wrap; none: scans have the time of their arrival."""
    checksum: Checksum = "none"
    """sum8, xor8: one byte; sum16: sum of the bytes, in two; crc16-modbus, crc16-ccitt (polynomial 1021, start FFFF),
    crc32 (as in zlib)."""
