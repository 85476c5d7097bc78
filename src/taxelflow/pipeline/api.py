"""The Python face: `read` a recording, `estimate` its motion, get typed arrays."""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from inspect import signature
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from taxelflow.acquire.base import Reading, Recording
from taxelflow.acquire.columns import Columns
from taxelflow.acquire.joints import asked_joints
from taxelflow.condition.parameters import Conditioner
from taxelflow.contacts.features import ContactFeatures
from taxelflow.errors import FormatUnknown, ParameterInvalid, RecordingCorrupt, RecordingMissing
from taxelflow.estimation.smoothing.parameters import Smoothing
from taxelflow.messages import RawScans, Scans, joined
from taxelflow.pipeline.result import Result
from taxelflow.pipeline.run_summary import summarise
from taxelflow.pipeline.stages import Pipeline
from taxelflow.publish.summary import Totals
from taxelflow.runtime import registry
from taxelflow.runtime.compiling import announced
from taxelflow.runtime.whole_file import whole_file
from taxelflow.sensors.calibration import Calibration, load_calibration
from taxelflow.sensors.catalogue import sensor_from
from taxelflow.sensors.sensor import Sensor
from taxelflow.slip.parameters import SlipMonitor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

    from taxelflow.acquire.options import Recorded
    from taxelflow.estimation.base import Estimator, Mode

_BAG_DIRECTORY = "metadata.yaml"
"""What makes a directory a ROS 2 bag; the registry knows its reader by this name."""
_PADS_DIRECTORY = "folder"
"""Name of the reader of a directory with one file per pad."""


def read(
    path: str | Path,
    sensor: str | Path | Sensor | None = None,
    *,
    topic: str | None = None,
    columns: Columns | None = None,
    joints: str | None = None,
) -> Recording:
    """Open a recording; its scans are read when asked for.

    sensor: a built-in name, a TOML file or a `Sensor`, for formats without a layout, or to replace theirs. topic: topic
    of a bag. columns: layout of a csv, text or Parquet file, if not the default. joints: joint angles, as pairs such as
    `spread=60deg f1=1.2`, a named pose of the sensor's hand, or a csv file. Raises
    RecordingMissing, FormatUnknown, SensorNeeded, TopicUnclear, RecordingCorrupt, TaxelCountWrong, NameUnknown,
    SensorFileInvalid, ParameterInvalid, ExtraMissing.
    """
    if columns is not None and not isinstance(columns, Columns):
        raise ParameterInvalid("columns", columns, "be a Columns")
    if not isinstance(path, str | Path):
        duty = "be a path, or a Recording: taxelflow.recording(t_s, values, sensor) makes one from arrays"
        raise ParameterInvalid("recording", type(path).__name__, duty)
    path = Path(path)
    suffix = path.suffix.lower()
    if (path / _BAG_DIRECTORY).is_file():
        suffix = _BAG_DIRECTORY
    elif path.is_dir() and sensor is not None:
        suffix = _PADS_DIRECTORY
    elif not path.is_file():
        raise RecordingMissing(path)
    if suffix not in registry.names("reader"):
        raise FormatUnknown(path, registry.names("reader"))
    if path.is_file() and not path.stat().st_size:
        raise RecordingCorrupt(path, "the file is empty", "record or copy it again")
    if sensor is not None:
        sensor = sensor_from(sensor)
    if suffix == _PADS_DIRECTORY and not (
        (columns and columns.pads) or (sensor and any(pad.files for pad in sensor.pads))
    ):
        raise RecordingMissing(path)
    opener = registry.find("reader", suffix)
    asked = {name: value for name, value in {"topic": topic, "columns": columns}.items() if value is not None}
    for name in asked.keys() - signature(opener).parameters.keys():
        seen = columns.changed() if columns is not None and name == "columns" else asked[name]
        raise ParameterInvalid(name, seen, f"be left out for {suffix} recordings: it has no meaning there")
    recording = opener(path, sensor, **asked)
    if not isinstance(recording, Recording):
        error = TypeError(f"it gives a {type(recording).__name__}, not a Recording")
        raise registry.broken("reader", suffix, error)
    recording = replace(recording, asked=asked)
    return recording if joints is None else replace(recording, joints=asked_joints(joints, recording.sensor))


def opened(asked: Recorded) -> Recording:
    """The recording that the options of a command name. Raises what `read` raises."""
    return read(asked.recording, asked.sensor, topic=asked.topic, columns=asked.own_columns, joints=asked.joints)


def recording(
    t_s: ArrayLike,
    values: ArrayLike,
    sensor: str | Path | Sensor,
    *,
    masked: Sequence[int] = (),
    shear: ArrayLike | None = None,
) -> Recording:
    """A recording from arrays.

    t_s: (scans,), s, increasing. values: (scans, taxels) in the sensor's unit and the order of its layout, NaN or
    masked where missing, or (scans, rows, cols) of a sensor that is one full grid. sensor: a built-in name, a plain
    grid such as `grid:16x16@4mm,kPa`, a TOML file or a `Sensor`. masked: numbers of taxels that are switched off.
    shear: (scans, taxels, 2) or (scans, rows, cols, 2) of a three-axis sensor, along x (right) and y (up) of the pad,
    same unit. Raises RecordingCorrupt, TaxelCountWrong, NameUnknown, SensorFileInvalid, ParameterInvalid.
    """
    chosen = sensor_from(sensor)
    found = Recording.of_arrays(t_s, values, chosen, shear=shear)
    off = np.zeros(chosen.layout.taxels, dtype=np.bool_)
    for taxel in masked:
        whole = isinstance(taxel, int | np.integer) and not isinstance(taxel, bool)
        if not whole or not 0 <= taxel < len(off):
            raise ParameterInvalid("masked", taxel, f"hold numbers of taxels, from 0 to {len(off) - 1}")
        off[taxel] = True
    return replace(found, masked=off)


