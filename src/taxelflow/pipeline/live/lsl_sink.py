"""Results as streams of Lab Streaming Layer: `lsl:NAME`.

NAME: the columns of object.csv, then 1 for each pad that slips, else 0; unknown is NaN. NAME-events: markers, JSON.
Stamps are LSL's clock when the scan arrived, so that recorders align them with other streams; t_s is the sensor's.
Programs on other machines find the streams with `?scope=link` or `site`.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import msgspec

from taxelflow.acquire.devices.lsl import linger, pylsl
from taxelflow.publish.columns import OBJECT, motion_rows
from taxelflow.publish.sinks.base import ResultSink
from taxelflow.publish.sinks.lines import event_row

if TYPE_CHECKING:
    from taxelflow.publish.sinks.base import Ending, Head, Update
    from taxelflow.runtime.addresses import Address


class LslSink(ResultSink):
    """Sends to all who read; who reads later misses what was before."""

    lossless = False
    dropped = 0

    def __init__(self, address: Address) -> None:
        self._name, self._lsl = address.need_path("lsl:NAME"), pylsl(address)

    def open(self, head: Head) -> None:
        """See `Sink`."""
        labels = [*OBJECT, *(f"slipping_{pad}" for pad in head.pads)]
        self._behind_s = time.monotonic() - self._lsl.local_clock()
        motion = self._info(self._name, "Motion", len(labels), self._lsl.cf_double64)
        channels = motion.desc().append_child("channels")
        for label in labels:
            channels.append_child("channel").append_child_value("label", label)
        self._motion = self._lsl.StreamOutlet(motion)
        self._events = self._lsl.StreamOutlet(self._info(f"{self._name}-events", "Markers", 1, self._lsl.cf_string))

    def _info(self, name: str, kind: str, channels: int, form: int) -> Any:
        return self._lsl.StreamInfo(name, kind, channels, self._lsl.IRREGULAR_RATE, form, f"taxelflow-{name}")

    def write(self, update: Update) -> None:
        """See `Sink`."""
        stamps = (update.arrived_s - self._behind_s).tolist()
        slipping = update.output.slipping.astype(float).tolist()
        for stamp, row, slips in zip(stamps, motion_rows(update.output.motions), slipping, strict=True):
            self._motion.push_sample([*row, *slips], stamp)
        for event in update.output.events:
            self._events.push_sample([msgspec.json.encode(event_row(event)).decode()], stamps[-1])

    def hurry(self) -> None:
        """Nothing is waited for."""

    def close(self, _ending: Ending) -> None:
        """See `Sink`."""
        linger(self._motion, self._events)
        del self._motion, self._events


def write(address: Address) -> LslSink:
    """`lsl:NAME?scope=machine`. Raises AddressInvalid, ExtraMissing."""
    address.check_options(("scope",))
    return LslSink(address)
