"""`summary.json`: input, parameters, counts and results of a run."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from taxelflow.publish.contact_summary import ContactSummary, ContactTotals
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from taxelflow.messages import Event, Slips
    from taxelflow.sensors.layout import Layout


class PadSummary(msgspec.Struct, frozen=True):
    """One pad over the whole recording. Lengths in m, in the pad's frame."""

    contact_scans: int
    tared: bool
    noise: float | None
    """Median over taxels, in the summary's unit; None if every taxel is masked."""
    slip_path_m: float | None
    """Length of the path of all slips; None if it is not known of one of them."""
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
    """Number of events of each kind on the pads; those of groups and separate contacts, which lie on the pads, are not
    counted."""
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
    contacts: list[ContactSummary] = []
    """All contacts of pads, groups and separate contacts in the order of their begin."""
    asked: dict[str, Any] = {}
    """What the recording was read with, beside its sensor: `topic` of a bag, `columns` of a table."""
    joints: dict[str, list[float]] = {}
    """Smallest and largest angle of each joint of the hand during the scans, rad (m for a slide), if any is known."""


class Totals:
    """Sums over the blocks of a run."""

    def __init__(self, layout: Layout) -> None:
        count = len(layout.pads)
        self.pads = layout.pads
        self._own = set(layout.pads[: layout.pad_count])
        self.scans = 0
        self.t_first_s = self.t_last_s = float("nan")
        self.contact_scans = np.zeros(count, dtype=np.int64)
        self.border_scans = np.zeros(count, dtype=np.int64)
        self._each = ContactTotals(layout.pads, layout.pitch_m)
        self.events: Counter[str] = Counter(contact=0, release=0, slip_start=0, slip_stop=0, slip_suspected=0)

    def add(self, slips: Slips, events: list[Event]) -> None:
        """Count one block in."""
        if len(slips):
            if not self.scans:
                self.t_first_s = float(slips.t_s[0])
            self.t_last_s = float(slips.t_s[-1])
        self.scans += len(slips)
        self.contact_scans += slips.contact.sum(axis=0)
        self.border_scans += (slips.border.any(axis=2) & slips.contact).sum(axis=0)
        self._each.add(slips, events)
        self.events.update(event.event for event in events if event.pad in self._own)

    def contacts(self) -> list[ContactSummary]:
        """All contacts in the order of their begin."""
        return self._each.contacts()

    def of_pad(
        self, pad: int, contacts: list[ContactSummary], *, tared: bool, noise: float | None, scatter: float
    ) -> PadSummary:
        """The sums of pad number `pad`. contacts: of all pads."""
        scans = int(self.contact_scans[pad])
        own = [contact for contact in contacts if contact.pad == self.pads[pad]]
        paths = [contact.path_m for contact in own]
        known = [path for path in paths if path is not None]
        return PadSummary(
            contact_scans=scans,
            tared=tared,
            noise=noise,
            slip_path_m=sum(known) if len(known) == len(paths) else None,
            border_share=int(self.border_scans[pad]) / scans if scans else 0.0,
            slips=sum(contact.slips for contact in own),
            scatter=scatter,
        )


def to_json(value: object) -> bytes:
    """Indented JSON of any summary or score, with a final newline."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
