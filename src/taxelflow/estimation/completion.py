"""Estimates become slips: contact, border, load and the quality of cut contacts are no duty of a method."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taxelflow.errors import EstimatorBroken
from taxelflow.messages import Footprint, Slips, cut, joined, no_scans
from taxelflow.sensors.border import Boundary

if TYPE_CHECKING:
    from taxelflow.estimation.base import Estimator, EstimatorSession, Mode
    from taxelflow.messages import Estimates, Scans
    from taxelflow.sensors.layout import Layout


def start_slips(estimator: Estimator, layout: Layout, mode: Mode) -> SlipsSession:
    """Begin a session of an estimator that gives slips."""
    return SlipsSession(estimator.start(layout, mode), layout)


class SlipsSession:
    """A `SlipSource` made of an estimator's session. Footprints wait for estimates that are held back."""

    def __init__(self, session: EstimatorSession, layout: Layout) -> None:
        self._session, self._boundary = session, Boundary(layout)
        self._none = self._footprint(no_scans(layout.entries, len(layout.pads)))  # compiles the kernels
        self._held: list[Footprint] = []

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; fewer rows than scans where the estimator holds some back. Raises EstimatorBroken."""
        self._held.append(self._footprint(scans))
        return self._completed(self._session.step(scans))

    def finish(self) -> Slips:
        """Slips that the estimator has held back. Raises EstimatorBroken."""
        return self._completed(self._session.finish())

    def _footprint(self, scans: Scans) -> Footprint:
        border, load = self._boundary.step(scans)
        return Footprint(scans.t_s, scans.contact, border, load)

    def _completed(self, estimates: Estimates) -> Slips:
        footprint, count = joined(self._held or [self._none]), len(estimates)
        if count > len(footprint):
            raise EstimatorBroken(type(self._session).__name__, count, len(footprint))
        if count == len(footprint):
            self._held = []
            return Slips.of(footprint, estimates)
        self._held = [cut(footprint, count, len(footprint))]
        return Slips.of(cut(footprint, 0, count), estimates)
