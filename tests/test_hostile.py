from __future__ import annotations

import os
from pathlib import Path

import pytest

from costly import mostly_long
from hostile.files import MAKERS
from hostile.fuzz import finding
from hostile.measure import measured

SLOW = (
    "2_gb",
    "millions",
    "equal_rows",
    "6_gb",
    "packed_by",
    "long_text",
    "column_by_column",
    "empty_elements",
    "eight",
    "declares_less",
    "large_message",
    "wide_scans",
    "20_mb",
)
"""Files that take seconds to write or read: `make fuzz` has them all."""
QUICK = [name for name in MAKERS if not any(part in name for part in SLOW)]
FOUND = sorted((Path(__file__).parent / "hostile" / "findings").glob("*"))
QUICK_FOUND = [path for path in FOUND if path.suffix != ".h5"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="memory is measured in a forked process")
@pytest.mark.parametrize("name", QUICK)
def test_a_hostile_file_is_refused_within_the_limits(tmp_path: Path, name: str) -> None:
    cost = measured(name, tmp_path)
    assert cost.within, cost
    assert cost.exit == 2


@pytest.mark.parametrize("path", mostly_long(FOUND, *QUICK_FOUND), ids=lambda path: path.name)
def test_what_the_fuzzer_has_found_stays_mended(path: Path) -> None:
    assert not finding(path)
