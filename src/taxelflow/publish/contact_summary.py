"""Summary of each contact of each pad: duration, slips, path, speed."""

from __future__ import annotations

from bisect import bisect_right
from math import isnan, sqrt
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from taxelflow.messages import cut

if TYPE_CHECKING:
    from taxelflow.messages import Event, Floats, Slips

_KNOWN = 0.5
"""Standard deviation, in pitches, up to which a displacement counts as known."""


class ContactSummary(msgspec.Struct, frozen=True):
    """One contact of a pad, group or separate contact, in its frame. None where unknown."""

    pad: str
    t_s: float
    """Time of the first scan in contact."""
    duration_s: float
    slips: int
    slip_s: float
    """Time during which it slipped."""
    path_m: float | None
    """Length of the path of all its slips, with its standard deviation."""
    std_path_m: float | None
    speed_m_s: float | None
    """Path over time of its slips, with its standard deviation."""
    std_speed_m_s: float | None
    turn_rad: float | None
    """Net rotation of all its slips."""
    net_m: tuple[float | None, float | None]
    """Sum of its displacements along x and y, slipping or not; None along an axis where most of them are not known
    within half a pitch, as along the row of a pad of one column."""
    border_share: float
    """Share of its scans that touch a border of the pad, where the paper's methods are biased."""


class _SlipSums(NamedTuple):
    """Over the slips of a contact: `slips` and `turn_rad` of all, the rest of the `moved` ones: their path is known."""

    begun_s: float
    """When the contact began."""
    slips: int = 0
    moved: int = 0
    slip_s: float = 0.0
    path_m: float = 0.0
    path_variance_m2: float = 0.0
    speed_variance_m2: float = 0.0
    """Of the speeds, times the durations."""
    turn_rad: float = 0.0

    def plus(self, slip: Event) -> _SlipSums:
        """With one more slip."""
        sums = self._replace(slips=self.slips + 1, turn_rad=self.turn_rad + slip.turn_rad)
        if isnan(slip.path_m):
            return sums
        return sums._replace(
            moved=self.moved + 1,
            slip_s=self.slip_s + slip.duration_s,
            path_m=self.path_m + slip.path_m,
            path_variance_m2=self.path_variance_m2 + slip.std_path_m**2,
            speed_variance_m2=self.speed_variance_m2 + (slip.std_speed_m_s * slip.duration_s) ** 2,
        )


