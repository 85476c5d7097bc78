"""What a sensor file says of pads and groups: where taxels are, and in what order the source sends them."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

MOST_TAXELS = 1 << 20
MOST_CONTACTS = 8

Name = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[^,\"\r\n]+$")]
Count = Annotated[int, Meta(ge=0, le=1024)]
Positive = Annotated[float, Meta(gt=0, lt=1e12)]
Index = Annotated[int, Meta(ge=0, lt=MOST_TAXELS)]
Channels = Annotated[int, Meta(ge=1, le=MOST_TAXELS)]
Number = Annotated[float, Meta(gt=-1e6, lt=1e6)]
Contacts = Annotated[int, Meta(ge=1, le=MOST_CONTACTS)]

Corner = Literal["top-left", "top-right", "bottom-left", "bottom-right"]


class Pad(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """Taxels on one piece of skin: a rectangular grid, some places of which may be empty, or a table of places."""

    name: Name
    """How the pad is called in results."""
    rows: Count = 0
    cols: Count = 0
    pitch_m: tuple[Positive, Positive] | None = None
    """Distance between taxel centres along x (columns) and y (rows), m. Of a table: the median distance to the nearest
    taxel if left out."""
    missing: tuple[tuple[Index, Index], ...] = ()
    """Grid places [row, col] where there is no taxel."""
    taxels: str | tuple[tuple[Number, ...], ...] = ()
    """A table instead of a grid: a CSV file, relative to the sensor file, or rows [x, y] or [x, y, z, nx, ny, nz], m,
    with the normal out of the skin. A curved pad is laid flat (see `chart`)."""
    area_m2: Positive | tuple[Positive, ...] | None = None
    """Area of a taxel, or of each, m^2; the product of the pitches if left out."""
    origin_m: tuple[Number, Number] | None = None
    """The pad's origin in the hand frame (the hand laid flat), m, if known."""
    angle_rad: Number = 0.0
    """Direction of the pad's x axis in the hand frame, rad, anticlockwise."""
    pose: tuple[Number, Number, Number, Number, Number, Number, Number] | None = None
    """Where the pad is in space, if known: [x, y, z, qx, qy, qz, qw] in m, from the table's 3-D frame (for a grid the
    pad's frame) to the hand's."""
    start: Index | None = None
    """Number of the source's scan at which the pad begins; behind the pad before if left out."""
    channels: Channels | None = None
    """How many numbers of the source's scan are the pad's; one for each taxel if left out. A grid that sends its
    missing places too has rows times cols."""
    order: Literal["row-major", "column-major"] = "row-major"
    """Order in which the source sends a grid: row by row, or column by column."""
    first: Corner = "top-left"
    """Corner of the grid where the source begins."""
    index: tuple[Index, ...] = ()
    """Which of the pad's numbers each taxel is, where no simple order fits; in a table's CSV the column `index`."""
    contacts: Contacts = 1
    """How many contacts on it, at most, are told apart, because they move independently."""
    note: str = ""
    """What a user should know, such as an assumption."""

    @property
    def is_table(self) -> bool:
        """Whether taxels are listed, not in a grid."""
        return bool(self.taxels)

    @property
    def count(self) -> int:
        """How many taxels it has."""
        return len(self.taxels) if self.is_table else self.rows * self.cols - len(self.missing)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """What its contacts are called in results; none where they are not told apart."""
        return tuple(f"{self.name}#{number}" for number in range(1, self.contacts + 1)) if self.contacts > 1 else ()


class Patch(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """Some of a pad's taxels: a rectangle of its grid, or a list."""

    pad: Name
    rows: tuple[Index, Index] | None = None
    """First and last row; all if left out."""
    cols: tuple[Index, Index] | None = None
    """First and last column; all if left out."""
    taxels: tuple[Index, ...] = ()
    """Numbers of taxels within the pad, from 0, instead of a rectangle."""


class Group(msgspec.Struct, frozen=True, forbid_unknown_fields=True, cache_hash=True):
    """Taxels that get a slip vector of their own. Groups may overlap.

    A group within one pad reports in that pad's frame, one across pads in the hand frame.
    """

    name: Name
    patches: Annotated[tuple[Patch, ...], Meta(min_length=1, max_length=1024)]
