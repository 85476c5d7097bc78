"""Which recordings a batch is of, and where each result goes."""

from __future__ import annotations

from glob import iglob
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid, RecordingsAlike
from taxelflow.pipeline.batch.task import PARTS
from taxelflow.publish.parquet import NAMES
from taxelflow.publish.spatial import NAME as SPATIAL
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

_BAG = "metadata.yaml"


def find_recordings(words: Sequence[str], out: Path, *, folders: bool) -> dict[str, Path]:
    """Absolute paths of recordings by the name of their result, sorted.

    words: paths, patterns with `*`, `?`, `[...]` and `**`, or directories of recordings. out: directory of the results,
    which are no recordings. folders: directories are recordings with one file per pad. Raises ParameterInvalid where a
    word matches nothing, RecordingsAlike where two results would have one name.
    """
    found: dict[str, Path] = {}
    if not words:
        raise ParameterInvalid("recordings", "nothing", "name at least one path or a quoted pattern")
    for word in words:
        matches = [path for path in map(Path.absolute, _matches(word, folders=folders)) if not _is_result(path, out)]
        if not matches:
            raise ParameterInvalid("recordings", word, "match at least one recording")
        for path in matches:
            other = found.setdefault(_name(path), path)
            if other != path:
                raise RecordingsAlike(other, path, out / _name(path))
    return dict(sorted(found.items()))


def _matches(word: str, *, folders: bool) -> Iterable[Path]:
    path = Path(word)
    if path.is_dir() and not folders and not (path / _BAG).is_file():
        return sorted(_in_directory(path))
    if path.exists():
        return [path]
    return map(Path, sorted(iglob(word, recursive=True)))  # noqa: PTH207  Path.glob takes no absolute pattern


def _in_directory(directory: Path) -> Iterator[Path]:
    suffixes = {name for name in registry.names("reader") if name.startswith(".")}
    for path in directory.iterdir():
        if (path / _BAG).is_file() or (path.is_file() and path.suffix.lower() in suffixes):
            yield path


def _name(path: Path) -> str:
    return path.name if path.is_dir() else path.stem


def _is_result(path: Path, out: Path) -> bool:
    """Whether a batch wrote it: the manifest, and all in the directory of a recording, whose summary comes last."""
    if path == out or not path.is_relative_to(out):
        return False
    top = out / path.relative_to(out).parts[0]
    unfinished = path.parent == top and path.suffix == ".parquet" and path.stem in (*NAMES, SPATIAL)
    return top.name in ("manifest.csv", PARTS) or unfinished or (top / "summary.json").is_file()
