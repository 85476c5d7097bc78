"""The slip monitor at work: a test per scan, latched."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.messages import Bools, Event, Floats, Slips

if TYPE_CHECKING:
    from taxelflow.monitor.slip import SlipMonitor


class HysteresisSession:
    """Remembers, per pad, whether it was in contact and slipping."""

    def __init__(self, parameters: SlipMonitor, pads: tuple[str, ...]) -> None:
        self._parameters, self._pads = parameters, pads
        self._contact = np.zeros((1, len(pads)), dtype=np.bool_)
        self._slipping = np.zeros((1, len(pads)), dtype=np.bool_)

    def step(self, slips: Slips) -> tuple[Bools, list[Event]]:
        """Slipping (scans, pads), and what began or ended, in time order."""
        size = significance(slips)
        on = size > self._parameters.start
        off = ~(size > self._parameters.stop)  # an unknown displacement is no slip
        slipping = _latched(on, off, self._slipping)
        contact = np.concatenate([self._contact, slips.contact])
        changes = {
            "contact": contact[1:] & ~contact[:-1],
            "slip_start": slipping[1:] & ~slipping[:-1],
            "slip_stop": slipping[:-1] & ~slipping[1:],
            "release": contact[:-1] & ~contact[1:],
        }
        found = [
            (scan, order, pad, kind)
            for order, (kind, happened) in enumerate(changes.items())
            for scan, pad in zip(*np.nonzero(happened), strict=True)
        ]
        self._contact, self._slipping = contact[-1:], slipping[-1:]
        return slipping[1:], [
            Event(float(slips.t_s[scan]), self._pads[pad], kind) for scan, _, pad, kind in sorted(found)
        ]


def significance(slips: Slips) -> Floats:
    """(scans, pads): displacement over its standard deviation along its own direction; NaN where unknown.

    Where the method knows rotation, the larger of the translation's and the rotation's; where it has no direction, its
    disturbance.
    """
    d = slips.displacement[..., :2]
    along = np.einsum("spi,spij,spj->sp", d, slips.displacement_covariance[..., :2, :2], d)
    squared = np.sum(d * d, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        translation = np.where(squared > 0, squared / np.sqrt(along), 0.0 * squared)
        turn = slips.displacement[..., 2]
        rotation = np.abs(turn) / np.sqrt(slips.displacement_covariance[..., 2, 2])
    larger: Floats = np.fmax(np.fmax(translation, rotation), slips.disturbance)
    return larger


def _latched(on: Bools, off: Bools, before: Bools) -> Bools:
    """Hysteresis along axis 0, with the row `before` in front: set by on, cleared by off, else as before."""
    decided = np.concatenate([np.ones_like(before), on | off])
    rows = np.arange(len(decided))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(decided, rows, 0), axis=0)
    state: Bools = np.take_along_axis(np.concatenate([before, on]), last, axis=0)
    return state
