"""Records of the rigidity check: pads, pairs of contacts, their shapes in a scan, and the places of taxels."""

from __future__ import annotations

from typing import NamedTuple

from taxelflow.numerics.records import Records


class CheckedPad:
    """A pad that is checked. start, stop: its taxels. pitch_m: the larger pitch. stretch: see `Layout.stretch`.

    moved_apart: whether contacts have, since the pad was touched. change_m: largest significant change of a distance.
    """

    pad: int
    start: int
    stop: int
    pitch_m: float
    stretch: float
    moved_apart: bool
    change_m: float


class Pair:
    """Two contacts of a pad. scans: of the reference, see `rigidity`. distance_m, width_m, other_width_m:
    mean distance and widths in these scans. changed_scans: consecutive scans in which the distance differs.
    """

    scans: int
    distance_m: float
    width_m: float
    other_width_m: float
    changed_scans: int


class Shape:
    """A contact in the current scan: centroid (m), variance of each coordinate (m^2) and radius of gyration (m).

    measured: whether its distances count in this scan.
    """

    measured: bool
    x: float
    y: float
    variance: float
    width_m: float


class Place:
    """A taxel's place on its pad (m), whether it lies at the border, and its label in the previous scan."""

    x: float
    y: float
    border: bool
    last_label: int


class Memory(NamedTuple):
    """State of the check: `CheckedPad` (pads,), `Pair` (pads, slots, slots), `Place` (taxels,), `Shape` (slots,)."""

    pads: Records
    pairs: Records
    places: Records
    shapes: Records
