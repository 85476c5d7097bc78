"""`.parquet` recordings: a column with the time and one per taxel, laid out as `Columns` says.

What `write_parquet` writes also carries sensor, masked taxels and truth, as JSON texts in the schema's metadata.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import BLOCK_SCANS, Recording
from taxelflow.acquire.columns import SECONDS_PER, Columns
from taxelflow.acquire.metadata import masked_in, sensor_in, texts_of, truth_in
from taxelflow.errors import ExtraMissing, RecordingCorrupt, RecordingTruncated, SensorNeeded, TaxelCountWrong
from taxelflow.messages import Floats, RawScans, joined
from taxelflow.sensors.catalogue import builtin_sensors

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

_REMEDY = "write it again, or copy it again whole: the end of a Parquet file says what is in it"
_PREFIX = "taxelflow."
_GROUP_SCANS = 4 * BLOCK_SCANS


def open_parquet(path: Path, sensor: Sensor | None, columns: Columns | None = None) -> Recording:
    """Open a Parquet file. Raises ExtraMissing, RecordingCorrupt, SensorNeeded, TaxelCountWrong, ParameterInvalid."""
    arrow = _arrow()
    asked = (columns or Columns()).resolved()
    try:
        with arrow.parquet.ParquetFile(path) as file:
            schema, scans = file.schema_arrow, file.metadata.num_rows
            texts = {
                key.decode().removeprefix(_PREFIX): value.decode()
                for key, value in (schema.metadata or {}).items()
                if key.startswith(_PREFIX.encode())
            }
    except Exception as error:  # whatever a file that is none makes of the parser
        raise RecordingCorrupt(path, " ".join(str(error).split()), _REMEDY) from error
    when, taxels = asked.find(path, schema.names)
    for number in taxels:
        if not _numeric(arrow, schema.types[number]):
            seen = f"column {schema.names[number]!r} holds {schema.types[number]}, not numbers"
            raise RecordingCorrupt(path, seen, "choose others with --columns.taxels")
    sensor = sensor or sensor_in(path, texts)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    if len(taxels) != sensor.wiring.columns:
        raise TaxelCountWrong(path, len(taxels), sensor.name, sensor.wiring.columns)
    names = [schema.names[number] for number in taxels]
    seconds = asked.seconds
    if when is not None and arrow.types.is_timestamp(schema.types[when]):
        seconds = SECONDS_PER[schema.types[when].unit]
    elif when is not None and not _numeric(arrow, schema.types[when]):
        seen = f"column {schema.names[when]!r} holds {schema.types[when]}, not times"
        raise RecordingCorrupt(path, seen, "choose another with --columns.time")

    def read() -> Iterator[RawScans]:
        return _read(path, None if when is None else schema.names[when], seconds, asked.rate_hz, names, scans)

    notes = () if when is not None else (f"times are counted at {asked.rate_hz:g} Hz: the log has none",)
    masked = masked_in(path, texts, sensor.layout.taxels)
    truth = truth_in(path, texts, sensor)
    return Recording(path, "parquet", sensor, read, scans=scans, masked=masked, truth=truth, notes=notes)


def write_parquet(recording: Recording, path: Path, blocks: Iterable[RawScans]) -> None:
    """Write these blocks of a recording, with sensor, masked taxels and truth. Raises ExtraMissing."""
    arrow = _arrow()
    names = ["t_s", *(f"value{number}" for number in range(recording.sensor.wiring.columns))]
    texts = {f"{_PREFIX}{name}": text for name, text in texts_of(recording).items()}
    schema = arrow.schema([(name, arrow.float64()) for name in names], metadata=texts)
    with arrow.parquet.ParquetWriter(path, schema) as writer:
        for group in _groups(blocks):
            columns = [group.t_s, *np.ascontiguousarray(group.values.T)]
            writer.write_table(arrow.table([arrow.array(column) for column in columns], schema=schema))


def _groups(blocks: Iterable[RawScans]) -> Iterator[RawScans]:
    """Larger blocks: a row group costs some bytes a column."""
    held: list[RawScans] = []
    for block in blocks:
        held.append(block)
        if sum(map(len, held)) >= _GROUP_SCANS:
            yield joined(held)
            held = []
    if held:
        yield joined(held)


def _read(
    path: Path, when: str | None, seconds: float, rate_hz: float | None, names: list[str], scans: int
) -> Iterator[RawScans]:
    arrow = _arrow()
    wanted = names if when is None else [when, *names]
    done = 0
    try:
        with arrow.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(batch_size=BLOCK_SCANS, columns=wanted):
                values = np.empty((len(batch), len(names)))
                for number, name in enumerate(names):
                    values[:, number] = _floats(batch.column(name))
                if when is None:
                    t_s = np.arange(done, done + len(batch)) / (rate_hz or np.nan)
                else:
                    t_s = _floats(batch.column(when)) * seconds
                yield RawScans(t_s, values)
                done += len(batch)
    except Exception as error:  # whatever a damaged file makes of the parser
        raise RecordingTruncated(path, done, scans, " ".join(str(error).split())) from error


def _floats(column: Any) -> Floats:
    """(rows,), NaN where there is no value."""
    import pyarrow

    if pyarrow.types.is_timestamp(column.type):
        column = column.cast(pyarrow.int64())
    numbers: Floats = column.to_numpy(zero_copy_only=False).astype(np.float64)
    return numbers


def _numeric(arrow: Any, kind: Any) -> bool:
    return bool(arrow.types.is_floating(kind) or arrow.types.is_integer(kind))


def _arrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ExtraMissing("tables", "pyarrow") from error
    return pyarrow
