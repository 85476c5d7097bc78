"""A file whose writes wait while the disk is full, so that nothing is lost if space is freed in time."""

from __future__ import annotations

import io
import os
import stat
import time
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.errors import SinkUnusable

try:
    import fcntl
except ImportError:  # a system without locks of files
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Callable

    from _typeshed import ReadableBuffer

_RETRY_S = 0.2
"""Time between two attempts to write."""


def opened_alone(path: Path | str) -> int:
    """Descriptor of a file for writing that no other run has open. It is locked until it is closed, and not truncated.

    Raises SinkUnusable.
    """
    try:
        named_pipe = Path(path).is_fifo()  # for reading and writing, it opens without a reader
        file = os.open(path, (os.O_RDWR if named_pipe else os.O_WRONLY) | os.O_CREAT, 0o666)
    except OSError as error:
        raise SinkUnusable(str(path), error.strerror or str(error)) from error
    if fcntl is None or not stat.S_ISREG(os.fstat(file).st_mode):
        return file
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(file)
        raise SinkUnusable(str(path), "another run writes to it", "choose another file, or end that run") from error
    except OSError:  # a file system without locks
        pass
    return file


class PatientFile(io.RawIOBase):
    """A file for writing whose `write` returns when all is written; while that fails it tries again.

    A failure is reported once. From `give_up` on it tries for `grace_s` more, and then drops what it is given: `lost`
    counts these bytes.
    """

    def __init__(self, path: Path | str | int, report: Callable[[str, str], None], grace_s: float = 1.0) -> None:
        """path: of the file, or a descriptor. Raises SinkUnusable."""
        super().__init__()
        self._name = "standard output" if isinstance(path, int) else str(path)
        self._owned = not isinstance(path, int)
        self._file = path if isinstance(path, int) else opened_alone(path)
        if self._owned and stat.S_ISREG(os.fstat(self._file).st_mode):
            os.ftruncate(self._file, 0)
        self._report, self._grace_s = report, grace_s
        self._failing = False
        self._at = 0
        self._deadline = float("inf")
        self.lost = 0

    def writable(self) -> bool:
        """True."""
        return True

    def seekable(self) -> bool:
        """False: bytes are only appended."""
        return False

    def tell(self) -> int:
        """Bytes accepted so far."""
        return self._at

    def give_up(self) -> None:
        """End the waiting after `grace_s`, because the run ends."""
        self._deadline = min(self._deadline, time.monotonic() + self._grace_s)

    def write(self, content: ReadableBuffer, /) -> int:
        """Write all of it, waiting for space. Raises BrokenPipeError if a pipe has no reader any more."""
        left = memoryview(content).cast("B")
        size = len(left)
        self._at += size
        while left:
            try:
                left = left[os.write(self._file, left) :]
                if self._failing:
                    self._failing = False
                    self._report("written again", self._name)
            except BrokenPipeError:
                raise
            except OSError as error:
                if not self._failing:
                    self._report("cannot write", f"{self._name}: {error.strerror}; trying again")
                    self._failing = True
                if time.monotonic() >= self._deadline:
                    self.lost += len(left)
                    break
                time.sleep(_RETRY_S)
        return size

    def close(self) -> None:
        """Close it; what could not be written is reported."""
        if not self.closed:
            if self.lost:
                self._report("lost", f"{self.lost} bytes could not be written to {self._name}")
            if self._owned:
                os.close(self._file)
        super().close()
