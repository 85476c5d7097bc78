"""Sessions that smooth the poses of another session: causal, or a contact at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.smoothing.filter import STATES, Memory, Smoothed, run_filter, run_smoother
from taxelflow.messages import LOST, cut, joined
from taxelflow.numerics.records import records

if TYPE_CHECKING:
    from taxelflow.estimation.base import SlipSource
    from taxelflow.messages import Bools, Floats, Scans, Slips
    from taxelflow.numerics.records import Records
    from taxelflow.sensors.layout import Layout

_WINDOW = 2000
"""Scans: a contact that lasts twice as many is smoothed in windows of this length."""


class Track:
    """Poses of one pad, and what the filter and the smoother make of them; arrays as in `filter`."""

    def __init__(self, tau: Floats, pose: Floats, noise: Floats, touched: Bools) -> None:
        self._tau, self._pose, self._noise, self._touched = tau, pose, noise, touched
        self.rows = records(Smoothed, len(tau))
        for name in ("state", "covariance", "before", "before_covariance", "moved_covariance", "span_s"):
            self.rows[name] = np.nan

    @classmethod
    def of(cls, slips: Slips, pad: int) -> Track:
        """The track of a pad. A pose counts at the time that it is of; one that is lost ends the track."""
        touched = slips.contact[:, pad] & (slips.quality[:, pad] != LOST)
        pose, noise = (np.ascontiguousarray(part[:, pad]) for part in (slips.pose, slips.covariance))
        return cls(slips.t_s - np.nan_to_num(slips.lag_s[:, pad]), pose, noise, touched)

    def filter(self, density: Floats, memory: Records, start: int, stop: int) -> None:
        """Filter rows start to stop; memory: (1,) of `Memory` is changed."""
        own = slice(start, stop)
        run_filter(
            self._tau[own], self._pose[own], self._noise[own], self._touched[own], density, memory, self.rows[own]
        )

    def smooth(self, density: Floats) -> None:
        """Smooth all rows, which were filtered."""
        run_smoother(self._tau, density, self.rows)

    def write(self, out: Slips, pad: int, first: int, count: int, before: Floats) -> None:
        """Put the first `count` rows, and the way to the next, into `out` from row `first` on, where that has numbers.

        before: (scans, 6), the state of the pose before each, NaN where there is none.
        """
        rows, part = slice(first, first + count), self.rows[:count]
        known = np.isfinite(part["state"][:, 0])
        _put(out.pose[rows, pad], known, part["state"][:, :3])
        _put(out.covariance[rows, pad], known, part["covariance"][:, :3, :3])
        upto = min(count + 1, len(before))
        rows, part, before = slice(first, first + upto), self.rows[:upto], before[:upto]
        known = np.isfinite(before[:, 0]) & np.isfinite(part["span_s"])
        _put(out.displacement[rows, pad], known, (part["state"] - before)[:, :3])
        _put(out.displacement_covariance[rows, pad], known, part["moved_covariance"])
        known &= np.isfinite(out.displacement[rows, pad, 0])
        out.span_s[rows, pad][known] = part["span_s"][known]


def _put(out: Floats, rows: Bools, values: Floats) -> None:
    """Replace the numbers that are there by values, in these rows."""
    where = np.isfinite(out) & rows.reshape(-1, *[1] * (out.ndim - 1))
    out[where] = values[where]


def _copied(slips: Slips) -> Slips:
    """Slips whose poses may be changed."""
    changed = ("pose", "covariance", "displacement", "displacement_covariance", "span_s")
    return replace(slips, **{name: getattr(slips, name).copy() for name in changed})


def _densities(layout: Layout, pad: int, acceleration_m_s2: float) -> Floats:
    """(3,) spectral densities of acceleration, see `Smoothing`."""
    own = layout.of_pad(pad)
    size = layout.pitch_m[pad] ** 2 / 12.0
    gyration = float(layout.x_m[own].var() + layout.y_m[own].var() + size.sum())
    return acceleration_m_s2**2 * np.array([1.0, 1.0, 1.0 / gyration])


class FilterSession:
    """Poses and displacements given all scans so far."""

    def __init__(self, session: SlipSource, layout: Layout, acceleration_m_s2: float) -> None:
        self._session = session
        self._density = [_densities(layout, pad, acceleration_m_s2) for pad in range(len(layout.pads))]
        self._memory = [records(Memory, 1) for _ in layout.pads]
        track = Track(np.arange(2.0), np.zeros((2, 3)), np.stack([np.eye(3)] * 2), np.ones(2, dtype=np.bool_))
        track.filter(self._density[0], records(Memory, 1), 0, 2)
        track.smooth(self._density[0])  # compiled by now

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; see `SlipSource.step`."""
        return self._smoothed(self._session.step(scans))

    def finish(self) -> Slips:
        """What the other session held back."""
        return self._smoothed(self._session.finish())

    def _smoothed(self, slips: Slips) -> Slips:
        out = _copied(slips)
        for pad, density in enumerate(self._density):
            track = Track.of(slips, pad)
            track.filter(density, self._memory[pad], 0, len(slips))
            track.write(out, pad, 0, len(slips), track.rows["before"])
        return out


