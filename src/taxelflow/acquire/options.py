"""The options of all commands that read a recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tyro.conf import Positional

from taxelflow.acquire.columns import Columns


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Which recording, of which sensor."""

    recording: Positional[Path]
    """A recording: .npz, .csv, .tsv, .txt, .parquet, .dsa, .mcap, a ROS 1 .bag, a ROS 2 bag (directory or .db3)."""
    sensor: str | None = None
    """A built-in sensor (see `taxelflow sensors`) or a TOML file; not needed where the recording names its own."""
    topic: str | None = None
    """Topic of a bag or .mcap; not needed where only one fits."""

    columns: Columns = field(default_factory=Columns)

    @property
    def own_columns(self) -> Columns | None:
        """How the columns of a text or Parquet file are laid out, if not as usual."""
        return None if self.columns == Columns() else self.columns