class ContactTotals:
    """Sums over the blocks of a run, contact by contact. Of a slip that has ended only its sums are kept."""

    def __init__(self, pads: tuple[str, ...], pitch_m: Floats) -> None:
        count = len(pads)
        self._pads, self._known_m = pads, _KNOWN * pitch_m
        self._touching = np.zeros(count, dtype=np.bool_)
        self._since_s, self._last_s = np.zeros(count), 0.0
        # Of the contacts that go on: scans, scans at a border, displacements, known ones along x and y, their sums.
        self._counts = np.zeros((count, 5), dtype=np.int64)
        self._net_m = np.zeros((count, 2))
        self._ended: list[ContactSummary] = []
        # By pad: the sums of its contacts in the order of their begin, and its latest slip, which may go on.
        self._sums: dict[str, list[_SlipSums]] = {pad: [] for pad in pads}
        self._latest: dict[str, Event] = {}

    def add(self, slips: Slips, events: list[Event]) -> None:
        """Count one block in. Events belong to its scans or to earlier ones."""
        before = np.concatenate([self._touching[np.newaxis], slips.contact[:-1]])
        edges = np.flatnonzero((before != slips.contact).any(axis=1)).tolist()
        for start, stop in zip([0, *edges], [*edges, len(slips)], strict=True):
            if start == stop:
                continue
            self._change(slips, start)
            self._sum(cut(slips, start, stop))
        for event in events:
            if event.event == "slip_start":
                latest = self._latest.get(event.pad, event)
                if not (latest.event == "slip_stop" and event.withdraws(latest.onset_s)):
                    self._end_slip(event.pad)
                self._latest[event.pad] = event
            elif event.event == "slip_stop" and event.pad in self._latest:
                self._latest[event.pad] = event

    def contacts(self) -> list[ContactSummary]:
        """All contacts of a whole run in the order of their begin; those that go on end with the last scan."""
        going = [self._contact(pad, self._last_s) for pad in np.flatnonzero(self._touching).tolist()]
        for pad in self._pads:
            self._end_slip(pad)
        sums = {pad: iter(own) for pad, own in self._sums.items()}
        found = [_with_slips(contact, next(sums[contact.pad])) for contact in [*self._ended, *going]]
        return sorted(found, key=lambda one: (one.t_s, self._pads.index(one.pad)))

    def _end_slip(self, pad: str) -> None:
        """Count the pad's latest slip to the contact that had begun last before it."""
        if (slip := self._latest.pop(pad, None)) is None:
            return
        number = bisect_right(self._sums[pad], _start_s(slip), key=lambda sums: sums.begun_s) - 1
        if number >= 0:
            self._sums[pad][number] = self._sums[pad][number].plus(slip)

    def _change(self, slips: Slips, scan: int) -> None:
        """End and begin contacts in this scan."""
        now, t_s = slips.contact[scan], float(slips.t_s[scan])
        for pad in np.flatnonzero(now != self._touching).tolist():
            if self._touching[pad]:
                self._ended.append(self._contact(pad, t_s))
            else:
                self._sums[self._pads[pad]].append(_SlipSums(t_s))
            self._since_s[pad], self._counts[pad], self._net_m[pad] = t_s, 0, 0.0
        self._touching = now

    def _sum(self, slips: Slips) -> None:
        """Add scans without begin or end of a contact."""
        self._last_s = float(slips.t_s[-1])
        valid = slips.valid
        std = np.sqrt(np.diagonal(slips.displacement_covariance, axis1=2, axis2=3)[..., :2])
        known = valid[..., np.newaxis] & (std <= self._known_m)
        self._counts[:, 0] += slips.contact.sum(axis=0)
        self._counts[:, 1] += (slips.border.any(axis=2) & slips.contact).sum(axis=0)
        self._counts[:, 2] += valid.sum(axis=0)
        self._counts[:, 3:] += known.sum(axis=0)
        moved = np.where(valid[..., np.newaxis], slips.displacement[..., :2], 0.0)
        self._net_m = np.concatenate([self._net_m[np.newaxis], moved]).sum(axis=0)  # scan by scan, however they are cut

    def _contact(self, pad: int, end_s: float) -> ContactSummary:
        """A contact without its slips."""
        scans, at_border, steps, *known = self._counts[pad].tolist()
        x, y = (float(m) if 2 * sure >= steps > 0 else None for m, sure in zip(self._net_m[pad], known, strict=True))
        since_s = float(self._since_s[pad])
        share = at_border / scans if scans else 0.0
        return ContactSummary(
            self._pads[pad], since_s, end_s - since_s, 0, 0.0, None, None, None, None, None, (x, y), share
        )


def _start_s(event: Event) -> float:
    """Begin of the slip that an event belongs to."""
    return event.onset_s - event.duration_s if event.event == "slip_stop" else event.onset_s


def _with_slips(contact: ContactSummary, sums: _SlipSums) -> ContactSummary:
    """A contact with the sums over its slips."""
    slip_s = sums.slip_s
    return msgspec.structs.replace(
        contact,
        slips=sums.slips,
        slip_s=slip_s,
        path_m=sums.path_m if sums.moved == sums.slips else None,
        std_path_m=sqrt(sums.path_variance_m2) if sums.moved else None,
        speed_m_s=sums.path_m / slip_s if slip_s > 0 else None,
        std_speed_m_s=sqrt(sums.speed_variance_m2) / slip_s if slip_s > 0 else None,
        turn_rad=sums.turn_rad if sums.slips and not isnan(sums.turn_rad) else None,
    )
