"""The protocol of an estimator: frozen parameters that start a session, which turns scans into estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.messages import Estimates, Floats, LearnedPattern, Scans, Slips
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.sensors.layout import Layout

Mode = Literal["batch", "stream"]


class EstimatorSession(Protocol):
    """An estimator at work, with its memory."""

    def step(self, scans: Scans) -> Estimates:
        """Estimates of all pads for these scans, which follow those of the last call.

        However the stream is cut into blocks, the estimates are the same. A session that needs the whole contact
        (batch) may return fewer rows than scans, even none, and return the others later or at `finish`.
        """
        ...

    def finish(self) -> Estimates:
        """Estimates still held back at the end of the stream; none for a causal estimator."""
        ...


class SlipSource(Protocol):
    """Scans in, slips out: an estimator's session completed by what depends on scan and layout only."""

    def step(self, scans: Scans) -> Slips:
        """Slips of all pads; fewer rows than scans where the estimator holds some back."""
        ...

    def finish(self) -> Slips:
        """Slips still held back at the end of the stream."""
        ...


@runtime_checkable
class Learning(Protocol):
    """A session that learns about object and sensor while it works."""

    @property
    def patterns(self) -> Sequence[LearnedPattern]:
        """Maps of the object's pressure, one per contact that has ended, oldest first; all after `finish`."""
        ...

    @property
    def notes(self) -> Sequence[str]:
        """What a user should know of the sensor, a sentence each."""
        ...


@runtime_checkable
class Background(Protocol):
    """A session that learns beside the stream."""

    def adopt_by(self, adopting: Adopting) -> None:
        """Use what is learned when this is true; before the first scan only."""
        ...


@runtime_checkable
class SkinAware(Protocol):
    """A session whose covariance holds the sensor's `unseen_error`, and what a border hides of a contact.

    To the covariance of any other the pipeline adds the unseen error; its poses of cut contacts are `ambiguous`.
    """

    holds_unseen_error: bool
    """True; a class attribute will do."""


@runtime_checkable
class Scaled(Protocol):
    """A session that scales its positions."""

    @property
    def gains(self) -> Floats:
        """(pads, 2), factors on positions along x and y."""
        ...


class Estimator(Protocol):
    """Parameters of a method: a frozen dataclass in a module that imports neither NumPy nor numba."""

    def start(self, layout: Layout, mode: Mode) -> EstimatorSession:
        """Begin a session; everything slow (imports, compilation) happens here."""
        ...


@runtime_checkable
class Calibratable(Estimator, Protocol):
    """A method whose positions a calibration may scale; `isinstance` is true where pitches_per_index is there."""

    @property
    def pitches_per_index(self) -> float:
        """Pitches that one unit of the method's index (the paper's n) stands for; a class attribute will do."""
        ...

    def start(self, layout: Layout, mode: Mode, calibrated: Floats | None = None) -> EstimatorSession:
        """Begin a session. calibrated: (pads, 2), factors on positions along x and y, pad by pad and group by group."""
        ...
