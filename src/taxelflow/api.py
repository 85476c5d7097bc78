"""The Python face: `read` a recording, `estimate` its motion, get typed arrays."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import msgspec
import numpy as np

from taxelflow import __version__, registry
from taxelflow.acquire.base import Recording
from taxelflow.calibration import Calibration, load_calibration
from taxelflow.compiling import announced
from taxelflow.condition.conditioner import Conditioner
from taxelflow.errors import FormatUnknown, ParameterInvalid, RecordingMissing
from taxelflow.estimation.smoothing import NOTE, Smoothing
from taxelflow.layout import Sensor, load_sensor
from taxelflow.messages import Bools, Event, Motions, Scans, Slips, joined
from taxelflow.monitor.slip import SlipMonitor
from taxelflow.pipeline import Pipeline, Run
from taxelflow.publish.summary import Summary, Totals

if TYPE_CHECKING:
    from taxelflow.estimation.base import Estimator, Mode


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Everything that a recording gave, in memory.

    pads: names along the second axis of the arrays of `slips` and of slipping (scans, pads). `motions` is the
    object's motion per scan, `summary` what `summary.json` holds.
    """

    pads: tuple[str, ...]
    slips: Slips
    slipping: Bools
    motions: Motions
    events: list[Event]
    summary: Summary


def read(path: str | Path, sensor: str | Path | Sensor | None = None) -> Recording:
    """Open a recording; its scans are read when asked for.

    sensor: a built-in name, a TOML file or a `Sensor`, for formats that carry no layout or to replace theirs.
    Raises RecordingMissing, FormatUnknown, SensorNeeded, RecordingCorrupt, TaxelCountWrong, NameUnknown.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingMissing(path)
    suffix = path.suffix.lower()
    if suffix not in registry.names("reader"):
        raise FormatUnknown(path, registry.names("reader"))
    if sensor is not None and not isinstance(sensor, Sensor):
        sensor = load_sensor(str(sensor))
    return cast("Recording", registry.find("reader", suffix)(path, sensor))


def conditioned(recording: Recording) -> Scans:
    """All scans of a recording, conditioned as a batch with the usual parameters, in memory."""
    with announced():
        session = Conditioner().start(recording.sensor, recording.masked, recording.blocks())
        return joined([*(scans for raw in recording.blocks() for scans in session.step(raw)), *session.finish()])


def estimator(method: str, **parameters: Any) -> Estimator:
    """An estimator by name, such as `lnorm` or `convolution`. Raises NameUnknown, ParameterInvalid."""
    kind = registry.find("estimator", method)
    try:
        return cast("Estimator", kind(**parameters))
    except TypeError as error:
        raise ParameterInvalid(f"a parameter of {method}", parameters, str(error)) from error


def estimate(
    recording: Recording | str | Path,
    method: str | Estimator = "convolution",
    *,
    mode: Mode = "batch",
    condition: Conditioner | None = None,
    monitor: SlipMonitor | None = None,
    calibration: Calibration | str | Path | None = None,
    smooth: Smoothing | None = None,
    **parameters: Any,
) -> Result:
    """Run a recording through the pipeline and keep all results in memory.

    method: a name, whose parameters follow (e.g. gain=1.04), or an estimator of your own. Raises what `read` raises,
    TimesNotIncreasing, and CalibrationError if `calibration` (an object or a file) is broken or of another sensor or
    method. What is lost of a truncated recording is said in `summary.loss`.
    """
    if not isinstance(recording, Recording):
        recording = read(recording)
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
    totals = Totals(recording.layout.pads)
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
        summary=summarise(name, pipeline, run, totals),
    )


def summarise(method: str, pipeline: Pipeline, run: Run, totals: Totals) -> Summary:
    """What a finished run amounts to."""
    recording, learned = run.recording, run.learned
    layout = recording.layout
    pads = {}
    masked: list[int] = []
    notes = []
    if learned is not None:
        masked = [int(taxel) for taxel in np.flatnonzero(learned.masked)]
        for number, name in enumerate(totals.pads):
            live = learned.noise[layout.source[layout.of_pad(number)]]
            live = live[live > 0]
            noise = float(np.median(live)) if len(live) else None
            home = int(np.searchsorted(layout.starts, layout.source[layout.starts[number]], side="right")) - 1
            pads[name] = totals.of_pad(number, tared=bool(learned.tared[home]), noise=noise)
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
    if pipeline.smooth.acceleration_m_s2:
        notes.append(NOTE)
    if silent := [taxel for taxel in masked if not recording.masked[taxel]]:
        notes.append(f"masked, because silent while noise was learned: taxels {', '.join(map(str, silent))}")
    return Summary(
        taxelflow=__version__,
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
    )