def convert(
    recording: Recording,
    path: str | Path,
    watched: Callable[[Iterable[RawScans]], Iterable[RawScans]] = iter,
) -> Reading:
    """Write a recording as another format, by suffix: .npz, .parquet and .mcap carry sensor, mask and truth, .csv not.

    Scans stay as the sensor sent them, to the bit; repeated stamps are dropped. The file is written completely or not
    at all. Returns the pass over the recording, with the number of scans and what was lost. `watched` may show
    progress. Raises FormatUnknown, ExtraMissing and what reading raises.
    """
    path = Path(path)
    if path.suffix.lower() not in registry.names("writer"):
        raise FormatUnknown(path, registry.names("writer"), "writer")
    write = registry.find("writer", path.suffix.lower())
    reading = recording.source_blocks()
    with whole_file(path) as part:
        write(recording, part, watched(reading))
    return reading


def segmented(recording: Recording, conditioner: Conditioner | None = None) -> Iterator[Scans]:
    """Blocks of scans as an estimator gets them in a batch: conditioned, contacts split."""
    conditioner = conditioner or Conditioner()
    with announced():
        session = conditioner.start(recording.sensor, recording.masked, recording.blocks())
        split = bool((recording.layout.contact_of >= 0).any())
        limits = conditioner.contact_on, conditioner.contact_off
        contacts = ContactFeatures().start(recording.sensor, *limits) if split else None
    for scans in chain(chain.from_iterable(map(session.step, recording.blocks())), session.finish()):
        yield scans if contacts is None else contacts.step(scans).scans


def conditioned(recording: Recording) -> Scans:
    """All scans of `segmented` in memory."""
    return joined(list(segmented(recording)))


def estimator(method: str, **parameters: Any) -> Estimator:
    """An estimator by name, such as `lnorm` or `convolution`. Raises NameUnknown, ParameterInvalid."""
    kind = registry.find("estimator", method)
    known = signature(kind).parameters
    if unknown := [name for name in parameters if name not in known]:
        raise ParameterInvalid(f"parameters of {method}", unknown[0], f"be among {', '.join(known)}")
    try:
        return cast("Estimator", kind(**parameters))
    except TypeError as error:
        raise ParameterInvalid(f"parameters of {method}", parameters, f"fit the method: {error}") from error


def pipeline_of(
    method: str | Estimator,
    mode: Mode,
    parameters: Mapping[str, Any],
    *,
    condition: Conditioner | None,
    monitor: SlipMonitor | None,
    calibration: Calibration | str | Path | None,
    smooth: Smoothing | None,
) -> Pipeline:
    """The stages as `estimate` and `Live` take them. Raises NameUnknown, ParameterInvalid, CalibrationInvalid."""
    chosen = estimator(method, **parameters) if isinstance(method, str) else method
    if isinstance(chosen, type) or not is_dataclass(chosen) or not hasattr(chosen, "start"):
        raise ParameterInvalid("method", method, "be a name, or an object of a dataclass with a method start")
    given = (("condition", condition, Conditioner), ("monitor", monitor, SlipMonitor), ("smooth", smooth, Smoothing))
    for name, stage, kind in given:
        if stage is not None and not isinstance(stage, kind):
            raise ParameterInvalid(name, stage, f"be a {kind.__name__}")
    if calibration is not None and not isinstance(calibration, Calibration):
        calibration = load_calibration(calibration)
    return Pipeline(
        chosen,
        mode,
        condition or Conditioner(),
        monitor or SlipMonitor(),
        calibration=calibration,
        smooth=smooth or Smoothing(),
    )


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

    method: a name, with its parameters as further arguments (e.g. gain=1.04), or an estimator of your own. mode: batch
    (the whole recording is used) or stream (scan by scan). contacts: largest number of contacts to separate on every
    pad, or by pad ({"palm": 2}); as in the sensor file if left out. Raises what `read`
    raises, ParameterInvalid and NameUnknown for contacts, TimesNotIncreasing, and CalibrationError if `calibration` (an
    object or a file) is invalid or of another sensor or method. `summary.loss` states what a truncated
    recording lacks.
    """
    if not isinstance(recording, Recording):
        recording = read(recording)
    recording = recording.with_contacts(contacts)
    pipeline = pipeline_of(
        method, mode, parameters, condition=condition, monitor=monitor, calibration=calibration, smooth=smooth
    )
    name = method if isinstance(method, str) else type(method).__name__
    run = pipeline.start(recording)
    totals = Totals(recording.layout)
    outputs = []
    for output in run:
        totals.add(output.slips, output.events)
        outputs.append(output)
    whole = joined(outputs)
    return Result(
        sensor=recording.sensor,
        slips=whole.slips,
        slipping=whole.slipping,
        motions=whole.motions,
        events=whole.events,
        patterns=run.patterns,
        summary=summarise(name, pipeline, run, totals),
        contacts=whole.contacts,
        evidence=whole.evidence,
        spatial=whole.spatial,
    )
