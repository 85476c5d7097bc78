"""Which files a run reads and writes: none of them twice."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taxelflow.errors import AddressInvalid

if TYPE_CHECKING:
    from collections.abc import Mapping

    from taxelflow.acquire.devices.base import Source

_STANDARD_INPUT, _STANDARD_OUTPUT = Path("/dev/stdin"), Path("/dev/stdout")


def check_files(sinks: Mapping[str, Any], source: Source | None = None) -> None:
    """Raises AddressInvalid where two sinks, by URL, would write one file, or a sink what the source reads."""
    written = [(url, path) for url, sink in sinks.items() for path in getattr(sink, "files", ()) if _is_lasting(path)]
    for (url, path), (other, its) in combinations(written, 2):
        if _are_one(path, its):
            raise AddressInvalid(other, f"{url} writes the same file", "each sink a file of its own")
    read = None if source is None else _read_by(source)
    for url, path in written:
        if read is not None and (_are_one(path, read) or _is_inside(path, read)):
            raise AddressInvalid(url, "the run reads this file", "another file to write")


def take_output(sinks: Mapping[str, Any]) -> bool:
    """Whether one of the sinks, by URL, writes to standard output, or to the file that this is redirected to."""
    files = (path for sink in sinks.values() for path in getattr(sink, "files", ()))
    return "jsonl:-" in sinks or any(_are_one(path, _STANDARD_OUTPUT) for path in files)


def _is_lasting(path: Path) -> bool:
    """Whether a path leads to a file, or to nothing yet, and not to a pipe or a device."""
    return path.is_file() or not path.exists()


def _read_by(source: Source) -> Path | None:
    """The file or directory that a source reads, if there is one."""
    read = source.recording.source
    if isinstance(read, Path):
        return read
    return _STANDARD_INPUT if read.startswith("stdin:") and _STANDARD_INPUT.is_file() else None


def _are_one(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file, by links as well."""
    return one.resolve() == other.resolve() or (one.exists() and other.exists() and one.samefile(other))


def _is_inside(path: Path, directory: Path) -> bool:
    """Whether a file that exists belongs to a directory, such as a bag."""
    return path.exists() and directory.is_dir() and directory.resolve() in path.resolve().parents
