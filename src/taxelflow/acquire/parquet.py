"""`.parquet` recordings: a column with the time and one per taxel, in the structure of `Columns`, or a column that
holds a list of all taxels in each row.

Columns named `joint:NAME` hold joint angles in rad.
Files by `write_parquet` also hold sensor, masked taxels and truth, as JSON texts in the schema's metadata.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.column_pads import check_pads
from taxelflow.acquire.columns import JOINT, PER_SECOND, Columns
from taxelflow.acquire.joints import joints_of
from taxelflow.acquire.limits import BLOCK_SCANS, MOST_ARRAY_BYTES, Budget, check_expansion, scans_per_block
from taxelflow.acquire.metadata import check_joint_names, joints_text_in, masked_in, sensor_in, texts_of, truth_in
from taxelflow.acquire.parquet_pages import Pages, unpacked_pages
from taxelflow.acquire.table_remedies import fewer_taxels
from taxelflow.acquire.times import iso_seconds, read_times, timed
from taxelflow.errors import (
    ExtraMissing,
    RecordingCorrupt,
    RecordingError,
    RecordingTooLarge,
    RecordingTruncated,
    SensorNeeded,
    TaxelCountWrong,
)
from taxelflow.messages import Floats, Joints, RawScans, joined
from taxelflow.sensors.catalogue import builtin_sensors

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from taxelflow.sensors.sensor import Sensor

_REMEDY = "write or copy it again: a Parquet file is readable only with its end"
_PREFIX = "taxelflow."
_GROUP_SCANS = 4 * BLOCK_SCANS
"""Scans in a row group: each group adds some bytes per column."""


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
    except Exception as error:  # the parser's errors for a file that is not Parquet
        raise RecordingCorrupt(path, " ".join(str(error).split()), _REMEDY) from error
    table = _table(path, schema, asked)
    sensor = sensor or sensor_in(path, texts)
    if sensor is None:
        raise SensorNeeded(path, builtin_sensors())
    table = _fitted(table, schema, sensor)
    if not table.listed:
        check_pads(path, table.taxels, asked, sensor)
    check_expansion(path, 8 * scans * (1 + table.width + len(table.joints)))
    notes = (
        () if asked.rate_hz is None else (f"times computed from the rate of {asked.rate_hz:g} Hz: the log has none",)
    )
    masked = masked_in(path, texts, sensor.layout.taxels)
    truth = truth_in(path, texts, sensor)
    return Recording(
        path,
        "parquet",
        sensor,
        lambda: _timed(table, asked, scans, scans_per_block(sensor)),
        scans=scans,
        masked=masked,
        truth=truth,
        joints=joints_text_in(path, texts) or _joints(table, asked, scans),
        notes=notes,
    )


@dataclass(frozen=True, slots=True)
class _Table:
    """Names of the columns that are read. per_second: units of its times. rate_hz: of a file without times.
    listed: numbers in each row of the one column, a list; 0 where each taxel has a column.
    """

    path: Path
    time: str | None
    taxels: tuple[str, ...]
    joints: tuple[str, ...]
    per_second: float
    rate_hz: float
    listed: int = 0

    @property
    def width(self) -> int:
        """Numbers of a scan."""
        return self.listed or len(self.taxels)


def _fitted(table: _Table, schema: Any, sensor: Sensor) -> _Table:
    """Raises TaxelCountWrong where a scan cannot have as many numbers as the sensor."""
    wanted = sensor.channel_map.columns
    kind = schema.types[schema.names.index(table.taxels[0])]
    if _item(_arrow(), kind) is not None:  # of lists without a fixed length, each is checked as it is read
        length = getattr(kind, "list_size", wanted)
        if length != wanted:
            remedy = f"column {table.taxels[0]!r} holds lists of {length}; describe the sensor that sent them"
            raise TaxelCountWrong(table.path, length, sensor.name, wanted, remedy)
        return replace(table, listed=wanted)
    if len(table.taxels) != wanted:
        chosen = [schema.names.index(name) for name in table.taxels]
        remedy = fewer_taxels(schema.names, chosen, wanted)
        raise TaxelCountWrong(table.path, len(chosen), sensor.name, wanted, remedy)
    return table


def _item(arrow: Any, kind: Any) -> Any:
    """Type of the items of a list; None for another type."""
    types = arrow.types
    is_list = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    return kind.value_type if is_list else None


def _table(path: Path, schema: Any, asked: Columns) -> _Table:
    """The columns to read, checked against the file's schema. Raises RecordingCorrupt."""
    arrow = _arrow()
    time, taxels = asked.find(path, schema.names)
    angles = [number for number, name in enumerate(schema.names) if name.startswith(JOINT)]
    for number in (*taxels, *angles):
        kind, name = schema.types[number], schema.names[number]
        item = None if number in angles else _item(arrow, kind)
        if item is not None and _numeric(arrow, item):
            if len(taxels) == 1:
                continue
            seen = f"column {name!r} holds lists, and there are {len(taxels)} columns of taxels"
            raise RecordingCorrupt(path, seen, f"choose it alone, with --columns.taxels {name!r}, or leave it out")
        if not (_numeric(arrow, kind) or arrow.types.is_null(kind)):  # null: of a taxel that was never read
            seen = f"column {name!r} holds {kind}, not numbers"
            remedy = "store angles in rad" if number in angles else "choose others with --columns.taxels"
            raise RecordingCorrupt(path, seen, remedy)
    per_second = asked.per_second
    if time is not None and arrow.types.is_timestamp(schema.types[time]):
        per_second = PER_SECOND[schema.types[time].unit]
    elif time is not None and arrow.types.is_string(schema.types[time]):
        per_second = 1.0
    elif time is not None and not _numeric(arrow, schema.types[time]):
        seen = f"column {schema.names[time]!r} holds {schema.types[time]}, not times"
        raise RecordingCorrupt(path, seen, "choose another with --columns.time")
    names, joints = (tuple(schema.names[number] for number in chosen) for chosen in (taxels, angles))
    check_joint_names(path, [name.removeprefix(JOINT) for name in joints])
    return _Table(
        path, None if time is None else schema.names[time], names, joints, per_second, asked.rate_hz or np.nan
    )


