from __future__ import annotations

import bz2
from typing import TYPE_CHECKING, Any

import lz4.frame
import numpy as np
import pytest
import zstandard

from costly import mostly_long
from synthetic import grid_sensor
from taxelflow.acquire import limits
from taxelflow.acquire.limits import Budget, check_expansion, scans_per_block, unpack_bz2, unpack_lz4, unpack_zstd
from taxelflow.errors import RecordingTooLarge
from taxelflow.sensors.catalogue import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

PACKED = {
    "bz2": (unpack_bz2, bz2.compress),
    "lz4": (unpack_lz4, lz4.frame.compress),
    "zstd": (unpack_zstd, zstandard.compress),
}


@pytest.mark.parametrize("kind", PACKED)
@pytest.mark.parametrize("size", mostly_long([0, 1, 5_000_000], 0, 1))
def test_what_was_packed_is_unpacked(tmp_path: Path, kind: str, size: int) -> None:
    unpack, pack = PACKED[kind]
    content = np.random.default_rng(0).integers(0, 4, size, dtype=np.uint8).tobytes()
    assert unpack(pack(content), tmp_path) == content


@pytest.mark.parametrize("kind", PACKED)
def test_unpacking_stops_at_the_limit(tmp_path: Path, kind: str) -> None:
    unpack, pack = PACKED[kind]
    with pytest.raises(RecordingTooLarge, match="unpack to more than 1000000; if the recording is that long"):
        unpack(pack(bytes(5_000_000)), tmp_path, 1_000_000)


@pytest.mark.parametrize("kind", ["bz2", "lz4"])
def test_packed_data_that_end_early_are_an_error(tmp_path: Path, kind: str) -> None:
    unpack, pack = PACKED[kind]
    content = pack(np.random.default_rng(0).bytes(100_000))
    with pytest.raises((EOFError, OSError, RuntimeError)):
        unpack(content[: len(content) // 2], tmp_path)


def test_a_file_may_unpack_to_a_gigabyte_and_a_hundred_times_its_size(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(1000))
    check_expansion(path, limits.FREE_BYTES + 100_000)
    with pytest.raises(RecordingTooLarge, match=r"its 1000 bytes unpack to more than 1\.1 GB"):
        check_expansion(path, limits.FREE_BYTES + 100_001)
    budget = Budget(path)
    budget.spend(limits.FREE_BYTES)
    with pytest.raises(RecordingTooLarge):
        budget.spend(100_001)


@pytest.mark.parametrize(
    ("sensor", "scans"),
    [
        (load_sensor("barretthand-162"), 1024),
        (load_sensor("inspire-rh56dftp@3mm"), 1024),
        (grid_sensor(128, 256), 127),
        (grid_sensor(4, 4, channels=1 << 20), 4),
    ],
)
def test_blocks_of_large_sensors_have_fewer_scans(sensor: Any, scans: int) -> None:
    assert scans_per_block(sensor) == scans
