"""Pads and groups as a sensor file declares them: positions of taxels, and the order in which the source sends them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

MOST_TAXELS = 1 << 15
"""Taxels of a sensor: bounds the memory that a sensor file can ask for."""
MOST_NUMBERS = 1 << 20
"""Numbers in a scan of the source, and entries of a layout (taxels of pads, groups and contacts)."""


@dataclass(frozen=True, slots=True)
class _Most:
    """Limits of what a sensor file declares."""

    cells: int = 1024
    """Rows or columns of a pad."""
    pads: int = 1024
    """Pads of a sensor, groups of a sensor, and patches of a group."""
    contacts: int = 8
    """Separate contacts of a pad: each is one more copy of its taxels in every scan."""


MOST = _Most()
LARGEST = 1e6
"""A length, angle or number of a file is nearer to 0."""

Name = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[^,\"\r\n]+$")]
Count = Annotated[int, Meta(ge=0, le=MOST.cells)]
Positive = Annotated[float, Meta(gt=0, lt=1e12)]
Index = Annotated[int, Meta(ge=0, lt=MOST_NUMBERS)]
Channels = Annotated[int, Meta(ge=1, le=MOST_NUMBERS)]
Number = Annotated[float, Meta(gt=-LARGEST, lt=LARGEST)]
Contacts = Annotated[int, Meta(ge=1, le=MOST.contacts)]

Corner = Literal["top-left", "top-right", "bottom-left", "bottom-right"]


class Pad(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """Taxels on one piece of skin: a rectangular grid, possibly with missing taxels, or a table of positions."""

    name: Name
    """Name of the pad in results."""
    rows: Count = 0
    cols: Count = 0
    pitch_m: tuple[Positive, Positive] | None = None
    """Distance between taxel centres along x (columns) and y (rows), m. Of a table: the median distance to the nearest
    taxel if left out."""
    missing: tuple[tuple[Index, Index], ...] = ()
    """Cells [row, col] of the grid without a taxel, counted from 0."""
    taxels: str | tuple[tuple[Number, ...], ...] = ()
    """A table instead of a grid: a CSV file, relative to the sensor file, or rows [x, y] or [x, y, z, nx, ny, nz], m,
    with the normal out of the skin. A curved pad is flattened to a plane (see
    `flattening`)."""
    area_m2: Positive | tuple[Positive, ...] | None = None
    """Area of every taxel, or of each taxel, m^2; the product of the pitches if left out."""
    origin_m: tuple[Number, Number] | None = None
    """Origin of the pad in the hand frame (the skin of the hand flattened to a plane), m, if known."""
    angle_rad: Number = 0.0
    """Direction of the pad's x axis in the hand frame, rad, anticlockwise."""
    pose: tuple[Number, Number, Number, Number, Number, Number, Number] | None = None
    """Pose in space, if known: [x, y, z, qx, qy, qz, qw], position in m and quaternion, from the table's 3-D frame (for
    a grid the pad's frame) to the hand's, or to that of `link`."""
    link: Name | None = None
    """Link of the hand's model ([hand] urdf) that carries the pad; `pose` is then relative to it."""
    start: Index | None = None
    """Place in the source's scan at which the pad begins; after the previous pad if left out."""
    channels: Channels | None = None
    """Places of the source's scan that belong to the pad; one per taxel if left out. rows times cols for a grid whose
    missing taxels are sent too."""
    order: Literal["row-major", "column-major"] = "row-major"
    """Order in which the source sends a grid: row by row, or column by column."""
    first: Corner = "top-left"
    """Corner of the grid at which the source begins."""
    index: tuple[Index, ...] = ()
    """Place of each taxel among those of the pad, where no simple order fits; in a table's CSV the column `index`."""
    files: str = ""
    """Glob, relative to the recording's folder, of the one file with this pad's scans, where each pad has its own."""
    contacts: Contacts = 1
    """Largest number of separate contacts on the pad, which move independently."""
    note: str = ""
    """Remark for the user, such as an assumption."""

    @property
    def is_table(self) -> bool:
        """Whether the taxels are given as a table."""
        return bool(self.taxels)

    @property
    def count(self) -> int:
        """Number of taxels."""
        return len(self.taxels) if self.is_table else self.rows * self.cols - len(self.missing)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of its separate contacts in results; none if there is one contact."""
        return tuple(f"{self.name}#{number}" for number in range(1, self.contacts + 1)) if self.contacts > 1 else ()


class Patch(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """A selection of a pad's taxels: a rectangle of its grid, or a list."""

    pad: Name
    rows: tuple[Index, Index] | None = None
    """First and last row; all if left out."""
    cols: tuple[Index, Index] | None = None
    """First and last column; all if left out."""
    taxels: tuple[Index, ...] = ()
    """Numbers of taxels within the pad, counted from 0, instead of a rectangle."""


class Group(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """Taxels that get a slip vector of their own. Groups may overlap.

    The results of a group within one pad are in that pad's frame, of one across pads in the hand frame.
    """

    name: Name
    patches: Annotated[tuple[Patch, ...], Meta(min_length=1, max_length=MOST.pads)]