def _joints(table: _Table, asked: Columns, scans: int) -> Joints | None:
    """Joint angles before an error, which reading the scans finds; None without columns of any."""
    if not table.joints:
        return None
    found: list[RawScans] = []
    with suppress(RecordingError):
        found.extend(_timed(replace(table, taxels=table.joints, listed=0), asked, scans, BLOCK_SCANS))
    if not found:
        return None
    held = joined(found)
    return joints_of([name.removeprefix(JOINT) for name in table.joints], held.t_s, held.values)


def write_parquet(recording: Recording, path: Path, blocks: Iterable[RawScans]) -> None:
    """Write blocks of a recording, with sensor, masked taxels and truth. Raises ExtraMissing."""
    arrow = _arrow()
    names = ["t_s", *(f"value{number}" for number in range(recording.sensor.channel_map.columns))]
    texts = {f"{_PREFIX}{name}": text for name, text in texts_of(recording).items()}
    schema = arrow.schema([(name, arrow.float64()) for name in names], metadata=texts)
    with arrow.parquet.ParquetWriter(path, schema) as writer:
        for group in _groups(blocks):
            columns = [group.t_s, *np.ascontiguousarray(group.values.T)]
            writer.write_table(arrow.table([arrow.array(column) for column in columns], schema=schema))


def _groups(blocks: Iterable[RawScans]) -> Iterator[RawScans]:
    """Blocks joined to the size of a row group."""
    held: list[RawScans] = []
    for block in blocks:
        held.append(block)
        if sum(map(len, held)) >= _GROUP_SCANS:
            yield joined(held)
            held = []
    if held:
        yield joined(held)


def _timed(table: _Table, asked: Columns, scans: int, block: int) -> Iterator[RawScans]:
    if asked.times is None:
        return _read(table, scans, block)
    return timed(lambda: _read(table, scans, block), read_times(asked.times, asked.per_second), table.path, asked.times)


