"""Fast path of `segment` and `check_rigidity`, for pads with one component each.

Most recordings never show a second component, and the kernels that track several take ten times as long to compile.
"""

from __future__ import annotations

from taxelflow.contacts.adjacency import Adjacency
from taxelflow.contacts.connected_components import label_components
from taxelflow.contacts.tracks import Memory, SegmentedPad, Taxel, Track
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import kernel, routine


@kernel
def track_single(
    pressure: Floats,
    noise: Floats,
    contact: Bools,
    complete: Bools,
    memory: Memory,
    adjacency: Adjacency,
    places: Records,
) -> int:
    """Track the contacts of scans up to the first one in which a pad has several components. Returns that scan.

    pressure: (scans, entries). noise: (entries,). contact, complete: (scans, pads of the sensor). memory: of `segment`.
    places: `Place` (taxels,) of `check_rigidity`. `has_first_only`, and no pair of contacts is being compared.
    """
    for scan in range(len(pressure)):
        for number in range(len(memory.pads)):
            pad: SegmentedPad = memory.pads[number]
            incomplete = not complete[scan, pad.pad]
            if contact[scan, pad.pad] and (
                label_components(pressure[scan], noise, incomplete, pad, memory.taxels, adjacency) > 1
            ):
                return scan
        for number in range(len(memory.pads)):
            own: SegmentedPad = memory.pads[number]
            if contact[scan, own.pad]:
                _track(pressure[scan], noise, own, memory.tracks[number, 0], memory.taxels)
            else:
                _reset(own, memory.tracks[number, 0], memory.taxels)
            if complete[scan, own.pad] or not contact[scan, own.pad]:
                _remember(own, memory.taxels, places)
    return len(pressure)


@kernel
def has_first_only(memory: Memory) -> bool:
    """Whether no track but the first of each pad is in use, that one is whole, and no taxel belongs to another."""
    for number in range(memory.tracks.shape[0]):
        for slot in range(memory.tracks.shape[1]):
            track: Track = memory.tracks[number, slot]
            if (slot > 0 and track.age > 0) or track.parted_scans > 0 or track.peakless_scans > 0:
                return False
    most = 0
    for k in range(len(memory.taxels)):
        most = max(most, memory.taxels[k].label)
    return most <= 1


@routine
def _remember(pad: SegmentedPad, taxels: Records, places: Records) -> None:
    """Keep the labels for the rigidity check's next scan."""
    for k in range(pad.start, pad.stop):
        places[k].last_label = taxels[k].label


@routine
def _reset(pad: SegmentedPad, track: Track, taxels: Records) -> None:
    """The pad is not in contact."""
    track.age = 0
    for k in range(pad.start, pad.stop):
        taxels[k].label = 0


@routine
def _track(reading: Floats, noise: Floats, pad: SegmentedPad, track: Track, taxels: Records) -> None:
    """The component continues the track wherever it was; without one, a bright component starts it."""
    load = peak = 0.0
    components = 0
    for k in range(pad.start, pad.stop):
        taxel: Taxel = taxels[k]
        load += taxel.last_reading if taxel.label == 1 else 0.0
        components = max(components, taxel.component)
        if taxel.component == 1 and noise[k] > 0.0:
            peak = max(peak, reading[k] / noise[k])
    if load > 0.0:
        track.age = track.age + 1 if components == 1 else 0
    else:
        track.age = 1 if peak > pad.contact_on else 0
    for k in range(pad.start, pad.stop):
        taxels[k].label = 1 if taxels[k].component == 1 and track.age > 0 else 0
        taxels[k].last_reading = reading[k]
