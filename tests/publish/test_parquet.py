from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

from taxelflow.errors import ExtraMissing
from taxelflow.publish.parquet import ParquetTables

if TYPE_CHECKING:
    from pathlib import Path


def test_without_pyarrow_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ExtraMissing, match=r"pip install 'taxelflow\[tables\]'"):
        ParquetTables(tmp_path, ("palm",))
