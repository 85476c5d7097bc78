"""Sources of other packages: what they yield is checked, and one that loses its device is opened again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.devices.base import Arrival, Backoff, Faults
from taxelflow.acquire.devices.streams import words
from taxelflow.errors import SourceUnreachable
from taxelflow.runtime import registry

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Self

    from taxelflow.acquire.devices.base import Source
    from taxelflow.runtime.addresses import Address
    from taxelflow.sensors.sensor import Sensor

_NEEDED = {"recording": Recording, "faults": Faults, "patient": bool}
"""Attributes of a source, and what they are."""


def source_of(address: Address, sensor: Sensor | None) -> Source:
    """The source of a URL. Raises NameUnknown, PluginBroken, AddressInvalid, SensorNeeded, and what it raises."""
    made = registry.find("source", address.scheme)(address, sensor)
    return made if address.scheme in registry.PARTS["source"] else ForeignSource(address, made)


class ForeignSource:
    """A source of another package, which need not handle the loss of its device: an OSError means that."""

    def __init__(self, address: Address, source: Any) -> None:
        self._address, self._source = address, source
        self._is_open = self._lost = False
        for name, kind in _NEEDED.items():
            if not isinstance(getattr(source, name, None), kind):
                raise self._broken(f"its {type(source).__name__} needs an attribute {name}, a {kind.__name__}")
        self.recording, self.faults, self.patient = source.recording, source.faults, source.patient
        self.paced = getattr(source, "paced", True)
        self._columns = self.recording.sensor.channel_map.columns

    def _broken(self, seen: str) -> Exception:
        return registry.broken("source", self._address.scheme, TypeError(seen))

    def __enter__(self) -> Self:
        try:
            self._source.__enter__()
        except OSError as error:
            raise SourceUnreachable(self._address.url, words(error), 0.0, "check the device and the address") from error
        self._is_open = True
        return self

    def __exit__(self, *details: object) -> None:
        if self._is_open:
            self._is_open = False
            self._source.__exit__(*details)

    def __iter__(self) -> Iterator[Arrival | None]:
        backoff = Backoff()
        while True:
            try:
                if not self._is_open:
                    self.__enter__()
                yield from self._arrivals(backoff)
                return
            except (OSError, SourceUnreachable) as error:
                if not self._lost:  # else nothing has come since the loss was reported
                    seen = words(error) if isinstance(error, OSError) else str(error)
                    self.faults.report("connection lost", f"{seen}; connecting again")
                self._lost = True
                self.__exit__(None, None, None)
            yield from backoff.pause()

    def _arrivals(self, backoff: Backoff) -> Iterator[Arrival | None]:
        for arrival in self._source:
            if arrival is None:
                yield None
                continue
            if self._lost:
                self._lost = False
                self.faults.report("connected again", self._address.url)
            backoff.restart()
            if (checked := self._checked(arrival)) is not None:
                yield checked

    def _checked(self, arrival: Any) -> Arrival | None:
        """A scan as `Source` promises it; None if it does not fit the sensor."""
        try:
            arrived_s, t_s, numbers = arrival
            values = np.asarray(numbers, dtype=np.float64)
            checked = Arrival(float(arrived_s), None if t_s is None else float(t_s), values)
        except (TypeError, ValueError) as error:
            raise self._broken(f"it yields a {type(arrival).__name__}, not an Arrival of numbers: {error}") from error
        if values.shape != (self._columns,):
            self.faults.count("bad scan", f"values of shape {values.shape}, {self._columns} expected")
            return None
        return checked
