"""A file that waits for room on a full disk, so that nothing is lost if room comes in time."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.errors import SinkUnusable

if TYPE_CHECKING:
    from collections.abc import Callable

    from _typeshed import ReadableBuffer

_RETRY_S = 0.2


class PatientFile(io.RawIOBase):
    """A file for writing whose `write` returns when all is written; while that fails it tries again.

    A failure is reported once. From `give_up` on it tries for `grace_s` more, and then drops what it is given: `lost`
    counts these bytes.
    """

    def __init__(self, path: Path | str | int, report: Callable[[str, str], None], grace_s: float = 1.0) -> None:
        """path: of the file, or a descriptor. Raises SinkUnusable."""
        super().__init__()
        self._name = "standard output" if isinstance(path, int) else str(path)
        try:
            named_pipe = not isinstance(path, int) and Path(path).is_fifo()  # it opens at once, read or not
            flags = (os.O_RDWR if named_pipe else os.O_WRONLY) | os.O_CREAT | os.O_TRUNC
            self._file = path if isinstance(path, int) else os.open(path, flags, 0o666)
        except OSError as error:
            raise SinkUnusable(self._name, error.strerror or str(error)) from error
        self._report, self._grace_s = report, grace_s
        self._failing = False
        self._at = 0
        self._deadline = float("inf")
        self.lost = 0

    def writable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It only grows."""
        return False

    def tell(self) -> int:
        """Bytes taken so far."""
        return self._at

    def give_up(self) -> None:
        """The run ends: wait for room a little longer only."""
        self._deadline = min(self._deadline, time.monotonic() + self._grace_s)

    def write(self, content: ReadableBuffer, /) -> int:
        """Write all of it, waiting for room. Raises BrokenPipeError if nobody reads a pipe any more."""
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
            if self._file > 2:
                os.close(self._file)
        super().close()