def _read(table: _Table, scans: int, block: int) -> Iterator[RawScans]:
    arrow = _arrow()
    columns = [*table.taxels] if table.time is None else [table.time, *table.taxels]
    done = 0
    try:
        with arrow.parquet.ParquetFile(table.path) as file:
            for batch in _batches(file, table.path, columns, block):
                yield _scans(table, batch, done)
                done += len(batch)
    except RecordingError:
        raise
    except Exception as error:  # the parser's errors for a damaged file
        raise RecordingTruncated(table.path, done, scans, " ".join(str(error).split())) from error


def _batches(file: Any, path: Path, columns: list[str], block: int) -> Iterator[Any]:
    """Batches of at most `block` rows; each row group is checked first."""
    with path.open("rb") as content:
        pages = unpacked_pages(content, set(columns))
    if pages and len(pages) != file.num_row_groups:
        raise ValueError("its index is damaged")
    budget = Budget(path)
    for group in range(file.num_row_groups):
        if pages:
            _check_pages(path, pages[group], budget)
        yield from file.iter_batches(batch_size=block, row_groups=[group], columns=columns)


def _check_pages(path: Path, pages: Pages, budget: Budget) -> None:
    """Refuse a row group whose pages unpack to too much. Raises RecordingTooLarge."""
    budget.spend(sum(map(sum, pages)))
    largest = sum(max(column, default=0) for column in pages)
    if largest > MOST_ARRAY_BYTES:
        seen = f"the largest pages of a row group unpack to {largest} bytes, which have to be held together"
        raise RecordingTooLarge(path, seen, "write it with smaller pages (data_page_size) or in smaller row groups")


def _scans(table: _Table, batch: Any, done: int) -> RawScans:
    """A batch as scans. done: number of scans before it."""
    values = np.empty((len(batch), table.width))
    if table.listed:
        values[:] = _listed(table, batch.column(table.taxels[0]), done)
    else:
        for number, name in enumerate(table.taxels):
            values[:, number] = _floats(batch.column(name))
    if table.time is None:
        return RawScans(np.arange(done, done + len(batch)) / table.rate_hz, values)
    return RawScans(_floats(batch.column(table.time)) / table.per_second, values)


def _listed(table: _Table, column: Any, done: int) -> Floats:
    """Lists (rows, listed), NaN where a list or a number is missing. Raises RecordingCorrupt for other lengths."""
    lengths = np.array(column.value_lengths().to_numpy(zero_copy_only=False), dtype=np.float64)
    known = np.isfinite(lengths)
    if (wrong := np.flatnonzero(known & (lengths != table.listed))).size:
        seen = f"scan {done + wrong[0]} has {lengths[wrong[0]]:.0f} numbers in column {table.taxels[0]!r}"
        raise RecordingCorrupt(table.path, seen, f"it needs {table.listed} in each row, as many as the sensor has")
    values: Floats = np.full((len(column), table.listed), np.nan)
    values[known] = _floats(column.drop_null().flatten()).reshape(-1, table.listed)
    return values


def _floats(column: Any) -> Floats:
    """(rows,), NaN where a value is missing."""
    import pyarrow

    if pyarrow.types.is_string(column.type):
        return np.array([iso_seconds(text or "") for text in column.to_pylist()])
    if pyarrow.types.is_timestamp(column.type):
        column = column.cast(pyarrow.int64())
    numbers: Floats = column.to_numpy(zero_copy_only=False).astype(np.float64)
    return numbers


def _numeric(arrow: Any, kind: Any) -> bool:
    return bool(arrow.types.is_floating(kind) or arrow.types.is_integer(kind))


def _arrow() -> Any:
    try:
        arrow = import_module("pyarrow")
        import_module("pyarrow.parquet")  # becomes its attribute
    except ModuleNotFoundError as error:
        raise ExtraMissing("tables", "pyarrow") from error
    return arrow
