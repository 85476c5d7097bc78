"""`taxelflow.Live`: one scan in, its results out at once, for a loop of your own."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.acquire.devices.base import Arrival, Faults
from taxelflow.acquire.devices.timeline import Timeline
from taxelflow.errors import ParameterInvalid, RecordingCorrupt, TaxelCountWrong
from taxelflow.messages import RawScans
from taxelflow.numerics.clock import FARTHEST_S
from taxelflow.numerics.unmasked import floats_of
from taxelflow.pipeline.api import pipeline_of
from taxelflow.runtime.adoption import AsRecorded, WhenReady
from taxelflow.sensors.catalogue import sensor_from
from taxelflow.sensors.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike

    from taxelflow.condition.parameters import Conditioner
    from taxelflow.estimation.base import Estimator
    from taxelflow.estimation.smoothing.parameters import Smoothing
    from taxelflow.messages import Floats, Output
    from taxelflow.runtime.adoption import Adoption
    from taxelflow.sensors.calibration import Calibration
    from taxelflow.slip.parameters import SlipMonitor


class Live:
    """Motion and slip from a stream of scans; kernels are compiled when it is made.

    sensor: a built-in name, a TOML file, a `Sensor`, or a `Recording` whose sensor and masks are used. method,
    condition, monitor, calibration, smooth, contacts, parameters: as for `estimate`. Raises what `load_sensor`,
    `estimator` and `estimate` raise for these. adoptions: those of a former loop, to reproduce its results from the
    same scans; if left out, new maps and tares are used as soon as they are ready, and the loop never waits.

    pads: names along the second axis of results. faults: numbers of scans that were repeated, late or without a
    finite time, of scans with a number beyond 1e30 (it counts as a missing reading), and of jumps of the clock.
    """

    def __init__(
        self,
        sensor: str | Path | Sensor | Recording,
        method: str | Estimator = "convolution",
        *,
        condition: Conditioner | None = None,
        monitor: SlipMonitor | None = None,
        calibration: Calibration | str | Path | None = None,
        smooth: Smoothing | None = None,
        contacts: int | str | Mapping[str, int] | None = None,
        adoptions: Iterable[Adoption] | None = None,
        **parameters: Any,
    ) -> None:
        if isinstance(sensor, (str, Path, Sensor)):
            sensor = sensor_from(sensor)
        if not isinstance(sensor, Sensor | Recording):
            raise ParameterInvalid("sensor", sensor, "be a name, a TOML file, a Sensor or a Recording")
        recording = sensor if isinstance(sensor, Recording) else Recording.live(sensor)
        recording = recording.with_contacts(contacts)
        self.pipeline = pipeline_of(
            method, "stream", parameters, condition=condition, monitor=monitor, calibration=calibration, smooth=smooth
        )
        self.recording = recording
        self.pads = recording.layout.pads
        self._faults = Faults()
        self._timeline = Timeline(self._faults)
        self._last_s = -math.inf
        self._adopting = WhenReady() if adoptions is None else _recorded(adoptions)
        self.run = self.pipeline.start(recording, self._adopting)

    @property
    def faults(self) -> dict[str, int]:
        """Counts by kind."""
        return dict(self._faults.counts)

    def adopted(self) -> list[Adoption]:
        """Adoptions since the last call, see `runtime.adoption`; none in a loop that reproduces former ones."""
        return self._adopting.taken()

    def step(self, t_s: float, values: ArrayLike) -> Output:
        """Results that are ready after this scan; none for the first scans, from which noise and tare are learned.

        t_s: the sensor's clock. values: (columns,), readings in the sensor's unit and order, NaN or masked where
        missing; or (rows, cols) of a sensor with one full grid, row 0 on top, (rows, cols, 3) of three axes.
        A repeated or late scan, or one without a finite time, gives no result and is counted in `faults`; after a jump
        of the clock, time continues from the last scan. Raises TaxelCountWrong, RecordingCorrupt, and
        RunEnded after `finish`.
        """
        try:
            now_s, readings = float(t_s), floats_of(values)
        except (TypeError, ValueError) as error:
            raise RecordingCorrupt(
                "the scan", f"not numbers: {error}", "give t_s in s, and an array of numbers"
            ) from error
        sensor = self.recording.sensor
        columns = sensor.channel_map.columns
        if readings.ndim > 1 and readings.shape in sensor.images:
            readings = sensor.channel_map.arranged(readings.reshape(1, -1))[0]
        if readings.ndim != 1:
            remedy = f"give ({columns},)" + "".join(f", or {shape}" for shape in sensor.images)
            raise RecordingCorrupt("the scan", f"it has shape {readings.shape}", remedy)
        if len(readings) != columns:
            raise TaxelCountWrong("the scan", len(readings), sensor.name, columns)
        placed_s = self._timeline.place(Arrival(time.monotonic(), now_s, readings))
        if placed_s is None:
            return self.push(no_time(columns))
        self._faults.count_absurd(readings)
        return self.push(RawScans(np.array([placed_s]), readings[np.newaxis]))

    def push(self, scans: RawScans) -> Output:
        """Results that are ready after these scans: (scans, columns) as the source sends them, later than all before.

        Raises RecordingCorrupt, also for times that do not increase, after which the loop goes on without that block;
        TaxelCountWrong, and RunEnded after `finish`.
        """
        columns = self.recording.sensor.channel_map.columns
        if scans.values.ndim != 2 or scans.t_s.shape != (len(scans.values),):
            seen = f"t_s has shape {scans.t_s.shape}, values {scans.values.shape}"
            raise RecordingCorrupt("a block", seen, f"give t_s (scans,) and values (scans, {columns})")
        if scans.values.shape[1] != columns:
            raise TaxelCountWrong("a block", scans.values.shape[-1], self.recording.sensor.name, columns)
        self._last_s = _latest(scans.t_s, self._last_s)
        return self.run.step(self.recording.sensor.channel_map.of_source(scans))

    def finish(self) -> Output:
        """Results that were held back; no scan may follow. Raises RunEnded when it is called again."""
        return self.run.finish()


def _latest(t_s: Floats, last_s: float) -> float:
    """The last of times (scans,) after one before. Raises RecordingCorrupt where they do not increase."""
    for scan, now_s in enumerate(t_s.tolist()):
        if not (last_s < now_s and abs(now_s) <= FARTHEST_S):  # nor do they with NaN
            after = f" after {last_s:.6f} s" if math.isfinite(last_s) else ""
            seen = f"scan {scan} is at {now_s:.6f} s{after}"
            raise RecordingCorrupt(
                "a block", seen, "give times in s that increase, or use step, which drops such scans"
            )
        last_s = now_s
    return last_s


def no_time(columns: int) -> RawScans:
    """A block of no scans."""
    return RawScans(np.zeros(0), np.zeros((0, columns)))


def _recorded(adoptions: Iterable[Adoption]) -> AsRecorded:
    """Raises ParameterInvalid for what are no adoptions."""
    try:
        return AsRecorded(adoptions)
    except (TypeError, ValueError) as error:
        raise ParameterInvalid("adoptions", adoptions, "be those that `adopted` of a former loop gave") from error
