"""The options of all commands that read recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from taxelflow.acquire.columns import Columns


@dataclass(frozen=True, kw_only=True)
class Source:
    """Of which sensor a recording is, and where in the file."""

    sensor: str | None = None
    """Name of a built-in sensor (see `taxelflow sensors`), or a TOML file; not needed where the recording names its
    own."""
    topic: str | None = None
    """Topic of a bag or .mcap; not needed where only one fits."""

    joints: str | None = None
    """Joint angles of the hand instead of the recording's: `spread=60deg f1=1.2` (rad without a unit), a named pose of
    the sensor's hand, or a csv with columns t_s (s) and the joints (rad)."""
    columns: Columns = field(default_factory=Columns)

    @property
    def own_columns(self) -> Columns | None:
        """How the columns of a text or Parquet file are laid out, if not as usual."""
        return None if self.columns == Columns() else self.columns


@dataclass(frozen=True, kw_only=True)
class Recorded(Source):
    """Which recording, of which sensor."""

    recording: Annotated[Positional[Path], tyro.conf.arg(metavar="RECORDING")]
    """Recording to read: .npz, .npy, .h5, .csv, .tsv, .txt, .parquet, .dsa, .mcap, a ROS 1 .bag, a ROS 2 bag
    (directory or .db3), or a directory with one file per pad."""
