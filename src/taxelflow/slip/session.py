"""The slip monitor at work: kernels, their memory, and the events that they amount to."""

from __future__ import annotations

from math import isnan, nan
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Event, Floats, Slips
from taxelflow.slip.detector import CALM, MEMORY, NOTE, follow
from taxelflow.slip.ending import MOST_STOPS, STOP
from taxelflow.slip.onset import MOST_RAMPS, RAMP
from taxelflow.slip.rest_filter import ENERGY, FREEDOM

if TYPE_CHECKING:
    from taxelflow.slip.parameters import SlipMonitor


class SlipSession:
    """Remembers, per pad, where the object rests or how it slips, and how much its pose scatters."""

    def __init__(self, parameters: SlipMonitor, pads: tuple[str, ...]) -> None:
        count = len(pads)
        self._pads, self._numbers = pads, np.array(parameters.numbers)
        self._memory = np.zeros((count, MEMORY))
        self._ramps = np.zeros((count, MOST_RAMPS, RAMP))
        self._stops = np.zeros((count, MOST_STOPS, STOP))
        self._contact = np.zeros((1, count), dtype=np.bool_)
        self._slipping = np.zeros((1, count), dtype=np.bool_)

    @property
    def scatter(self) -> Floats:
        """(pads,): how many times larger than their covariance says the poses scatter while the object is still, as
        standard deviations; 1 until poses have been seen.
        """
        calm = self._memory[:, CALM:]
        seen = calm[:, FREEDOM] > 0
        return np.sqrt(np.where(seen, calm[:, ENERGY] / np.where(seen, calm[:, FREEDOM], 1.0), 1.0))

    def step(self, slips: Slips) -> tuple[Bools, list[Event]]:
        """Slipping (scans, pads), and what began or ended, in time order."""
        slipping = np.empty(slips.contact.shape, dtype=np.bool_)
        notes = np.full((*slips.contact.shape, NOTE), nan)
        follow(
            slips.t_s,
            slips.contact,
            slips.displacement,
            slips.displacement_covariance,
            slips.pose,
            slips.covariance,
            slips.lag_s,
            slips.load,
            slips.disturbance,
            slips.quality,
            self._numbers,
            self._memory,
            self._ramps,
            self._stops,
            slipping,
            notes,
        )
        contact = np.concatenate([self._contact, slips.contact])
        slips_now = np.concatenate([self._slipping, slipping])
        self._contact, self._slipping = contact[-1:], slips_now[-1:]
        changed = (contact[1:] != contact[:-1]) | (slips_now[1:] != slips_now[:-1])
        if not changed.any():
            return slipping, []
        events = []
        for scan, pad in zip(*(place.tolist() for place in np.nonzero(changed)), strict=True):
            t_s, name, note = float(slips.t_s[scan]), self._pads[pad], notes[scan, pad]
            touched, touches = contact[scan, pad], contact[scan + 1, pad]
            slipped, slips_on = slips_now[scan, pad], slips_now[scan + 1, pad]
            if touches and not touched:
                events.append(Event(t_s, name, "contact"))
            if slips_on != slipped:
                events.append(_slip(t_s, name, "slip_start" if slips_on else "slip_stop", note))
            if touched and not touches:
                events.append(Event(t_s, name, "release"))
        return slipping, events

    def finish(self) -> tuple[Bools, list[Event]]:
        """Nothing is held back."""
        return np.zeros((0, len(self._pads)), dtype=np.bool_), []


def _slip(t_s: float, pad: str, kind: str, note: Floats) -> Event:
    when, vx, vy, turn = (float(value) for value in note)
    known = not isnan(vx)
    return Event(
        t_s,
        pad,
        kind,
        t_s if isnan(when) else when,
        float(np.arctan2(vy, vx)) if known else nan,
        float(np.hypot(vx, vy)) if known else nan,
        nan if isnan(turn) else turn,  # one and the same NaN: events that say the same are equal
    )
