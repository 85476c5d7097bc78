"""TOML from any source: its size is checked before it is read, and every fault is a ValueError of one kind."""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

MOST_BYTES = 4 << 20
"""Size of a sensor's text at most: 32,768 taxels with gain and delay need 1.5 MB, and 4 MB take 5 s to parse."""
_MOST_PARTS = 32
"""Parts of a dotted key at most: the time that `tomllib` takes grows with the square of their number."""
_ENDS_KEY = re.compile(rb"[=,\[\]{}\n]")


def read_limited(path: Path) -> bytes:
    """The content of a regular file. Raises ValueError if it is not one or larger than MOST_BYTES, and OSError."""
    if path.exists() and not path.is_file():
        raise ValueError("it is not a regular file")
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(f"it has {path.stat().st_size} bytes, and may have {MOST_BYTES}")
    return content


def parse_toml(content: bytes) -> dict[str, Any]:
    """The mapping in TOML text, which may begin with the byte order mark of Windows' editors.

    Raises ValueError: syntax, not UTF-8, too large, or nested too deeply.
    """
    if len(content) > MOST_BYTES:
        raise ValueError(f"it has {len(content)} bytes, and may have {MOST_BYTES}")
    parts = 0
    for piece in content.split(b"."):
        parts = 0 if not piece or _ENDS_KEY.search(piece) else parts + 1
        if parts > _MOST_PARTS:
            raise ValueError(f"a key has more than {_MOST_PARTS} parts")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except RecursionError as error:
        raise ValueError("its tables or lists are nested too deeply") from error
