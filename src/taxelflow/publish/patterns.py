"""Learned patterns as one compressed file, `patterns.npz`.

Arrays over patterns: pad, t_first_s, t_last_s, scans, turns; and of pattern number k: x_m_k (nx,), y_m_k (ny,),
pressure_k and std_k (ny, nx), dead_k; see `messages.LearnedPattern`.
"""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.errors import ResultMissing, written_at
from taxelflow.messages import LearnedPattern

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

NAME = "patterns.npz"
_SINGLE = ("pad", "t_first_s", "t_last_s", "scans", "turns")
_ARRAYS = ("x_m", "y_m", "pressure", "std", "dead")


def write_patterns(patterns: Sequence[LearnedPattern], path: Path) -> None:
    """Write a file that numpy reads, whole or not at all."""
    arrays: dict[str, Any] = {name: np.array([getattr(one, name) for one in patterns]) for name in _SINGLE}
    for number, one in enumerate(patterns):
        arrays |= {f"{name}_{number}": getattr(one, name) for name in _ARRAYS}
    part = path.with_name(path.name + ".part")
    with written_at(path):
        with part.open("wb") as file:
            np.savez_compressed(file, **arrays)
        part.replace(path)


def read_patterns(directory: Path) -> list[LearnedPattern]:
    """The patterns of a result, none if its method learns none. Raises ResultMissing for a file that is broken."""
    path = directory / NAME
    if not path.is_file():
        return []
    try:
        with path.open("rb") as opened, np.load(opened) as file:
            rows = zip(*(file[name].tolist() for name in _SINGLE), strict=True)
            return [
                LearnedPattern(
                    **dict(zip(_SINGLE, row, strict=True)), **{name: file[f"{name}_{k}"] for name in _ARRAYS}
                )
                for k, row in enumerate(rows)
            ]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ResultMissing(directory, f"readable {NAME} ({error})") from error
