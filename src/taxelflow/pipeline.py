"""The paper on one screen: acquire, condition, contacts, estimate, fuse, slip; what comes out is ready to publish."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from taxelflow import registry
from taxelflow.compiling import announced
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import CalibrationUnfit, NameUnknown, TaxelflowError
from taxelflow.estimation.base import Calibratable, Learning, Mode
from taxelflow.estimation.completion import SlipsSession
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.fusion.parameters import RigidField
from taxelflow.messages import (
    OK,
    UNRESOLVED,
    Bools,
    Contacts,
    Estimates,
    Event,
    Floats,
    Footprint,
    LearnedPattern,
    Motions,
    RawScans,
    Slips,
    cut,
    joined,
    no_scans,
)
from taxelflow.sensors.calibration import Calibration
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from taxelflow.acquire.base import Reading, Recording
    from taxelflow.condition.baseline import Baseline
    from taxelflow.condition.deduplicate import Counts
    from taxelflow.estimation.base import Estimator, EstimatorSession
    from taxelflow.messages import Block, Scans
    from taxelflow.slip.stage import Judged


@dataclass(frozen=True, slots=True, eq=False)
class Output:
    """One block of results, all of the same scans: motion and quality of every pad, whether it slips (scans, pads), the
    object's motion, what the contacts are like, the events that these scans raised, and evidence (scans, pads): log
    odds of a slip by the change of the pattern.
    """

    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]
    contacts: Contacts
    evidence: Floats

    def __len__(self) -> int:
        return len(self.slips)

    @classmethod
    def joined(cls, outputs: Sequence[Output]) -> Output:
        """Consecutive blocks, at least one, as a single block."""
        return cls(
            joined([output.slips for output in outputs]),
            np.concatenate([output.slipping for output in outputs]),
            joined([output.motions for output in outputs]),
            [event for output in outputs for event in output.events],
            joined([output.contacts for output in outputs]),
            np.concatenate([output.evidence for output in outputs]),
        )


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
        """Learn what must be known first and compile the kernels; then iterate over the run, or push scans into it."""
        return Run(self, recording)


class Run:
    """One pass through the stages: iterate over it to read the recording, or call `step` and `finish` to push scans.

    A batch has learned tare and noise from the whole recording when it starts; a stream learns them as scans come.
    """

    def __init__(self, pipeline: Pipeline, recording: Recording) -> None:
        layout = recording.layout
        self.recording = recording
        self.reading: Reading = recording.blocks()
        self._stream = pipeline.mode == "stream"
        lookahead = None if self._stream else recording.blocks()
        with announced():
            self._estimator = _started(pipeline, recording)
            self._estimate = pipeline.smooth.around(SlipsSession(self._estimator, layout), layout, pipeline.mode)
            self._condition = pipeline.condition.start(recording.sensor, recording.masked, lookahead)
            self._fuse = pipeline.fusion.start(layout)
            on, off = pipeline.condition.contact_on, pipeline.condition.contact_off
            self._segment = pipeline.features.start(recording.sensor, on, off)
        self._segmented: list[Contacts] = []
        self._moved_apart: list[Bools] = []
        self._estimated: list[Slips] = []
        self._slip = pipeline.monitor.watch(layout, stream=self._stream)
        self._nothing = self._without_scans(no_scans(layout.entries, len(layout.pads)))

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
        """Maps of the object's pressure that the estimator has learned; none unless it learns."""
        return list(self._estimator.patterns) if isinstance(self._estimator, Learning) else []

    @property
    def notes(self) -> list[str]:
        """What was found out about contacts, and by the estimator about the sensor."""
        return [*self._segment.notes, *(self._estimator.notes if isinstance(self._estimator, Learning) else [])]

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._slip.scatter

    def step(self, raw: RawScans) -> Output:
        """Results that are ready after these scans, which follow those of the last call; none, as a rule, until tare
        and noise are known, and in a batch until contacts end.
        """
        return self._joined(self._through(raw))

    def finish(self) -> Output:
        """Results that were held back; no scan may follow."""
        return self._joined(self._rest())

    def __iter__(self) -> Iterator[Output]:
        try:
            for block in self.reading:
                for raw in _single(block) if self._stream else (block,):
                    yield from self._through(raw)
        except (TaxelflowError, KeyboardInterrupt):  # what came before is given all the same
            yield from self._judged(self._slip.finish())
            raise
        yield from self._rest()

    def _through(self, raw: RawScans) -> Iterator[Output]:
        for scans in self._condition.step(raw):
            yield from self._segment_and_estimate(scans)

    def _rest(self) -> Iterator[Output]:
        for scans in self._condition.finish():
            yield from self._segment_and_estimate(scans)
        yield from self._detect(self._estimate.finish())
        yield from self._judged(self._slip.finish())

    def _segment_and_estimate(self, scans: Scans) -> Iterator[Output]:
        segmented = self._segment.step(scans)
        self._segmented.append(segmented.contacts)
        self._moved_apart.append(segmented.moved_apart)
        self._slip.see(segmented.scans)
        yield from self._detect(self._estimate.step(segmented.scans))

    def _detect(self, slips: Slips) -> Iterator[Output]:
        if not len(slips):
            return
        if self._condition.lag_s:
            slips = replace(slips, lag_s=slips.lag_s + self._condition.lag_s)
        moved_apart = np.concatenate(self._moved_apart)
        self._moved_apart = [moved_apart[len(slips) :]]
        slips.quality[moved_apart[: len(slips)] & (slips.quality == OK)] = UNRESOLVED  # no rigid object moves so
        self._estimated.append(slips)
        yield from self._judged(self._slip.step(slips))

    def _judged(self, judged: Judged) -> Iterator[Output]:
        """The oldest scans, as many as the slip detector has judged."""
        if not len(judged):
            return
        slips, self._estimated = _split(self._estimated, len(judged))
        contacts, self._segmented = _split(self._segmented, len(judged))
        yield Output(slips, judged.slipping, self._fuse.step(slips), judged.events, contacts, judged.evidence)

    def _joined(self, outputs: Iterable[Output]) -> Output:
        return Output.joined([*outputs] or [self._nothing])

    def _without_scans(self, scans: Scans) -> Output:
        """An output of no scans."""
        border = np.zeros((*scans.contact.shape, 2), dtype=np.bool_)
        footprint = Footprint(scans.t_s, scans.contact, border, np.zeros(scans.contact.shape))
        slips = Slips.of(footprint, Estimates.unknown(scans))
        contacts = self._segment.step(scans).contacts
        return Output(slips, slips.contact, self._fuse.step(slips), [], contacts, np.zeros(slips.contact.shape))


def _split(held: list[Block], count: int) -> tuple[Block, list[Block]]:
    """The first `count` scans of blocks, and what is left; estimator and detector may hold some back."""
    block = joined(held)
    return cut(block, 0, count), [cut(block, count, len(block))] if len(block) > count else []


def _started(pipeline: Pipeline, recording: Recording) -> EstimatorSession:
    """The estimator at work, calibrated if there is a calibration, which must be of this method and sensor."""
    estimator, calibration = pipeline.estimator, pipeline.calibration
    if calibration is None:
        return estimator.start(recording.layout, pipeline.mode)
    kind = registry.find("estimator", calibration.method)
    if type(estimator) is not kind or not isinstance(estimator, Calibratable):
        raise CalibrationUnfit(f"method {calibration.method!r}", f"another, {type(estimator).__name__}")
    gains = calibration.gains(recording.sensor)
    return estimator.start(recording.layout, pipeline.mode, gains)


def _single(block: RawScans) -> Iterator[RawScans]:
    """A block as a live device gives it: scan by scan."""
    return (cut(block, scan, scan + 1) for scan in range(len(block)))
