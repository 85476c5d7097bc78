"""The contact stage: split the contacts of a pad, check that what is left is rigid, and describe each contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taxelflow.contacts.moments import FeatureExtractor
from taxelflow.contacts.rigidity import RigidityMonitor
from taxelflow.contacts.skin_memory import SkinMemory
from taxelflow.contacts.split import ContactSplitter
from taxelflow.contacts.texture import TextureMeter
from taxelflow.messages import Bools, Contacts, Scans, Texture

if TYPE_CHECKING:
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedScans:
    """Scans after segmentation.

    scans: as conditioned, but each split contact holds its own taxels only. moved_apart: (scans, pads), where contacts
    of the pad have moved relative to each other since it was touched; remembered: where the skin may remember all that
    it reads. contacts: features of every pad's contact. texture: what its pattern shows.
    """

    scans: Scans
    moved_apart: Bools
    remembered: Bools
    contacts: Contacts
    texture: Texture

    @property
    def unfit(self) -> Bools:
        """(scans, pads), where readings are not those of one rigid object."""
        return self.moved_apart | self.remembered


class ContactSession:
    """Segments scan after scan; the result does not depend on how the scans are cut into blocks."""

    def __init__(self, sensor: Sensor, threshold: float, on: float, off: float, *, stream: bool) -> None:
        """threshold, stream: see `ContactFeatures`. on, off: see `Conditioner.contact_on` and `contact_off`."""
        layout = sensor.layout
        self._splitter = ContactSplitter(layout, on, off) if (layout.contact_of >= 0).any() else None
        self._monitor = RigidityMonitor(layout, on, off, at_once=stream)
        self._features = FeatureExtractor(sensor, threshold)
        self._texture, self._memory = TextureMeter(layout), SkinMemory(layout)

    @property
    def notes(self) -> list[str]:
        """One sentence for each pad on which contacts have moved apart, and one on what skins may have remembered."""
        return [*self._monitor.notes, *self._memory.notes]

    def step(self, scans: Scans) -> SegmentedScans:
        """Segment the scans that follow those of the last call. The input is left unchanged."""
        if self._splitter is not None:
            scans = self._splitter.step(scans)
        contacts = self._features.step(scans)
        moved_apart, remembered = self._monitor.step(scans), self._memory.step(scans.t_s, contacts.peak)
        return SegmentedScans(scans, moved_apart, remembered, contacts, self._texture.step(scans))
