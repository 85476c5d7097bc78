"""Limits of the memory and time for a recording, checked before memory is allocated.

A compressed file may unpack to 1 GB and to 100 times its size beyond that. Tactile recordings are packed to a tenth;
files that unpack to more were made to exhaust a machine, or hold nothing. An uncompressed file is always within this
limit, so every recording can be read in some format.
"""

from __future__ import annotations

import bz2
from typing import TYPE_CHECKING, Protocol

from taxelflow.errors import RecordingTooLarge

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

FREE_BYTES, MOST_RATIO = 1 << 30, 100
"""Bytes that any file may unpack to, and the ratio to its size beyond them."""
MOST_CHUNK_BYTES = 1 << 27
"""Bytes of a chunk of a bag, unpacked: recorders write chunks of 1 to 10 MB."""
MOST_MESSAGE_BYTES = 1 << 22
"""Bytes of a message: 32,768 taxels with three axes in float64 need 0.8 MB."""
MOST_ARRAY_BYTES = 1 << 28
"""Bytes of an array that has to be read at once."""
LONGEST_LINE = 4096
"""Characters of a line of a text file that are read at once: a longer one is no line of numbers."""
BLOCK_BYTES = 1 << 25
"""Bytes of a block of scans in float64."""
BLOCK_SCANS = 1024
"""Scans in a block: large enough for array operations, small enough that blocks of many sensors fit in memory."""
_PAD_NUMBERS = 64
"""Numbers that a scan gives rise to for each pad, besides those of its taxels."""
_PIECE_BYTES = 1 << 20
"""Bytes that are unpacked between two checks of the limits."""
_REMEDY = "if the recording is that long, write it without compression, or as .mcap in several files"


def scans_per_block(sensor: Sensor) -> int:
    """Scans of a block: 1024, and fewer for a sensor so large that they would take more than BLOCK_BYTES."""
    layout = sensor.layout
    numbers = max(sensor.channel_map.columns, layout.entries + _PAD_NUMBERS * len(layout.pads))
    return max(1, min(BLOCK_SCANS, BLOCK_BYTES // (8 * numbers)))


def check_expansion(path: Path, unpacked: int, size: int | None = None) -> None:
    """Raises RecordingTooLarge if a file unpacks to more than its size explains. size: that of the file, if known."""
    size = path.stat().st_size if size is None else size
    if unpacked > FREE_BYTES + MOST_RATIO * size:
        seen = f"its {size} bytes unpack to more than {unpacked / 1e9:.1f} GB"
        raise RecordingTooLarge(path, seen, _REMEDY)


class Budget:
    """What a pass over a file may still unpack. spend raises RecordingTooLarge once that is used up."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = sum(file.stat().st_size for file in path.iterdir()) if path.is_dir() else path.stat().st_size
        self._spent = 0

    def spend(self, unpacked: int) -> None:
        """Account for more bytes."""
        self._spent += unpacked
        check_expansion(self._path, self._spent, self._size)


class _Decompressor(Protocol):
    """An incremental decompressor, as those of bz2 and lz4.frame."""

    @property
    def eof(self) -> bool:
        """Whether the end mark was reached."""

    @property
    def needs_input(self) -> bool:
        """Whether all that was given is unpacked."""

    def decompress(self, data: bytes, most: int, /) -> bytes:
        """At most `most` bytes."""


def unpack_bz2(content: bytes, path: Path, most: int = MOST_CHUNK_BYTES) -> bytes:
    """A bzip2 stream of at most `most` bytes. Raises RecordingTooLarge, OSError, EOFError."""
    return _joined(_stream(content, bz2.BZ2Decompressor()), path, len(content), most)


def unpack_lz4(content: bytes, path: Path, most: int = MOST_CHUNK_BYTES) -> bytes:
    """An LZ4 frame, as `unpack_bz2`. Raises RuntimeError for a damaged one."""
    from lz4.frame import LZ4FrameDecompressor

    return _joined(_stream(content, LZ4FrameDecompressor()), path, len(content), most)


def unpack_zstd(content: bytes, path: Path, most: int = MOST_CHUNK_BYTES) -> bytes:
    """All frames of Zstandard data, as `unpack_bz2`. Raises zstandard.ZstdError for a damaged one."""
    import zstandard

    reader = zstandard.ZstdDecompressor().stream_reader(content, read_across_frames=True)
    return _joined(iter(lambda: reader.read(_PIECE_BYTES), b""), path, len(content), most)


def _stream(content: bytes, unpack: _Decompressor) -> Iterator[bytes]:
    """Pieces of one stream; what follows its end is ignored."""
    piece = unpack.decompress(content, _PIECE_BYTES)
    yield piece
    while not unpack.eof:
        if not piece and unpack.needs_input:
            raise EOFError("compressed data ends before its end mark")
        piece = unpack.decompress(b"", _PIECE_BYTES)
        yield piece


def _joined(pieces: Iterator[bytes], path: Path, packed: int, most: int) -> bytes:
    held = bytearray()
    for piece in pieces:
        held += piece
        if len(held) > most:
            raise RecordingTooLarge(path, f"{packed} bytes in it unpack to more than {most}", _REMEDY)
    return bytes(held)
