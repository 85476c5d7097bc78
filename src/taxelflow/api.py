"""The Python face: `read` a recording, `estimate` its motion, get typed arrays."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib.metadata import version
from inspect import signature
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import msgspec
import numpy as np

from taxelflow import registry
from taxelflow.acquire.base import Reading, Recording
from taxelflow.acquire.columns import Columns
from taxelflow.compiling import announced
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import FormatUnknown, ParameterInvalid, RecordingMissing
from taxelflow.estimation.smoothing.parameters import NOTE, Smoothing
from taxelflow.messages import Bools, Contacts, Event, Floats, LearnedPattern, Motions, RawScans, Scans, Slips, joined
from taxelflow.pipeline import Pipeline, Run
from taxelflow.publish.summary import Summary, Totals
from taxelflow.sensors.calibration import Calibration, load_calibration
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.sensor import Sensor
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from taxelflow.condition.baseline import Baseline
    from taxelflow.estimation.base import Estimator, Mode

_MOST_WORDS = 4


_BAG_DIRECTORY = "metadata.yaml"
"""What makes a directory a ROS 2 bag; the registry knows its reader by this name."""


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Everything that a recording gave, in memory.

    pads: names along the second axis of the arrays of `slips` and of slipping (scans, pads): pads, groups, and contacts
    that are separated. `motions` is the object's motion per scan, `contacts` what each pad's contact is like,
    `patterns` what a method that learns has learned, `summary` what `summary.json` holds, `evidence`
    (scans, pads) the log odds of a slip by the change of the pattern, NaN where unknown.
    """

    pads: tuple[str, ...]
    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]
    patterns: list[LearnedPattern]
    summary: Summary
    contacts: Contacts
    evidence: Floats


