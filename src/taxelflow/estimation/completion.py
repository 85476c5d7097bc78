"""Completes a method's estimates to slips, with all that depends on scan and layout only.

That is contact, border, load, the quality of contacts that are cut or form, and the error that noise does not show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.errors import EstimatorBroken
from taxelflow.estimation.base import Scaled, SkinAware
from taxelflow.estimation.unseen_error import UnseenError
from taxelflow.messages import (
    AMBIGUOUS,
    NO_POSE,
    OK,
    Bools,
    Bytes,
    Estimates,
    Floats,
    Footprint,
    Slips,
    cut,
    joined,
    no_scans,
)
from taxelflow.numerics.forming import find_forming
from taxelflow.runtime.compiling import kernel
from taxelflow.sensors.border import Boundary

if TYPE_CHECKING:
    from taxelflow.estimation.base import Estimator, EstimatorSession, Mode
    from taxelflow.messages import Scans
    from taxelflow.sensors.layout import Layout

_SHAPES = {
    "displacement": (3,),
    "pose": (3,),
    "covariance": (3, 3),
    "displacement_covariance": (3, 3),
    "span_s": (),
    "lag_s": (),
    "disturbance": (),
    "quality": (),
}
"""Shapes of an estimator's results, after scans and pads."""


_FORM = "Estimates.unknown(scans), with what is known filled in"


def start_slips(estimator: Estimator, layout: Layout, mode: Mode) -> SlipsSession:
    """Begin a session of an estimator that gives slips."""
    return SlipsSession(estimator.start(layout, mode), layout)


def judges(session: EstimatorSession) -> bool:
    """Whether a session's covariance holds what sensor and border hide, so that it judges its own poses."""
    return isinstance(session, SkinAware) and session.holds_unseen_error


class SlipsSession:
    """A `SlipSource` made of an estimator's session. Footprints wait for estimates that are held back."""

    def __init__(self, session: EstimatorSession, layout: Layout) -> None:
        for name in ("step", "finish"):
            if not hasattr(session, name):
                remedy = "start must return a session with step and finish"
                raise EstimatorBroken(type(session).__name__, f"no method {name}", remedy)
        self._session, self._boundary = session, Boundary(layout)
        gains = session.gains if isinstance(session, Scaled) else np.ones((len(layout.pads), 2))
        self._unseen = UnseenError(layout, gains) if layout.unseen_error and not judges(session) else None
        self._none = self._footprint(no_scans(layout.entries, len(layout.pads)))  # compiles the kernels
        pads = self._none.border.shape
        self._forms = np.zeros((pads[1], 4)) if layout.unseen_error else None
        self._judged(Slips.of(self._none, Estimates.unknown(no_scans(layout.entries, pads[1]))))
        self._held: list[Footprint] = []
        self._checked = False

    @property
    def judges(self) -> bool:
        """Whether the estimator judges its own poses, see `judges`."""
        return judges(self._session)

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; fewer rows than scans where the estimator holds some back. Raises EstimatorBroken."""
        self._held.append(self._footprint(scans))
        return self._completed(self._session.step(scans))

    def finish(self) -> Slips:
        """Slips that the estimator has held back. Raises EstimatorBroken."""
        slips = self._completed(self._session.finish())
        if left := sum(map(len, self._held)):
            seen, remedy = f"no estimates of the last {left} scans", "step and finish must give one row per scan"
            raise EstimatorBroken(type(self._session).__name__, seen, remedy)
        return slips

    def _footprint(self, scans: Scans) -> Footprint:
        border, load = self._boundary.step(scans)
        unseen = None if self._unseen is None else self._unseen.of(scans)
        return Footprint(scans.t_s, scans.contact, border, load, unseen)

    def _completed(self, estimates: Estimates) -> Slips:
        self._check(estimates)
        footprint, count = joined(self._held or [self._none]), len(estimates)
        if count > len(footprint):
            seen = f"estimates of {count} scans where at most {len(footprint)} were waiting"
            remedy = "its step must give one row per scan, in order, none twice"
            raise EstimatorBroken(type(self._session).__name__, seen, remedy)
        if count == len(footprint):
            self._held = []
            return self._judged(Slips.of(footprint, estimates))
        self._held = [cut(footprint, count, len(footprint))]
        return self._judged(Slips.of(cut(footprint, 0, count), estimates))

    def _check(self, estimates: Estimates) -> None:
        """Raises EstimatorBroken for what is no estimates, or for shapes that kernels would read beyond."""
        name = type(self._session).__name__
        if not isinstance(estimates, Estimates):
            raise EstimatorBroken(name, f"a {type(estimates).__name__}", f"step and finish must return {_FORM}")
        if self._checked or not len(estimates):
            return
        for field, tail in _SHAPES.items():
            wanted, seen = (len(estimates), self._none.border.shape[1], *tail), np.shape(getattr(estimates, field))
            if seen != wanted:
                raise EstimatorBroken(name, f"{field} of shape {seen}", f"it must be {wanted}: begin with {_FORM}")
        self._checked = True

    def _judged(self, slips: Slips) -> Slips:
        """The same, those judged that their method has not, and those of contacts that form."""
        judge_cut(slips.pose, slips.border, slips.quality)
        if self._forms is not None:
            forming = np.empty(slips.contact.shape, dtype=np.bool_)
            find_forming(slips.t_s, slips.contact, slips.load, slips.border, self._forms, forming)
            slips.quality[forming & (slips.quality == OK)] = AMBIGUOUS
        return slips


@kernel
def judge_cut(pose: Floats, border: Bools, quality: Bytes) -> None:
    """A pose that its method has not judged is ambiguous where its contact is cut, else ok.

    pose: (scans, pads, 3). border: (scans, pads, 2). quality: (scans, pads), index in `QUALITY`, updated.
    """
    for scan in range(quality.shape[0]):
        for pad in range(quality.shape[1]):
            if quality[scan, pad] == NO_POSE and np.isfinite(pose[scan, pad, 0]):
                quality[scan, pad] = AMBIGUOUS if border[scan, pad, 0] or border[scan, pad, 1] else OK