class SmootherSession(FilterSession):
    """Poses and displacements given all scans of a contact, held back until it ends."""

    def __init__(self, session: SlipSource, layout: Layout, acceleration_m_s2: float) -> None:
        super().__init__(session, layout, acceleration_m_s2)
        pads = len(layout.pads)
        self._held: Slips | None = None
        self._out: Slips | None = None
        self._seen = [0] * pads  # rows of each pad, counted in what is held, that were looked at
        self._first: list[int | None] = [None] * pads  # the first row of a contact that is not smoothed yet

    def finish(self) -> Slips:
        """Contacts that last to the end of the stream."""
        self._take(self._session.finish())
        for pad, first in enumerate(self._first):
            if first is not None:
                self._settle(pad, first, self._seen[pad], self._seen[pad])
                self._first[pad] = None
        return self._given()

    def _smoothed(self, slips: Slips) -> Slips:
        self._take(slips)
        return self._given()

    def _take(self, slips: Slips) -> None:
        parts = [slips] if self._held is None else [self._held, slips]
        self._held = joined(parts)
        self._out = joined([_copied(slips)] if self._out is None else [self._out, _copied(slips)])
        for pad in range(len(self._density)):
            contact = self._held.contact[:, pad]
            for row in range(self._seen[pad], len(contact)):
                self._follow(pad, row, touched=bool(contact[row]))
            self._seen[pad] = len(contact)

    def _follow(self, pad: int, row: int, *, touched: bool) -> None:
        """Open a contact at this row, smooth one that has ended, or the first window of one that lasts."""
        first = self._first[pad]
        if not touched:
            if first is not None:
                self._settle(pad, first, row, row)
            self._first[pad], self._memory[pad]["running"] = None, False
        elif first is None:
            self._first[pad] = row
        elif row + 1 - first == 2 * _WINDOW:
            self._settle(pad, first, row + 1, first + _WINDOW)
            self._first[pad] = first + _WINDOW

    def _settle(self, pad: int, first: int, stop: int, known: int) -> None:
        """Smooth rows first to stop of a pad, and keep those up to `known`."""
        if self._held is None or self._out is None:
            return
        track = Track.of(cut(self._held, first, stop), pad)
        count, memory = known - first, self._memory[pad]
        track.filter(self._density[pad], memory, 0, count)
        track.filter(self._density[pad], memory.copy(), count, stop - first)
        track.smooth(self._density[pad])
        states = track.rows["state"]
        before = np.concatenate([np.full((1, STATES), np.nan), states[:-1]])
        for row in np.flatnonzero(np.isnan(states[:, 0])):  # a pose that is missing is passed over
            if row + 1 < len(before):
                before[row + 1] = before[row]
        track.write(self._out, pad, first, count, before)

    def _given(self) -> Slips:
        if self._held is None or self._out is None:
            raise RuntimeError("nothing was taken in before something was given out")
        stop = min([first for first in self._first if first is not None] + [len(self._held)])
        out = cut(self._out, 0, stop)
        self._held, self._out = cut(self._held, stop, len(self._held)), cut(self._out, stop, len(self._out))
        self._seen = [seen - stop for seen in self._seen]
        self._first = [None if first is None else first - stop for first in self._first]
        return out
