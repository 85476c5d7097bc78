"""Records of contact segmentation: pads, their tracked contacts, their taxels, and the components of one scan.

A track is one contact that is followed from scan to scan. Its slot is counted from 0, its number in a label image is
slot + 1; label 0 is no contact. Components are numbered from 1; component 0 is all that is not loaded. Positions are in
taxel pitches, so that distances compare across pads.
"""

from __future__ import annotations

from typing import NamedTuple

from taxelflow.numerics.records import Records


class SegmentedPad:
    """A pad that is segmented. start, stop: its taxels. slots: contacts tracked at most.

    contact_on, contact_off: standard deviations of noise above which a component may become a contact, and above which
    a taxel is loaded.
    """

    pad: int
    start: int
    stop: int
    slots: int
    contact_on: float
    contact_off: float


class Track:
    """A tracked contact: load (sum of readings) and centroid in the previous scan.

    age: scans in contact, 0 if the slot is free. parted_scans: consecutive scans in which it consisted of separate
    components. peakless_scans: consecutive scans in which its highest taxel lay beside a higher one of another contact.
    """

    age: int
    parted_scans: int
    peakless_scans: int
    load: float
    x: float
    y: float


class Taxel:
    """Position of a taxel, and what the previous scan left behind: its label and its reading.

    component: number of its connected component in the current scan. stacked: a taxel that waits for a flood fill.
    """

    x: float
    y: float
    label: int
    last_reading: float
    component: int
    stacked: int


class Component:
    """A connected set of loaded taxels in one scan: load, centroid, and highest reading in standard deviations."""

    load: float
    x: float
    y: float
    peak: float


class Memory(NamedTuple):
    """State of segmentation: `SegmentedPad` (pads,), `Track` (pads, slots), `Taxel` (taxels,), and scratch space,
    `Component` (most taxels of a pad + 1,).
    """

    pads: Records
    tracks: Records
    taxels: Records
    components: Records
