"""Times of scans: ISO 8601 dates, and files that hold the times of another file's scans."""

from __future__ import annotations

import re
from array import array
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.format import open_memmap

from taxelflow.acquire.limits import LONGEST_LINE, MOST_ARRAY_BYTES
from taxelflow.errors import RecordingCorrupt
from taxelflow.messages import Floats, RawScans

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_REMEDY = "give a text file with one time per line, in s or as ISO 8601, or a one-dimensional .npy, by --columns.times"


def iso_seconds(text: str) -> float:
    """Unix time in s of an ISO 8601 date and time, in UTC where it names no zone. Raises ValueError."""
    moment = datetime.fromisoformat(text.strip())
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def is_iso(text: str) -> bool:
    """Whether a field holds an ISO 8601 date and time, and not a number."""
    if _is_number(text):
        return False
    try:
        iso_seconds(text)
    except ValueError:
        return False
    return True


def read_times(path: Path, per_second: float) -> Floats:
    """(scans,) in s, of a text file (the first field of each line, after a heading if there is one) or a .npy.

    per_second: units of the file's numbers in a second. Raises RecordingCorrupt, and OSError if it does not open.
    """
    try:
        if path.stat().st_size > MOST_ARRAY_BYTES:
            raise ValueError(f"it has {path.stat().st_size} bytes")
        if path.suffix.lower() == ".npy":
            found = open_memmap(path, mode="r")
            if found.ndim != 1 or found.dtype.kind not in "fiu":
                raise ValueError(f"it holds {found.dtype} {found.shape}")
            return np.asarray(found, dtype=np.float64) / per_second
        return _text_times(path, per_second)
    except (ValueError, EOFError) as error:
        raise RecordingCorrupt(path, str(error), _REMEDY) from error


def _text_times(path: Path, per_second: float) -> Floats:
    times = array("d")
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), ""), 1):
            field = re.split(r"[,;\t]", line.strip(), maxsplit=1)[0]
            if is_iso(field):
                times.append(iso_seconds(field))
            elif field and (number > 1 or _is_number(field)):
                times.append(_time(field, number) / per_second)
    return np.array(times)


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _time(field: str, line: int) -> float:
    if not _is_number(field):
        raise ValueError(f"line {line} is {field[:40]!r}")
    return float(field)


def timed(read: Callable[[], Iterator[RawScans]], t_s: Floats, path: Path, source: Path) -> Iterator[RawScans]:
    """Blocks with these times (scans,) in place of their own. Raises RecordingCorrupt if the numbers differ."""
    done = 0
    for block in read():
        own = t_s[done : done + len(block)]
        done += len(block)
        if len(own):
            yield RawScans(own, block.values[: len(own)])
        if len(own) < len(block):
            break
    if done != len(t_s):
        seen = f"it holds {done if done < len(t_s) else f'more than {len(t_s)}'} scans, and {source} {len(t_s)} times"
        raise RecordingCorrupt(path, seen, "give the file with the times of these scans by --columns.times")
