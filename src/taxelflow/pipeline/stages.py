"""The paper on one screen: acquire, condition, contacts, estimate, fuse, slip; what comes out is ready to publish."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, get_args

import numpy as np

from taxelflow.acquire.joints import declared_joints
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import CalibrationUnfit, NameUnknown, RunEnded, TaxelflowError
from taxelflow.estimation.base import Background, Calibratable, Learning, Mode
from taxelflow.estimation.completion import SlipsSession, judges
from taxelflow.estimation.rest_hypothesis import RestHypothesis
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.fusion.parameters import RigidField
from taxelflow.fusion.spatial.parameters import SpatialField
from taxelflow.messages import (
    OK,
    UNRESOLVED,
    Bools,
    Contacts,
    Estimates,
    Floats,
    Footprint,
    LearnedPattern,
    Output,
    RawScans,
    Slips,
    Texture,
    cut,
    joined,
    no_scans,
    split,
)
from taxelflow.pipeline.warmup import made_up
from taxelflow.runtime import registry
from taxelflow.runtime.compiling import announced
from taxelflow.sensors.calibration import Calibration
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from taxelflow.acquire.base import Reading, Recording
    from taxelflow.condition.baseline import Baseline
    from taxelflow.condition.deduplicate import Counts
    from taxelflow.estimation.base import Estimator, EstimatorSession
    from taxelflow.messages import Scans
    from taxelflow.runtime.adoption import Adopting
    from taxelflow.slip.stage import Judged


_warm: set[tuple[object, ...]] = set()
"""Pipelines whose kernels are ready, by what they are compiled for."""


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
    spatial: SpatialField = field(default_factory=SpatialField)

    def __post_init__(self) -> None:
        if self.mode not in get_args(Mode):
            raise NameUnknown("mode", self.mode, get_args(Mode))

    def start(self, recording: Recording, adopting: Adopting | None = None) -> Run:
        """A run to iterate over or to push scans into, all kernels compiled. adopting: when it uses what it learns."""
        if self.mode == "stream":
            joints = recording.joints or declared_joints(recording.sensor)
            split = bool((recording.layout.contact_of >= 0).any())
            self.warm_up(split=split, space=self.spatial.applies(recording.sensor, joints))
        return Run(self, recording, adopting)

    def warm_up(self, *, split: bool = False, space: bool = False) -> None:
        """Compile, or load, what a stream of any sensor needs, once in a process. split: with split contacts. space:
        for pads that have places in space.

        Stages run on a made-up recording; an estimator of another package does not, it may know its sensor only.
        """
        known = type(self.estimator).__module__.startswith("taxelflow.")
        estimator = self.estimator if known else registry.find("estimator", "convolution")()
        asked = self.condition
        condition = Conditioner(
            lowpass_hz=min(asked.lowpass_hz, 10.0), median_scans=asked.median_scans, drift=asked.drift
        )
        made = replace(self, estimator=estimator, mode="stream", condition=condition, calibration=None)
        filters = (condition.drift, condition.median_scans > 1 or condition.lowpass_hz > 0.0)
        needs = (type(estimator), *filters, self.smooth.acceleration_m_s2 > 0.0, split, space)
        if needs in _warm:
            return
        with announced():
            for _ in Run(made, made_up(split=split, space=space)):
                pass
        _warm.add(needs)


class Run:
    """One pass through the stages: iterate over it to read the recording, or call `step` and `finish` to push scans.

    A batch has learned tare and noise from the whole recording when it starts; a stream learns them as scans come.
    """

    def __init__(self, pipeline: Pipeline, recording: Recording, adopting: Adopting | None = None) -> None:
        layout = recording.layout
        self.recording = recording
        self.reading: Reading = recording.blocks()
        self._stream = pipeline.mode == "stream"
        lookahead = None if self._stream else recording.blocks()
        with announced():
            self._estimator = _started(pipeline, recording)
            self._estimate = pipeline.smooth.around(SlipsSession(self._estimator, layout), layout, pipeline.mode)
            self._condition = pipeline.condition.start(recording.sensor, recording.masked, lookahead)
            for learns in (self._condition, self._estimator):
                if adopting is not None and isinstance(learns, Background):
                    learns.adopt_by(adopting)
            self._fuse = pipeline.fusion.start(layout)
            joints = recording.joints or declared_joints(recording.sensor)
            self._space, notes = pipeline.spatial.begin(recording.sensor, joints)
            self._space_notes = [] if recording.truth is not None and joints is None else notes  # the rig's is flat
            on, off = pipeline.condition.contact_on, pipeline.condition.contact_off
            self._segment = pipeline.features.start(recording.sensor, on, off, stream=self._stream)
        self._segmented: list[Contacts] = []
        self._textures: list[Texture] = []
        self._unfit: list[Bools] = []
        self._estimated: list[Slips] = []
        self._slip = pipeline.monitor.watch(layout, stream=self._stream, judged=judges(self._estimator))
        self._shifts = RestHypothesis(layout, stream=self._stream)
        self._ended = False
        self._nothing = self._without_scans(no_scans(layout.entries, len(layout.pads)))

    @property
    def counts(self) -> Counts:
        """Repeated scans and gaps so far."""
        return self._condition.counts

    @property
    def lag_s(self) -> float:
        """What the filters of the conditioner add to every lag."""
        return self._condition.lag_s

    def likely_faults(self, *, touched: bool) -> list[str]:
        """Notes on what is likely wrong with the sensor's description. touched: whether any pad was in contact."""
        return self._condition.likely_faults(touched=touched)

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
        return [
            *self._space_notes,
            *([] if self._space is None else self._space.notes),
            *self._segment.notes,
            *(self._estimator.notes if isinstance(self._estimator, Learning) else []),
        ]

    @property
    def scatter(self) -> Floats:
        """(pads,), see `SlipSession.scatter`."""
        return self._slip.scatter

    def step(self, raw: RawScans) -> Output:
        """Results that are ready after these scans, which follow those of the last call; none, as a rule, until tare
        and noise are known, and in a batch until contacts end. Raises RunEnded after `finish`.
        """
        return joined([*self._through(raw.in_order())] or [self._nothing])

    def finish(self) -> Output:
        """Results that were held back; no scan may follow. Raises RunEnded when it is called again."""
        return joined([*self._rest()] or [self._nothing])

    def __iter__(self) -> Iterator[Output]:
        try:
            for block in self.reading:
                single = (cut(block, scan, scan + 1) for scan in range(len(block)))  # as a live device gives it
                for raw in single if self._stream else (block,):
                    yield from self._through(raw)
        except (TaxelflowError, KeyboardInterrupt):  # what came before is given all the same
            yield from self._judged(self._slip.finish())
            raise
        yield from self._rest()

    def _through(self, raw: RawScans) -> Iterator[Output]:
        if self._ended:
            raise RunEnded
        for scans in self._condition.step(raw):
            yield from self._segment_and_estimate(scans)

    def _rest(self) -> Iterator[Output]:
        if self._ended:
            raise RunEnded
        self._ended = True
        for scans in self._condition.finish():
            yield from self._segment_and_estimate(scans)
        yield from self._detect(self._estimate.finish())
        yield from self._judged(self._slip.finish())
        if self._space is not None:
            self._space.finish()

    def _segment_and_estimate(self, scans: Scans) -> Iterator[Output]:
        segmented = self._segment.step(scans)
        self._segmented.append(segmented.contacts)
        self._textures.append(segmented.texture)
        self._unfit.append(segmented.unfit)
        self._shifts.see(self._slip.see(segmented.scans))
        yield from self._detect(self._estimate.step(segmented.scans))

    def _detect(self, slips: Slips) -> Iterator[Output]:
        if not len(slips):
            return
        if self._condition.lag_s:
            slips = replace(slips, lag_s=slips.lag_s + self._condition.lag_s)
        held = self._unfit
        unfit = held[0] if len(held) == 1 else np.concatenate(held)
        self._unfit = [unfit[len(slips) :]] if len(unfit) > len(slips) else []
        if np.count_nonzero(unfit):
            slips.quality[unfit[: len(slips)] & (slips.quality == OK)] = UNRESOLVED  # no rigid object reads so
        self._shifts.step(slips)
        self._estimated.append(slips.whole())  # slips are detected by what noise does
        yield from self._judged(self._slip.step(slips))

    def _judged(self, judged: Judged) -> Iterator[Output]:
        """The oldest scans, as many as the slip detector has judged."""
        if not len(judged):
            if judged.events:
                yield replace(self._nothing, events=judged.events)
            return
        slips, self._estimated = split(self._estimated, len(judged))
        slips = self._shifts.weighed(slips, judged.slipping, judged.rests, judged.sticks, judged.begun_s)
        contacts, self._segmented = split(self._segmented, len(judged))
        texture, self._textures = split(self._textures, len(judged))
        motions = self._fuse.step(slips, contacts.centroid, texture)
        spatial = None if self._space is None else self._space.step(slips, contacts.centroid, texture)
        found = judged.evidence, judged.statistic, spatial
        yield Output(slips, judged.slipping, motions, judged.events, contacts, *found)

    def _without_scans(self, scans: Scans) -> Output:
        """An output of no scans."""
        none = np.zeros(scans.contact.shape)
        footprint = Footprint(scans.t_s, scans.contact, np.zeros((*none.shape, 2), dtype=np.bool_), none)
        slips, contacts = Slips.of(footprint, Estimates.unknown(scans)), self._segment.step(scans).contacts
        return Output(slips, slips.contact, self._fuse.step(slips, contacts.centroid), [], contacts, none, none)


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
