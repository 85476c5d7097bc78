"""Text of variable length in an HDF5 file, read by a process of its own.

A damaged heap, where such text is stored, makes the library loop for ever, and it cannot be interrupted. Numbers and
text of fixed length are stored elsewhere.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.errors import RecordingCorrupt

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class _Most:
    """What the process may take, s."""

    wall_s: float = 20.0
    cpu_s: int = 3
    """Processor time; importing the library takes a tenth of it."""


_MOST = _Most()
_PROGRAM = """
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[4]),) * 2)
except ImportError:
    pass
import h5py
path, place, name = sys.argv[1:4]
with h5py.File(path, "r") as file:
    text = file.attrs[name] if place == "attribute" else file[name][()]
text = text.encode(errors="surrogateescape") if isinstance(text, str) else bytes(text)
sys.stdout.buffer.write(text)
"""
_REMEDY = "store it as text of fixed length (numpy.bytes_), or give --sensor"


def text_beside(path: Path, place: str, name: str) -> str:
    """One text of variable length. place: attribute or dataset. Raises RecordingCorrupt."""
    command = [sys.executable, "-c", _PROGRAM, str(path), place, name, str(_MOST.cpu_s)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_MOST.wall_s, check=False)
    except subprocess.TimeoutExpired as error:
        raise RecordingCorrupt(path, f"its text {name} cannot be read in {_MOST.wall_s:g} s", _REMEDY) from error
    if done.returncode:
        reported = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        why = (
            reported[0] if reported else f"it takes more than {_MOST.cpu_s} s of processor time, as a damaged one does"
        )
        raise RecordingCorrupt(path, f"its text {name} cannot be read: {why}", _REMEDY)
    return done.stdout.decode(errors="replace")
