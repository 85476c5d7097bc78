"""The paper on one screen: acquire, condition, estimate, fuse, monitor; what comes out is ready to publish."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast, get_args

from taxelflow import registry
from taxelflow.calibration import Calibration
from taxelflow.compiling import announced
from taxelflow.condition.conditioner import Conditioner
from taxelflow.errors import CalibrationUnfit, NameUnknown
from taxelflow.estimation.base import Mode
from taxelflow.estimation.smoothing import Smoothing
from taxelflow.fuse.rigid import RigidField
from taxelflow.messages import Bools, Event, Motions, RawScans, Slips, cut
from taxelflow.monitor.slip import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.base import Reading, Recording
    from taxelflow.condition.session import Learned
    from taxelflow.estimation.base import Calibratable, Estimator, EstimatorSession


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """One block of results: what every pad saw, whether it slips (scans, pads), the object's motion, events."""

    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]

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
            estimate = _started(pipeline, recording)
            self._estimate = pipeline.smooth.around(estimate, layout, pipeline.mode)
            self._condition = pipeline.condition.start(recording.sensor, recording.masked, lookahead)
            self._fuse = pipeline.fusion.start(layout)
        self._monitor = pipeline.monitor.begin(layout.pads)

    @property
    def learned(self) -> Learned | None:
        """Tare, noise and masks, as far as they are known."""
        return self._condition.learned

    def __iter__(self) -> Iterator[Output]:
        for block in self.reading:
            for raw in _single(block) if self._stream else (block,):
                for scans in self._condition.step(raw):
                    yield from self._finish(self._estimate.step(scans))
        for scans in self._condition.finish():
            yield from self._finish(self._estimate.step(scans))
        yield from self._finish(self._estimate.finish())

    def _finish(self, slips: Slips) -> Iterator[Output]:
        if len(slips):
            slipping, events = self._monitor.step(slips)
            yield Output(slips, slipping, self._fuse.step(slips), events)


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
