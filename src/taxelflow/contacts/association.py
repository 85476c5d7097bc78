"""Data association: which components of a scan continue which tracked contacts.

A track continues in every component that holds at least a quarter of its previous load. A track without such a
component continues in the nearest unassigned one. Tracks end without a component; unassigned components start new
tracks, tracks merge while one is new, and split after their components have been separate for some scans.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from taxelflow.contacts.tracks import Component, Memory, SegmentedPad, Taxel, Track
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records
from taxelflow.runtime.compiling import routine


class _Tracks(NamedTuple):
    """How contacts are followed from scan to scan."""

    overlap: float = 0.25
    """Share of a track's previous load that a component must hold to continue it. Up to 4 components can."""
    age_scans: int = 5
    """Until a track has lasted this many scans, it merges with another that it meets: parts of one object may touch the
    skin one after the other."""
    parted_scans: int = 3
    """A track splits, or ends on another's flank, after this many scans in a row: single scans of noise do neither."""
    jump_pitches: float = 3.0
    """A track without overlap is looked for within this distance if other tracks are on the pad."""


TRACKS = _Tracks()


class Centroid(Protocol):
    """What `Track` and `Component` have in common."""

    load: float
    x: float
    y: float


@routine
def associate(reading: Floats, noise: Floats, pad: SegmentedPad, number: int, components: int, memory: Memory) -> Bools:
    """Tracks of each component: (components + 1, slots + 1), True where component belongs to label; both from 1.

    reading, noise: (taxels,). number: of the pad in `memory`. Brings the ages of its tracks up to date.
    """
    tracks, found, slots = memory.tracks[number], memory.components, pad.slots
    votes = np.zeros((components + 1, slots + 1))
    _measure(reading, noise, pad, components, tracks, memory, votes)
    owner = np.zeros((components + 1, slots + 1), dtype=np.bool_)
    for b in range(1, components + 1):
        for s in range(1, slots + 1):
            owner[b, s] = votes[b, s] > 0.0 and votes[b, s] >= TRACKS.overlap * tracks[s - 1].load
        if owners_of(b, owner) == 0:
            strongest = _strongest(b, votes)
            owner[b, strongest] = strongest > 0
    for s in range(1, slots + 1):
        if tracks[s - 1].load > 0.0 and _components_of(s, owner) == 0:
            reach = TRACKS.jump_pitches if _assigned(owner) > 0 else np.inf
            nearest = _nearest(tracks[s - 1].x, tracks[s - 1].y, found, owner, False, reach)
            owner[nearest, s] = nearest > 0
    _merge_new(owner, tracks)
    for s in range(1, slots + 1):
        tracks[s - 1].age = tracks[s - 1].age + 1 if _components_of(s, owner) > 0 else 0
    _start(owner, found, pad.contact_on, tracks)
    _split(owner, found, pad.contact_on, tracks)
    _assign_rest(owner, found)
    return owner


@routine
def owners_of(component: int, owner: Bools) -> int:
    """How many tracks a component belongs to. owner: (components + 1, slots + 1)."""
    owners = 0
    for s in range(1, owner.shape[1]):
        owners += 1 if owner[component, s] else 0
    return owners


@routine
def first_owner(component: int, owner: Bools) -> int:
    """The lowest label that a component belongs to, 0 if there is none."""
    for s in range(1, owner.shape[1]):
        if owner[component, s]:
            return s
    return 0


@routine
def _components_of(label: int, owner: Bools) -> int:
    """How many components belong to a track."""
    components = 0
    for b in range(1, len(owner)):
        components += 1 if owner[b, label] else 0
    return components


@routine
def _assigned(owner: Bools) -> int:
    """How many components belong to any track."""
    components = 0
    for b in range(1, len(owner)):
        components += 1 if owners_of(b, owner) > 0 else 0
    return components


@routine
def _strongest(component: int, votes: Floats) -> int:
    """The label with most votes for a component, 0 if there are none."""
    most, label = 0.0, 0
    for s in range(1, votes.shape[1]):
        if votes[component, s] > most:
            most, label = votes[component, s], s
    return label


@routine
def _measure(
    reading: Floats,
    noise: Floats,
    pad: SegmentedPad,
    components: int,
    tracks: Records,
    memory: Memory,
    votes: Floats,
) -> None:
    """Load and centroid of tracks in the previous scan and of components in this one, and the peaks of components.

    votes: (components + 1, slots + 1), previous load of a label on the taxels of a component.
    """
    for s in range(pad.slots):
        tracks[s].load = tracks[s].x = tracks[s].y = 0.0
    for b in range(components + 1):
        new: Component = memory.components[b]
        new.load = new.x = new.y = new.peak = 0.0
    for k in range(pad.start, pad.stop):
        taxel: Taxel = memory.taxels[k]
        s, b = taxel.label, taxel.component
        if s > 0:
            _add(tracks[s - 1], taxel.last_reading, taxel)
        if b > 0:
            component: Component = memory.components[b]
            _add(component, reading[k], taxel)
            component.peak = max(component.peak, reading[k] / noise[k] if noise[k] > 0.0 else 0.0)
            votes[b, s] += taxel.last_reading if s > 0 else 0.0


