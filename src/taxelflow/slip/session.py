"""The slip detector of all pads: state from block to block, and the events."""

from __future__ import annotations

from math import isnan, nan
from typing import Any, NamedTuple

import numpy as np

from taxelflow.messages import Bools, Event, Floats, Slips
from taxelflow.numerics.records import Records, record_dtype, records
from taxelflow.runtime.blocks import is_block
from taxelflow.slip.detector import Change, PadState, follow, has_flips
from taxelflow.slip.measurement import observations

_CHANGE = record_dtype(Change)


class Detected(NamedTuple):
    """By the pose. slipping: (scans, pads). events: in time order. statistic: (scans, pads), of the test, over its
    threshold: above 1 it slips; NaN where a scan was not tested.
    """

    slipping: Bools
    events: list[Event]
    statistic: Floats


class SlipSession:
    """Slip detection in a stream: each scan is decided from the scans so far."""

    def __init__(self, pads: tuple[str, ...], parameters: Records) -> None:
        """parameters: (1,) of `Parameters`."""
        count = len(pads)
        self._pads = pads
        self._parameters = parameters
        self._states = records(PadState, count)
        self._contact = np.zeros((1, count), dtype=np.bool_)
        self._slipping = np.zeros((1, count), dtype=np.bool_)

    @property
    def scatter(self) -> Floats:
        """(pads,): standard deviation of the noise at rest over that of the reported covariance; 1 before any pose."""
        rest = self._states["rest"]
        seen = rest["components"] > 0
        return np.sqrt(np.where(seen, rest["square_sum"] / np.where(seen, rest["components"], 1.0), 1.0))

    def step(self, slips: Slips) -> Detected:
        """Detect slips in the next scans."""
        slipping = np.empty(slips.contact.shape, dtype=np.bool_)
        changes = np.empty(slips.contact.shape, dtype=_CHANGE)
        follow(observations(slips), self._parameters, self._states, slipping, changes)
        changing = has_flips_in_block if is_block(len(slips), has_flips) else has_flips
        if not changing(self._contact, slips.contact) and not changing(self._slipping, slipping):
            return Detected(slipping, [], changes["statistic"])
        contact = np.concatenate([self._contact, slips.contact])
        slips_now = np.concatenate([self._slipping, slipping])
        self._contact, self._slipping = contact[-1:], slips_now[-1:]
        changed = (contact[1:] != contact[:-1]) | (slips_now[1:] != slips_now[:-1])
        events = []
        for scan, pad in zip(*(place.tolist() for place in np.nonzero(changed)), strict=True):
            t_s, name = float(slips.t_s[scan]), self._pads[pad]
            touched, touches = contact[scan, pad], contact[scan + 1, pad]
            slipped, slips_on = slips_now[scan, pad], slips_now[scan + 1, pad]
            if touches and not touched:
                events.append(Event(t_s, name, "contact"))
            if slips_on != slipped:
                events.append(_slip_event(t_s, name, "slip_start" if slips_on else "slip_stop", changes[scan, pad]))
            if touched and not touches:
                events.append(Event(t_s, name, "release"))
        return Detected(slipping, events, changes["statistic"])

    def finish(self) -> Detected:
        """Nothing is held back."""
        count = len(self._pads)
        return Detected(np.zeros((0, count), dtype=np.bool_), [], np.zeros((0, count)))


def has_flips_in_block(last: Bools, flags: Bools) -> bool:
    """`has_flips` in NumPy."""
    return bool(len(flags) and ((flags[0] != last[0]).any() or (flags[1:] != flags[:-1]).any()))


def _slip_event(t_s: float, pad: str, kind: str, change: Any) -> Event:
    """Event of a record `Change`."""
    onset_s, (vx, vy, yaw_rate) = float(change["onset_s"]), change["velocity"].tolist()
    known = not isnan(vx)
    return Event(
        t_s,
        pad,
        kind,
        t_s if isnan(onset_s) else onset_s,
        float(np.arctan2(vy, vx)) if known else nan,
        float(np.hypot(vx, vy)) if known else nan,
        nan if isnan(yaw_rate) else yaw_rate,  # one and the same NaN: events of equal content are equal
    )
