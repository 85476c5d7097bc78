"""The protocol of a conditioner's parameters, as its session reads them: the fields of `Conditioner`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence


class ConditionSettings(Protocol):
    """See `Conditioner` for meaning, unit and range of each."""

    @property
    def tare(self) -> str:
        """auto, start or none."""
        ...

    @property
    def mask(self) -> str:
        """auto, none or a list of taxels."""
        ...

    @property
    def off(self) -> Sequence[int]:
        """Taxels that `mask` lists."""
        ...

    @property
    def drift(self) -> str:
        """Whether the baseline of idle pads is followed."""
        ...

    @property
    def repeats(self) -> str:
        """Whether repeated scans are dropped."""
        ...

    @property
    def lowpass_hz(self) -> float:
        """Cut-off of the filter over time; 0: none."""
        ...

    @property
    def median_scans(self) -> int:
        """Length of the median over time; 1: none."""
        ...

    @property
    def contact_on(self) -> float:
        """Threshold above which a pad comes into contact, in standard deviations."""
        ...

    @property
    def contact_off(self) -> float:
        """Threshold below which a contact ends, in standard deviations."""
        ...