@routine
def _add(to: Centroid, load: float, taxel: Taxel) -> None:
    """Add one taxel to a load and a centroid."""
    to.load += load
    to.x += load / to.load * (taxel.x - to.x) if to.load > 0.0 else 0.0
    to.y += load / to.load * (taxel.y - to.y) if to.load > 0.0 else 0.0


@routine
def _nearest(x: float, y: float, components: Records, owner: Bools, owned: bool, reach: float) -> int:
    """The component nearest to (x, y) among those with an owner, or among those without; 0 if none is within reach."""
    nearest = 0
    for b in range(1, len(owner)):
        distance = np.hypot(components[b].x - x, components[b].y - y)
        if (first_owner(b, owner) > 0) == owned and distance < reach:
            nearest, reach = b, distance
    return nearest


@routine
def _merge_new(owner: Bools, tracks: Records) -> None:
    """A new track that meets an older one in a component becomes part of it, with all of its components."""
    for b in range(1, len(owner)):
        for s in range(owner.shape[1] - 1, 0, -1):
            older = _older_owner(b, s, owner, tracks) if owner[b, s] and tracks[s - 1].age < TRACKS.age_scans else 0
            if older > 0:
                _hand_over(s, older, owner)


@routine
def _older_owner(component: int, label: int, owner: Bools, tracks: Records) -> int:
    """The first track of a component that is older than this one; 0 if there is none."""
    age = tracks[label - 1].age
    for r in range(1, owner.shape[1]):
        older = tracks[r - 1].age > age or (tracks[r - 1].age == age and r < label)
        if owner[component, r] and older:
            return r
    return 0


@routine
def _hand_over(label: int, to: int, owner: Bools) -> None:
    """All components of one track go to another."""
    for b in range(1, len(owner)):
        owner[b, to] = owner[b, to] or owner[b, label]
        owner[b, label] = False


@routine
def _start(owner: Bools, components: Records, contact_on: float, tracks: Records) -> None:
    """Unassigned components become tracks: the one with the largest load takes the lowest free slot."""
    for s in range(1, owner.shape[1]):
        new = 0
        for b in range(1, len(owner)):
            component: Component = components[b]
            candidate = owners_of(b, owner) == 0 and component.peak > contact_on
            if candidate and (new == 0 or component.load > components[new].load):
                new = b
        if new > 0 and _components_of(s, owner) == 0:
            owner[new, s] = True
            _occupy(tracks[s - 1])


@routine
def _occupy(track: Track) -> None:
    """Start a track. A slot that was in use in the previous scan waits one scan, so that no two contacts look like one
    that jumped.
    """
    track.age = 0 if track.load > 0.0 else 1


@routine
def _split(owner: Bools, components: Records, contact_on: float, tracks: Records) -> None:
    """A track whose components have long been separate becomes two if a slot is free; the largest part keeps it."""
    slots = owner.shape[1] - 1
    for s in range(1, slots + 1):
        track: Track = tracks[s - 1]
        second = _second_part(s, owner, components, contact_on)
        track.parted_scans = track.parted_scans + 1 if second > 0 else 0
        free = 0
        for r in range(slots, 0, -1):
            free = r if _components_of(r, owner) == 0 else free
        if track.parted_scans >= TRACKS.parted_scans and free > 0:
            owner[second, s], owner[second, free] = False, True
            _occupy(tracks[free - 1])
            track.parted_scans = 0


@routine
def _second_part(label: int, owner: Bools, components: Records, contact_on: float) -> int:
    """The second largest component that belongs to this track only; 0 if there are fewer than two."""
    largest = second = 0
    for b in range(1, len(owner)):
        if not (owner[b, label] and owners_of(b, owner) == 1 and components[b].peak > contact_on):
            continue
        if largest == 0 or components[b].load > components[largest].load:
            largest, second = b, largest
        elif second == 0 or components[b].load > components[second].load:
            second = b
    return second


@routine
def _assign_rest(owner: Bools, components: Records) -> None:
    """Components that are too faint or too many belong to the first track of the nearest assigned component."""
    assigned = owner.copy()
    for b in range(1, len(owner)):
        if owners_of(b, assigned) == 0:
            nearest = _nearest(components[b].x, components[b].y, components, assigned, True, np.inf)
            if nearest > 0:
                owner[b, first_owner(nearest, assigned)] = True
