from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np
import pytest

from taxelflow.errors import ResultMissing
from taxelflow.messages import LearnedPattern
from taxelflow.publish.patterns import NAME, read_patterns, write_patterns

if TYPE_CHECKING:
    from pathlib import Path


def pattern(pad: str = "palm", width: int = 4, **changes: object) -> LearnedPattern:
    pressure = np.arange(3.0 * width).reshape(3, width)
    pressure[0, 0] = np.nan
    whole = {
        "pad": pad,
        "t_first_s": 1.5,
        "t_last_s": 2.5,
        "scans": 11,
        "x_m": np.linspace(-0.01, 0.01, width),
        "y_m": np.array([0.0, 0.001, 0.002]),
        "pressure": pressure,
        "std": 0.1 * pressure,
        "turns": True,
        "dead": np.array([3, 7]),
    }
    return LearnedPattern(**(whole | changes))  # type: ignore[arg-type]


def test_patterns_come_back_as_they_were_written(tmp_path: Path) -> None:
    written = [pattern(), pattern("läuft, ✓", 6, turns=False, dead=np.zeros(0, np.int64))]
    write_patterns(written, tmp_path / NAME)
    assert [path.name for path in tmp_path.iterdir()] == [NAME]
    for one, other in zip(written, read_patterns(tmp_path), strict=True):
        for field in fields(LearnedPattern):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_numpy_alone_reads_the_file(tmp_path: Path) -> None:
    write_patterns([pattern()], tmp_path / NAME)
    with np.load(tmp_path / NAME, allow_pickle=False) as file:
        assert file["pad"].tolist() == ["palm"]
        assert file["pressure_0"].shape == (3, 4)


def test_a_result_without_patterns_has_none(tmp_path: Path) -> None:
    assert read_patterns(tmp_path) == []


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and no more", b"words"])
def test_a_broken_file_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / NAME).write_bytes(content)
    with pytest.raises(ResultMissing, match=r"holds no readable patterns.npz \("):
        read_patterns(tmp_path)


def test_a_file_that_lacks_an_array_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / NAME, pad=np.array(["palm"]))
    with pytest.raises(ResultMissing, match=r"holds no readable patterns\.npz"):
        read_patterns(tmp_path)
