"""Scans in blocks: large enough for array operations, small enough to fit in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from taxelflow.acquire.limits import BLOCK_BYTES, BLOCK_SCANS
from taxelflow.errors import RecordingError
from taxelflow.messages import RawScans, cut

Item = TypeVar("Item")
Block = TypeVar("Block")


def cut_up(scans: RawScans) -> Iterator[RawScans]:
    """Scans in memory, block by block."""
    return (cut(scans, start, min(start + BLOCK_SCANS, len(scans))) for start in range(0, len(scans), BLOCK_SCANS))


def in_blocks(
    items: Iterable[Item],
    made: Callable[[list[Item]], Block],
    weight: Callable[[Item], int],
    scans: int,
) -> Iterator[Block]:
    """Blocks of items, each built by `made`; items before a RecordingError are delivered first.

    A block has at most `scans` items, and not many more than BLOCK_BYTES. weight: bytes of an item.
    """
    block: list[Item] = []
    held = 0
    try:
        for item in items:
            block.append(item)
            held += weight(item)
            if len(block) >= scans or held >= BLOCK_BYTES:
                yield made(block)
                block, held = [], 0
    except RecordingError:
        if block:
            yield made(block)
        raise
    if block:
        yield made(block)
