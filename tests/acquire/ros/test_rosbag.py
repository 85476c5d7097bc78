from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from bagged import SDH, SDH_CELLS, plain, scans_of, write_bag
from taxelflow.acquire.ros.open import open_bag
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(("storage", "pattern"), [("sqlite3", "*.db3"), ("mcap", "*.mcap")])
def test_the_storage_file_of_a_ros_2_bag_may_be_given_alone(tmp_path: Path, storage: str, pattern: str) -> None:
    path = write_bag(tmp_path / "bag", {"/dsa": (SDH, scans_of(*SDH_CELLS))}, storage=storage)
    alone = open_bag(next(path.glob(pattern)), None)
    np.testing.assert_array_equal(alone.load().values, read(path).load().values)


def test_a_long_bag_comes_in_blocks_and_twice_the_same(tmp_path: Path) -> None:
    scans = scans_of(4, scans=2100)
    path = write_bag(tmp_path / "a.bag", {"/t": ("std_msgs/msg/Float32MultiArray", scans)})
    recording = read(path, plain(4))
    assert [len(block) for block in recording.blocks()] == [1024, 1024, 52]
    np.testing.assert_array_equal(recording.load().values, recording.load().values)
