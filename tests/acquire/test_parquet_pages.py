from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from synthetic import grid_sensor
from taxelflow.acquire import parquet
from taxelflow.acquire.parquet_pages import unpacked_pages
from taxelflow.errors import RecordingError, RecordingTooLarge
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path

SENSOR = grid_sensor(1, 2)


def written(path: Path, rows: int, **options: Any) -> Path:
    table = pa.table([np.arange(rows) / 100, np.zeros(rows), np.zeros(rows)], names=["t_s", "a", "b"])
    pq.write_table(table, path, **{"compression": "zstd", "use_dictionary": False, **options})
    return path


@pytest.mark.parametrize(
    "options", [{}, {"use_dictionary": True}, {"data_page_version": "2.0"}, {"row_group_size": 300}]
)
def test_pages_have_the_length_that_pyarrow_gives(tmp_path: Path, options: dict[str, Any]) -> None:
    path = written(tmp_path / "a.parquet", 1000, **options)
    metadata = pq.read_metadata(path)
    with path.open("rb") as file:
        groups = unpacked_pages(file, {"t_s", "a", "b"})
    assert len(groups) == metadata.num_row_groups
    for number, columns in enumerate(groups):
        whole = [metadata.row_group(number).column(k).total_uncompressed_size for k in range(3)]
        assert all(0 <= total - sum(pages) < 200 * len(pages) for total, pages in zip(whole, columns, strict=True))


def test_columns_that_are_not_read_or_not_packed_are_left_out(tmp_path: Path) -> None:
    with written(tmp_path / "a.parquet", 10).open("rb") as file:
        assert [len(group) for group in unpacked_pages(file, {"a"})] == [1]
    with written(tmp_path / "b.parquet", 10, compression="none").open("rb") as file:
        assert unpacked_pages(file, {"a"}) == [[]]


def test_pages_that_unpack_to_too_much_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "MOST_ARRAY_BYTES", 10_000)
    path = written(tmp_path / "a.parquet", 1000)
    with pytest.raises(RecordingTooLarge, match="largest pages of a row group unpack to 24"):
        read(path, SENSOR).load()


def test_a_damaged_index_does_not_end_the_process(tmp_path: Path) -> None:
    path = written(tmp_path / "a.parquet", 100)
    content = path.read_bytes()
    length = int.from_bytes(content[-8:-4], "little")
    for place in range(len(content) - 8 - length, len(content) - 8, 7):
        path.write_bytes(content[:place] + b"\xff" + content[place + 1 :])
        try:
            read(path, SENSOR).load()
        except RecordingError as error:
            assert str(error).isprintable()
