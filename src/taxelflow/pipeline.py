"""The paper on one screen: acquire, condition, estimate, fuse, monitor; what comes out is ready to publish."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast, get_args

import numpy as np

from taxelflow import registry
from taxelflow.compiling import announced
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import CalibrationUnfit, NameUnknown, TaxelflowError
from taxelflow.estimation.base import Learning, Mode
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.fusion.parameters import RigidField
from taxelflow.messages import (
    OK,
    UNRESOLVED,
    Bools,
    Contacts,
    Event,
    Floats,
    LearnedPattern,
    Motions,
    RawScans,
    Scans,
    Slips,
    cut,
    joined,
)
from taxelflow.sensors.calibration import Calibration
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.base import Reading, Recording
    from taxelflow.condition.baseline import Baseline
    from taxelflow.condition.deduplicate import Counts
    from taxelflow.estimation.base import Calibratable, Estimator, EstimatorSession
    from taxelflow.messages import Block


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """One block of results: what every pad saw, whether it slips (scans, pads), the object's motion, events, and what
    the contacts are like. All of the same scans.
    """

    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]
    contacts: Contacts

    def __len__(self) -> int:
        return len(self.slips)


@dataclass(frozen=True)
class Pipeline:
    """The stages between a recording and its results, each with its parameters."""

    estimator: Estimator
    mode: Mode = "batch"
    condition: Conditioner = field(default_factory=Conditioner)
    monitor: SlipMonitor = field(default_factory=SlipMonitor)
    fusion: RigidField = field(default_factory=RigidField)
    calibration: Calibration | None = None
    features: ContactFeatures = field(default_factory=ContactFeatures)
    smooth: Smoothing = field(default_factory=Smoothing)

    def __post_init__(self) -> None:
        if self.mode not in get_args(Mode):
            raise NameUnknown("mode", self.mode, get_args(Mode))

    def start(self, recording: Recording) -> Run:
        """Learn what must be known first, compile what must be compiled; then iterate over the run."""
        return Run(self, recording)


class Run:
    """One pass of a recording through the stages, block by block."""

    def __init__(self, pipeline: Pipeline, recording: Recording) -> None:
        layout = recording.layout
        self.recording = recording
        self.reading: Reading = recording.blocks()
        self._stream = pipeline.mode == "stream"
        lookahead = None if self._stream else recording.blocks()
        with announced():
            self._estimator = _started(pipeline, recording)
            self._estimate = pipeline.smooth.around(self._estimator, layout, pipeline.mode)
            self._condition = pipeline.condition.start(recording.sensor, recording.masked, lookahead)
            self._fuse = pipeline.fusion.start(layout)
            on, off = pipeline.condition.contact_on, pipeline.condition.contact_off
            self._segment = pipeline.features.start(recording.sensor, on, off)
        self._described: list[Contacts] = []
        self._estimated: list[Slips] = []
        self._parted: list[Bools] = []
        watch = pipeline.monitor.begin if self._stream else pipeline.monitor.look_back
        self._monitor = watch(layout.pads)

    @property
    def counts(self) -> Counts:
        """Repeated scans and gaps so far."""
        return self._condition.counts

    @property
    def lag_s(self) -> float:
        """What the filters of the conditioner add to every lag."""
        return self._condition.lag_s

    @property
    def learned(self) -> Baseline | None:
        """Tare, noise and masks, as far as they are known."""
        return self._condition.baseline

    @property
    def patterns(self) -> list[LearnedPattern]:
        """What the estimator has learned of the object; none unless it learns."""
        return list(self._estimator.patterns) if isinstance(self._estimator, Learning) else []

    @property
    def notes(self) -> list[str]:
        """What was found out about contacts, and by the estimator about the sensor."""
        return [*self._segment.notes, *(self._estimator.notes if isinstance(self._estimator, Learning) else [])]

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._monitor.scatter

    def __iter__(self) -> Iterator[Output]:
        try:
            for block in self.reading:
                for raw in _single(block) if self._stream else (block,):
                    for scans in self._condition.step(raw):
                        yield from self._step(scans)
        except (TaxelflowError, KeyboardInterrupt):  # what came before is given all the same
            yield from self._give(*self._monitor.finish())
            raise
        for scans in self._condition.finish():
            yield from self._step(scans)
        yield from self._finish(self._estimate.finish())
        yield from self._give(*self._monitor.finish())

    def _step(self, scans: Scans) -> Iterator[Output]:
        segmented = self._segment.step(scans)
        self._described.append(segmented.contacts)
        self._parted.append(segmented.moved_apart)
        yield from self._finish(self._estimate.step(segmented.scans))

    def _finish(self, slips: Slips) -> Iterator[Output]:
        if not len(slips):
            return
        if self._condition.lag_s:
            slips = replace(slips, lag_s=slips.lag_s + self._condition.lag_s)
        parted = np.concatenate(self._parted)
        self._parted = [parted[len(slips) :]]
        slips.quality[parted[: len(slips)] & (slips.quality == OK)] = UNRESOLVED  # no one rigid object moves so
        self._estimated.append(slips)
        yield from self._give(*self._monitor.step(slips))

    def _give(self, slipping: Bools, events: list[Event]) -> Iterator[Output]:
        """The oldest scans, as many as are judged."""
        if not len(slipping):
            return
        slips, self._estimated = _split(self._estimated, len(slipping))
        contacts, self._described = _split(self._described, len(slipping))
        yield Output(slips, slipping, self._fuse.step(slips), events, contacts)


def _split(held: list[Block], count: int) -> tuple[Block, list[Block]]:
    """The first `count` scans of blocks, and what is left; estimator and monitor may hold some back."""
    block = joined(held)
    return cut(block, 0, count), [cut(block, count, len(block))] if len(block) > count else []


def _started(pipeline: Pipeline, recording: Recording) -> EstimatorSession:
    """The estimator at work, calibrated if there is a calibration, which must be of this method and sensor."""
    estimator, calibration = pipeline.estimator, pipeline.calibration
    if calibration is None:
        return estimator.start(recording.layout, pipeline.mode)
    if type(estimator) is not registry.find("estimator", calibration.method):
        raise CalibrationUnfit(f"method {calibration.method!r}", f"another, {type(estimator).__name__}")
    gains = calibration.gains(recording.sensor)
    scalable: Calibratable = cast("Any", estimator)  # methods that can be calibrated are those of `score.calibrate`
    return scalable.start(recording.layout, pipeline.mode, gains)


def _single(block: RawScans) -> Iterator[RawScans]:
    """A block as a live device gives it: scan by scan."""
    return (cut(block, scan, scan + 1) for scan in range(len(block)))
