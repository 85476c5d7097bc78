"""Contact of pads, tared readings, and missing taxels, scan by scan."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taxelflow.messages import Bools, Floats
from taxelflow.numerics.records import Records, records
from taxelflow.runtime.compiling import kernel, routine

if TYPE_CHECKING:
    from taxelflow.condition.base import ConditionSettings
    from taxelflow.sensors.layout import Layout


class PadContact:
    """Contact detection on a pad with entries start to stop.

    on, off: standard deviations of noise above which contact starts, and below which it ends.
    """

    start: int
    stop: int
    on: float
    off: float
    in_contact: bool


class Zeroed(NamedTuple):
    """What is known of the entries of a scan, all (entries,): offset, noise, and the last known reading."""

    offset: Floats
    noise: Floats
    last: Floats


class Conditioned(NamedTuple):
    """What is filled in: pressure (scans, entries), contact and complete (scans, pads)."""

    pressure: Floats
    contact: Bools
    complete: Bools


def pad_contacts(layout: Layout, parameters: ConditionSettings) -> Records:
    """`PadContact` (pads,), none in contact."""
    pads = records(PadContact, len(layout.pads))
    pads["start"], pads["stop"] = layout.starts[:-1], layout.starts[1:]
    pads["on"], pads["off"] = parameters.contact_on, parameters.contact_off
    return pads


@kernel
def condition(values: Floats, gap: Bools, entries: Zeroed, pads: Records, out: Conditioned) -> None:
    """Fill `out` from readings in SI, and bring `entries.last` up to date.

    values: (scans, entries). gap: (scans,), time was lost before this scan: no pad is complete in it. pads:
    `PadContact` (pads,).
    """
    for scan in range(values.shape[0]):
        for number in range(len(pads)):
            pad: PadContact = pads[number]
            whole = _condition_pad(values[scan], entries, pad, out.pressure[scan])
            out.contact[scan, number] = pad.in_contact
            out.complete[scan, number] = whole and not gap[scan]


@routine
def _condition_pad(values: Floats, entries: Zeroed, pad: PadContact, pressure: Floats) -> bool:
    """Fill pressure (entries,) of one pad and bring its contact up to date. Returns False if a loaded taxel is missing.

    A masked taxel (noise 0) reads 0. A missing one (not finite) reads 0 as well; it is loaded if it was last. Where all
    are missing, as of a pad that is late or slower than others, contact stays as it was.
    """
    offset, noise, last = entries
    total = variance = peak = 0.0
    whole, missing, known = True, False, False
    for k in range(pad.start, pad.stop):
        reading = 0.0
        if noise[k] > 0.0:
            reading = values[k] - offset[k]
            if np.isfinite(reading):
                known = True
                last[k] = reading
                total += reading
                variance += noise[k] ** 2 if reading != 0.0 else 0.0
                peak = max(peak, reading / noise[k])
            else:
                reading, missing = 0.0, True
                whole = whole and last[k] <= pad.off * noise[k]
        pressure[k] = reading
    if known or not missing:
        level = pad.off if pad.in_contact else pad.on
        pad.in_contact = peak > level and total > level * np.sqrt(variance)
    return whole
