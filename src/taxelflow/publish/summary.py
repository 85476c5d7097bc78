"""What ran, on what, and what came of it: `summary.json`."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from taxelflow.messages import Bools, Event, Slips
    from taxelflow.sensors.layout import Layout

_KNOWN = 0.5
"""Standard deviation, in pitches, up to which a displacement counts as known."""


class PadSummary(msgspec.Struct, frozen=True):
    """One pad over the whole recording. Lengths in m, in the pad's frame."""

    contact_scans: int
    tared: bool
    noise: float | None
    """Median over taxels, in the summary's unit; None if every taxel is masked."""
    slip_path_m: float
    """Length of the way that the object went while slipping."""
    net_m: tuple[float | None, float | None]
    """Sum of all displacements along x and y; None along an axis where most of them are not known within half a pitch,
    as along the row of a pad of one column."""
    border_share: float
    """Share of contact scans that touch a border of the pad, where the paper's methods are biased."""
    slips: int
    scatter: float
    """Scatter of the pose of a still object over the standard deviation of its covariance, learned by the slip
    detector; 1 if it learned nothing."""


class Summary(msgspec.Struct, frozen=True):
    """The content of `summary.json`."""

    taxelflow: str
    input: str
    format: str
    sensor: str
    unit: str
    method: str
    mode: str
    parameters: dict[str, Any]
    scans: int
    repeated_scans_dropped: int
    t_first_s: float
    t_last_s: float
    contact: bool
    masked_taxels: list[int]
    pads: dict[str, PadSummary]
    events: dict[str, int]
    notes: list[str]
    layout: Sensor
    """The sensor in full, so that a result can be drawn without its recording."""
    loss: str | None = None
    """What could not be read of a truncated recording."""
    repeated_values_dropped: int = 0
    """Scans with a new stamp that repeat the one before bit for bit, though their readings are too noisy to."""
    rate_hz: float | None = None
    """Usual rate of scans that are new."""
    gaps: int = 0
    """Time steps far above the usual one; no motion is followed across them."""


class Totals:
    """Sums over the blocks of a run."""

    def __init__(self, layout: Layout) -> None:
        count = len(layout.pads)
        self.pads = layout.pads
        self._surely_m = _KNOWN * layout.pitch_m
        self.scans = 0
        self.t_first_s = self.t_last_s = float("nan")
        self.contact_scans = np.zeros(count, dtype=np.int64)
        self.border_scans = np.zeros(count, dtype=np.int64)
        self.slip_path_m = np.zeros(count)
        self.net_m = np.zeros((count, 2))
        self._steps, self._known = np.zeros((count, 1), np.int64), np.zeros((count, 2), np.int64)
        self.slips: Counter[str] = Counter()
        self.events: Counter[str] = Counter(contact=0, release=0, slip_start=0, slip_stop=0, slip_suspected=0)

    def add(self, slips: Slips, slipping: Bools, events: list[Event]) -> None:
        """Count one block in. slipping: (scans, pads)."""
        if not self.scans:
            self.t_first_s = float(slips.t_s[0])
        self.t_last_s = float(slips.t_s[-1])
        self.scans += len(slips)
        self.contact_scans += slips.contact.sum(axis=0)
        self.border_scans += (slips.border.any(axis=2) & slips.contact).sum(axis=0)
        steps = np.where(slips.valid[..., np.newaxis], slips.displacement[..., :2], 0.0)
        self.slip_path_m += np.sum(np.hypot(steps[..., 0], steps[..., 1]), axis=0, where=slipping)
        std = np.sqrt(np.diagonal(slips.displacement_covariance, axis1=2, axis2=3)[..., :2])
        known = slips.valid[..., np.newaxis] & (std <= self._surely_m)
        self.net_m += steps.sum(axis=0)
        self._known += known.sum(axis=0)
        self._steps += slips.valid.sum(axis=0)[:, np.newaxis]
        self.events.update(event.event for event in events)
        self.slips.update(event.pad for event in events if event.event == "slip_start")

    def of_pad(self, pad: int, *, tared: bool, noise: float | None, scatter: float) -> PadSummary:
        """The sums of pad number `pad`."""
        contact = int(self.contact_scans[pad])
        mostly = 2 * self._known[pad] >= self._steps[pad]
        x, y = (float(m) if known else None for m, known in zip(self.net_m[pad], mostly, strict=True))
        return PadSummary(
            contact_scans=contact,
            tared=tared,
            noise=noise,
            slip_path_m=float(self.slip_path_m[pad]),
            net_m=(x, y),
            border_share=int(self.border_scans[pad]) / contact if contact else 0.0,
            slips=self.slips[self.pads[pad]],
            scatter=scatter,
        )


def to_json(value: object) -> bytes:
    """Indented JSON of any summary or score, with a final newline."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
