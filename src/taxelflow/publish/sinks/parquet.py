"""Result tables as Parquet files, which are whole when the run ends: `parquet:DIR`."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from taxelflow.errors import SinkUnusable
from taxelflow.messages import joined
from taxelflow.publish.parquet import NAMES, ParquetTables
from taxelflow.publish.sinks.base import ResultSink, Update
from taxelflow.publish.sinks.patient import opened_alone

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from taxelflow.publish.sinks.base import Ending, Head
    from taxelflow.runtime.addresses import Address

_GROUP_S = 2.0
"""Time between row groups: small groups read slowly, large ones would hold up the end of a run."""


class ParquetSink(ResultSink):
    """slips.parquet, object.parquet and events.parquet: `.part` files, which cannot be read, until the run ends."""

    lossless = True
    gathers_s = 0.05

    def __init__(self, directory: Path) -> None:
        self._directory, self.dropped, self.unwritten = directory, 0, 0
        self.files = tuple(directory / f"{name}.parquet" for name in NAMES)
        self._parts = tuple(file.with_name(f"{file.name}.part") for file in self.files)
        self._held: list[Update] = []
        self._written_s = time.monotonic()
        with suppress(ImportError):  # that takes a second, for which no source must wait once it is open
            import pandas  # noqa: F401  pyarrow loads it with the first rows
            import pyarrow.parquet  # noqa: F401

    def open(self, head: Head) -> None:
        """See `Sink`. Raises ExtraMissing, too."""
        self._tables = ParquetTables(self._directory, head.pads, ".parquet.part")
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            self._lock = opened_alone(self._parts[0])  # pyarrow opens its files itself
            try:
                self._tables.__enter__()
            except OSError:
                os.close(self._lock)
                raise
            for older in self.files:
                older.unlink(missing_ok=True)  # what stands here after a failure is of this run
        except OSError as error:
            raise SinkUnusable(f"parquet:{self._directory}", error.strerror or str(error)) from error

    def write(self, update: Update) -> None:
        """See `Sink`."""
        self._held.append(update)
        self.unwritten += len(update)

    def tick(self) -> None:
        """See `Sink`."""
        if self._held and time.monotonic() - self._written_s > _GROUP_S:
            self._write()

    def hurry(self) -> None:
        """See `Sink`: a write to a full disk fails at once."""

    def close(self, ending: Ending) -> None:
        """See `Sink`."""
        try:
            if self._held:
                self._write()
            with self._all_or_nothing():
                self._tables.__exit__()
            if not (self.dropped or ending.failed):
                for part, file in zip(self._parts, self.files, strict=True):
                    part.replace(file)
        finally:
            os.close(self._lock)

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """A file that could not be written to its end cannot be read at all."""
        try:
            yield
        except BaseException:
            self.dropped, self.unwritten = self.unwritten, 0
            raise

    def _write(self) -> None:
        whole = joined(self._held).output
        self._held, self._written_s = [], time.monotonic()
        with self._all_or_nothing():
            self._tables.write(whole.slips, whole.slipping, whole.motions, whole.events, whole.evidence)


def write(address: Address) -> ParquetSink:
    """`parquet:DIR`. Raises AddressInvalid."""
    address.check_options(())
    return ParquetSink(address.file_path("parquet:DIR"))