def read(
    path: str | Path,
    sensor: str | Path | Sensor | None = None,
    *,
    topic: str | None = None,
    columns: Columns | None = None,
) -> Recording:
    """Open a recording; its scans are read when asked for.

    sensor: a built-in name, a TOML file or a `Sensor`, for formats that carry no layout or to replace theirs.
    topic: which one of a bag. columns: how a csv, text or Parquet file is laid out, if not as usual. Raises
    RecordingMissing, FormatUnknown, SensorNeeded, TopicUnclear, RecordingCorrupt, TaxelCountWrong, NameUnknown,
    ParameterInvalid, ExtraMissing.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if (path / _BAG_DIRECTORY).is_file():
        suffix = _BAG_DIRECTORY
    elif not path.is_file():
        raise RecordingMissing(path)
    if suffix not in registry.names("reader"):
        raise FormatUnknown(path, registry.names("reader"))
    if sensor is not None and not isinstance(sensor, Sensor):
        sensor = load_sensor(str(sensor))
    opener = registry.find("reader", suffix)
    asked = {name: value for name, value in {"topic": topic, "columns": columns}.items() if value is not None}
    for name in asked.keys() - signature(opener).parameters.keys():
        raise ParameterInvalid(name, asked[name], f"be left out for {suffix} recordings: it has no meaning there")
    return cast("Recording", opener(path, sensor, **asked))


def convert(
    recording: Recording,
    path: str | Path,
    watched: Callable[[Iterable[RawScans]], Iterable[RawScans]] = iter,
) -> Reading:
    """Write a recording as another format, by suffix: .npz, .parquet and .mcap carry sensor, mask and truth, .csv not.

    Scans stay as the sensor sent them, to the bit; repeated stamps are dropped. The file is there whole or not at all.
    The pass over the recording is given back: it counts scans and holds what was lost. `watched` may show progress.
    Raises FormatUnknown, ExtraMissing and what reading raises.
    """
    path = Path(path)
    if path.suffix.lower() not in registry.names("writer"):
        raise FormatUnknown(path, registry.names("writer"), "writer")
    write = registry.find("writer", path.suffix.lower())
    part = path.with_name(path.name + ".part")
    reading = recording.source_blocks()
    try:
        write(recording, part, watched(reading))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return reading


def segmented(recording: Recording, conditioner: Conditioner | None = None) -> Iterator[Scans]:
    """Blocks of scans as an estimator gets them in a batch: conditioned, contacts split."""
    conditioner = conditioner or Conditioner()
    with announced():
        session = conditioner.start(recording.sensor, recording.masked, recording.blocks())
        contacts = ContactFeatures().start(recording.sensor, conditioner.contact_on, conditioner.contact_off)
    for scans in chain(chain.from_iterable(map(session.step, recording.blocks())), session.finish()):
        yield contacts.step(scans).scans


def conditioned(recording: Recording) -> Scans:
    """All scans of `segmented` in memory."""
    return joined(list(segmented(recording)))


def estimator(method: str, **parameters: Any) -> Estimator:
    """An estimator by name, such as `lnorm` or `convolution`. Raises NameUnknown, ParameterInvalid."""
    kind = registry.find("estimator", method)
    try:
        return cast("Estimator", kind(**parameters))
    except TypeError as error:
        raise ParameterInvalid(f"parameters of {method}", parameters, f"fit the method: {error}") from error


def estimate(
    recording: Recording | str | Path,
    method: str | Estimator = "convolution",
    *,
    mode: Mode = "batch",
    condition: Conditioner | None = None,
    monitor: SlipMonitor | None = None,
    calibration: Calibration | str | Path | None = None,
    smooth: Smoothing | None = None,
    contacts: int | str | Mapping[str, int] | None = None,
    **parameters: Any,
) -> Result:
    """Run a recording through the pipeline and keep all results in memory.

    method: a name, whose parameters follow (e.g. gain=1.04), or an estimator of your own. contacts: the most contacts
    to separate on every pad, or by pad ({"palm": 2}); as in the sensor's file if left out. Raises what `read`
    raises, ParameterInvalid and NameUnknown for contacts, TimesNotIncreasing, and CalibrationError if `calibration` (an
    object or a file) is broken or of another sensor or method. `summary.loss` holds what a truncated
    recording lacks.
    """
    if not isinstance(recording, Recording):
        recording = read(recording)
    recording = recording.with_contacts(contacts)
    if isinstance(method, str):
        chosen, name = estimator(method, **parameters), method
    else:
        chosen, name = method, type(method).__name__
    if calibration is not None and not isinstance(calibration, Calibration):
        calibration = load_calibration(calibration)
    pipeline = Pipeline(
        chosen,
        mode,
        condition or Conditioner(),
        monitor or SlipMonitor(),
        calibration=calibration,
        smooth=smooth or Smoothing(),
    )
    run = pipeline.start(recording)
    totals = Totals(recording.layout)
    outputs = []
    for output in run:
        totals.add(output.slips, output.slipping, output.events)
        outputs.append(output)
    return Result(
        pads=recording.layout.pads,
        slips=joined([output.slips for output in outputs]),
        slipping=np.concatenate([output.slipping for output in outputs]),
        motions=joined([output.motions for output in outputs]),
        events=[event for output in outputs for event in output.events],
        patterns=run.patterns,
        summary=summarise(name, pipeline, run, totals),
        contacts=joined([output.contacts for output in outputs]),
        evidence=np.concatenate([output.evidence for output in outputs]),
    )


def summarise(method: str, pipeline: Pipeline, run: Run, totals: Totals) -> Summary:
    """What a finished run amounts to."""
    recording, learned = run.recording, run.learned
    layout = recording.layout
    pads = {}
    masked: list[int] = []
    notes = list(run.reading.notes)
    if learned is not None:
        masked = [int(taxel) for taxel in np.flatnonzero(learned.masked)]
        for number, name in enumerate(totals.pads):
            live = learned.noise[layout.source[layout.of_pad(number)]]
            live = live[live > 0]
            noise = float(np.median(live)) if len(live) else None
            home = int(np.searchsorted(layout.starts, layout.source[layout.starts[number]], side="right")) - 1
            pads[name] = totals.of_pad(
                number, tared=bool(learned.tared[home]), noise=noise, scatter=float(run.scatter[number])
            )
    if not totals.contact_scans.any():
        notes.append("no contact: no pad was touched in this recording")
    untared = [name for name, pad in pads.items() if not pad.tared and pad.contact_scans]
    if untared and pipeline.condition.tare == "auto":
        notes.append(f"not tared, because no idle scans were found: {', '.join(untared)}")
    if pipeline.calibration is not None:
        known = {pad.name for pad in pipeline.calibration.pads}
        own = totals.pads[: layout.pad_count]
        if bare := [name for name in own if name in pads and pads[name].contact_scans and name not in known]:
            notes.append(f"not in the calibration, so at gain 1: {', '.join(bare)}")
    if learned is not None:
        notes += _of_taxels(recording, learned)
    counts = run.counts
    rate_hz = 1 / counts.usual_s if counts.usual_s > 0 else None
    if counts.repeated:
        notes.append(
            f"dropped {counts.repeated} scans that repeat the one before bit for bit: {rate_hz:.4g} scans/s are new"
        )
    if counts.gaps:
        gaps = "1 gap" if counts.gaps == 1 else f"{counts.gaps} gaps, the longest"
        notes.append(f"{gaps} of {counts.longest_gap_s:.3g} s: no motion is followed across it")
    if run.lag_s:
        notes.append(f"filtered over time: every lag_s is {1e3 * run.lag_s:.3g} ms longer for it")
    notes += run.notes
    if pipeline.smooth.acceleration_m_s2:
        notes.append(NOTE)
    return Summary(
        taxelflow=version("taxelflow"),
        input=str(recording.source),
        format=recording.format,
        sensor=recording.sensor.name,
        unit=recording.sensor.si_unit,
        method=method,
        mode=pipeline.mode,
        parameters={
            "method": asdict(cast("Any", pipeline.estimator)),
            "condition": asdict(pipeline.condition),
            "monitor": asdict(pipeline.monitor),
            "features": asdict(pipeline.features),
            "smooth": asdict(pipeline.smooth),
        }
        | ({} if pipeline.calibration is None else {"calibration": msgspec.to_builtins(pipeline.calibration)}),
        scans=totals.scans,
        repeated_scans_dropped=run.reading.repeated,
        t_first_s=totals.t_first_s,
        t_last_s=totals.t_last_s,
        contact=bool(totals.contact_scans.any()),
        masked_taxels=masked,
        pads=pads,
        events=dict(totals.events),
        notes=notes,
        layout=recording.sensor,
        loss=str(run.reading.loss) if run.reading.loss else None,
        repeated_values_dropped=counts.repeated,
        rate_hz=rate_hz,
        gaps=counts.gaps,
    )


def _of_taxels(recording: Recording, learned: Baseline) -> list[str]:
    """Notes on masked taxels and on those that are not well."""
    judged = {finding.taxel for finding in learned.findings}
    silent = np.flatnonzero(learned.masked & ~recording.masked)
    asked = [int(taxel) for taxel in silent if taxel not in judged]
    sensor = recording.sensor
    notes = [f"masked besides what the recording declares off: taxels {', '.join(map(str, asked))}"] if asked else []
    for masked, what in ((True, "masked"), (False, "not well, and used all the same (--condition.mask auto)")):
        found = [finding for finding in learned.findings if learned.masked[finding.taxel] == masked]
        if found:
            words = "; ".join(finding.words(sensor) for finding in found[:_MOST_WORDS])
            rest = len(found) - _MOST_WORDS
            notes.append(f"{what}: {words}" + (f"; and {rest} more, see `taxelflow info`" if rest > 0 else ""))
    return notes
