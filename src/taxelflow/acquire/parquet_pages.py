"""Sizes of the pages of a Parquet file, before `pyarrow` unpacks them: it allocates what a page's header declares.

The index at the end of a file and the header before each page are structs in Thrift's compact protocol
(apache/parquet-format, parquet.thrift). They are parsed here, because `pyarrow` ends the process at a damaged index
where it is asked for the place of a column.
"""

from __future__ import annotations

import os
import struct
from typing import IO, Any

_PAGE_HEADER_BYTES = 1 << 16
"""Bytes of a page's header at most, with its statistics."""
_INDEX_BYTES = 1 << 23
"""Bytes of an index that is parsed: it takes 1 us a byte."""
_SMALL_BYTES = 20 << 20
"""Size of a file whose index must not be larger; of larger files such an index is trusted."""
_DEEPEST = 12
"""Structs and lists within each other; an index has 7."""

Pages = list[list[int]]
"""Unpacked sizes of the pages of each column of a row group."""


class _Type:
    """Types of values in the compact protocol; integers lie between BYTE and DOUBLE."""

    STOP, TRUE, FALSE, BYTE, DOUBLE, BINARY, LIST, SET, STRUCT = 0, 1, 2, 3, 7, 8, 9, 10, 12


class _Index:
    """Numbers of fields in the index: of FileMetaData, RowGroup and ColumnChunk."""

    GROUPS, COLUMNS, COLUMN = 4, 1, 3


class _Column:
    """Numbers of fields of ColumnMetaData."""

    PATH, CODEC, PACKED_TOTAL, FIRST_PAGE, DICTIONARY = 3, 4, 7, 9, 11


class _Page:
    """Numbers of fields of PageHeader."""

    UNPACKED, PACKED = 2, 3


def unpacked_pages(file: IO[bytes], columns: set[str]) -> list[Pages]:
    """Unpacked sizes of the pages of each row group, of compressed columns only; none if the index is too long.

    Raises ValueError if index or header of a page is damaged.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - 8))
    (length,) = struct.unpack("<I", file.read(4))
    if length > size - 8:
        raise ValueError("its index is damaged")
    if length > _INDEX_BYTES:
        if size <= _SMALL_BYTES:
            raise ValueError(f"its index has {length} of its {size} bytes: write it in larger row groups")
        return []
    file.seek(size - 8 - length)
    groups = _parsed(file.read(length))[0].get(_Index.GROUPS) or []
    return [_group(file, group.get(_Index.COLUMNS) or [], columns) for group in groups]


def _group(file: IO[bytes], chunks: list[Any], columns: set[str]) -> Pages:
    pages = []
    for chunk in chunks:
        column = chunk.get(_Index.COLUMN) or {}
        path = column.get(_Column.PATH) or [b""]
        if column.get(_Column.CODEC) and path[0].decode(errors="replace") in columns:
            starts = [column[field] for field in (_Column.FIRST_PAGE, _Column.DICTIONARY) if column.get(field)]
            pages.append(_sizes(file, min(starts, default=0), column.get(_Column.PACKED_TOTAL) or 0))
    return pages


def _sizes(file: IO[bytes], start: int, length: int) -> list[int]:
    """Unpacked sizes of the pages of a column."""
    sizes = []
    end = start + length
    while 0 <= start < end:
        file.seek(start)
        header, used = _parsed(file.read(min(_PAGE_HEADER_BYTES, end - start)))
        unpacked, packed = header.get(_Page.UNPACKED, -1), header.get(_Page.PACKED, -1)
        if not (isinstance(unpacked, int) and isinstance(packed, int) and unpacked >= 0 and packed >= 0):
            raise ValueError(f"a page declares {unpacked} bytes in {packed}")
        sizes.append(unpacked)
        start += used + packed
    return sizes


def _parsed(content: bytes) -> tuple[dict[int, Any], int]:
    """The struct at the start, and how many bytes it takes. Raises ValueError."""
    reader = _Compact(content)
    try:
        return reader.struct(0), reader.at
    except (IndexError, AttributeError) as error:
        raise ValueError("its index or the header of a page is damaged") from error


class _Compact:
    """Reads Thrift's compact protocol. at: position in the content. Raises IndexError at its end."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def struct(self, depth: int) -> dict[int, Any]:
        """Fields of the struct here, by number."""
        if depth > _DEEPEST:
            raise ValueError("its index is nested too deeply")
        fields: dict[int, Any] = {}
        field = 0
        while (byte := self.byte()) != _Type.STOP:
            field = field + (byte >> 4) if byte >> 4 else self.zigzag()
            fields[field] = self.value(byte & 0xF, depth)
        return fields

    def value(self, kind: int, depth: int) -> Any:
        """A number, bytes, struct or list; None for a value of another type, which is skipped."""
        if kind in (_Type.TRUE, _Type.FALSE):
            return None
        if _Type.BYTE < kind < _Type.DOUBLE:
            return self.zigzag()
        if kind == _Type.STRUCT:
            return self.struct(depth + 1)
        if kind in (_Type.LIST, _Type.SET):
            return self.items(depth + 1)
        if kind not in (_Type.BYTE, _Type.DOUBLE, _Type.BINARY):
            raise ValueError(f"its index holds a value of type {kind}")
        length = {_Type.BYTE: 1, _Type.DOUBLE: 8}.get(kind) or self.varint()
        self.at += length
        return self.content[self.at - length : self.at]

    def items(self, depth: int) -> list[Any]:
        """Items of a list or set."""
        byte = self.byte()
        count, kind = byte >> 4, byte & 0xF
        if count == 0xF:
            count = self.varint()
        if count > len(self.content):
            raise ValueError("its index is damaged")
        if kind in (_Type.TRUE, _Type.FALSE):
            self.at += count
            return []
        return [self.value(kind, depth) for _ in range(count)]

    def byte(self) -> int:
        """The next byte."""
        self.at += 1
        return self.content[self.at - 1]

    def varint(self) -> int:
        """An unsigned number, 7 bits a byte, low ones first."""
        number = shift = 0
        while (byte := self.byte()) & 0x80:
            number |= (byte & 0x7F) << shift
            shift += 7
        return number | byte << shift

    def zigzag(self) -> int:
        """A signed number."""
        number = self.varint()
        return number >> 1 ^ -(number & 1)
