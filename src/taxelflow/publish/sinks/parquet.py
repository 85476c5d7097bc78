"""Result tables as Parquet files, which are whole when the run ends: `parquet:DIR`."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from taxelflow.errors import SinkUnusable
from taxelflow.messages import joined
from taxelflow.publish.parquet import ParquetTables
from taxelflow.publish.sinks.base import ResultSink, Update

if TYPE_CHECKING:
    from taxelflow.publish.sinks.base import Ending, Head
    from taxelflow.runtime.addresses import Address

_GROUP_S = 2.0
"""Time between row groups: small groups read slowly, large ones would hold up the end of a run."""


class ParquetSink(ResultSink):
    """slips.parquet, object.parquet and events.parquet. Files of a killed run cannot be read."""

    lossless = True
    dropped = 0
    gathers_s = 0.05

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._held: list[Update] = []
        self._written_s = time.monotonic()

    def open(self, head: Head) -> None:
        """See `Sink`. Raises ExtraMissing, too."""
        self._tables = ParquetTables(self._directory, head.pads)
        with suppress(ImportError):  # pyarrow loads it with the first rows, which takes a second
            import pandas  # noqa: F401
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            self._tables.__enter__()
        except OSError as error:
            raise SinkUnusable(f"parquet:{self._directory}", error.strerror or str(error)) from error

    def write(self, update: Update) -> None:
        """See `Sink`."""
        self._held.append(update)

    def tick(self) -> None:
        """See `Sink`."""
        if self._held and time.monotonic() - self._written_s > _GROUP_S:
            self._write()

    def hurry(self) -> None:
        """See `Sink`: a write to a full disk fails at once."""

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        if self._held:
            self._write()
        self._tables.__exit__()

    def _write(self) -> None:
        whole = joined(self._held)
        self._held, self._written_s = [], time.monotonic()
        self._tables.write(whole.slips, whole.slipping, whole.motions, whole.events, whole.evidence)


def write(address: Address) -> ParquetSink:
    """`parquet:DIR`. Raises AddressInvalid."""
    address.check_options(())
    return ParquetSink(Path(address.need_path("parquet:DIR")))
