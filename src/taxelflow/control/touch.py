"""From the scans of a grip's pads to a controller's input, by all stages of a stream, scan by scan.

`TouchStream` runs a pipeline of its own. A loop around `taxelflow.Live` gives each scan and its output to `Facing`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.acquire.base import Recording
from taxelflow.condition.parameters import Conditioner
from taxelflow.control.base import Touch
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import RawScans
from taxelflow.pipeline.stages import Pipeline
from taxelflow.runtime import registry
from taxelflow.sensors.kinematics import PadKinematics

if TYPE_CHECKING:
    from taxelflow.estimation.base import Estimator
    from taxelflow.messages import Floats, Output
    from taxelflow.sensors.sensor import Sensor

_MIRRORED = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0]])
"""Signs of x, y, theta: the pads face each other, so x and rotation are mirrored on the second."""

_MIDDLE = 0.5
"""Without rotation, the velocity of a pad is that of a point near the centroid of the load. Standard deviation of that
point from the centroid, in standard deviations of the load. Measured: 0.45 to 0.6."""


class Facing:
    """Input of a controller from a stream's output for two pads that face each other, with parallel y axes."""

    def __init__(self, sensor: Sensor, down: Floats | None = None) -> None:
        """down: see `TouchStream`. Raises ParameterInvalid for a sensor that has not two pads alike."""
        layout = sensor.layout
        if len(layout.pads) != 2 or layout.shapes[0] != layout.shapes[1]:
            raise ParameterInvalid("sensor", sensor.name, "have two pads of the same shape, without groups")
        self._felt, self._axes = _Felt(sensor, _MIRRORED, down), np.tile(np.eye(2), (2, 1, 1))

    def touch(self, t_s: float, readings: Floats, out: Output | None) -> Touch:
        """readings: (2, taxels), in the sensor's unit. out: of this scan; None without an estimator."""
        return self._felt.touch(t_s, readings, out, self._axes)


class OnHand:
    """Input of a controller from a stream's output for a hand's pads, on links that its joints move."""

    def __init__(self, sensor: Sensor, down: Floats | None) -> None:
        """down: see `TouchStream`. Raises HandModelInvalid, ExtraMissing."""
        self._felt, self._kinematics = _Felt(sensor, np.ones((len(sensor.pads), 3)), down), PadKinematics(sensor)

    def touch(self, t_s: float, readings: Floats, out: Output | None, joints: Floats) -> Touch:
        """readings: (taxels,), in the sensor's unit. out: as of `Facing`. joints: angles in the order of its model."""
        rotation = self._kinematics.poses(joints[np.newaxis])[0, :, :3, :3]
        return self._felt.touch(t_s, readings, out, rotation[:, :, :2].transpose(0, 2, 1))


class _Felt:
    """The common part of both. signs: (pads, 3), of the pads' velocities in the grip's frame.

    A missing reading counts as the last one of its taxel: a message that is lost is no grip that is open. After a jump
    of the sensor's clock the time goes on as that of the stream's output.
    """

    def __init__(self, sensor: Sensor, signs: Floats, down: Floats | None) -> None:
        self._signs, self._to_si, self._last_s, self._down = signs, sensor.to_si, np.nan, down
        self._area_m2 = sensor.layout.area_m2[: sensor.layout.taxels]
        self._starts = sensor.layout.starts[: sensor.layout.pad_count]
        self._pressure: Floats = np.zeros(0)

    def touch(self, t_s: float, readings: Floats, out: Output | None, axes: Floats) -> Touch:
        pads, pressure = len(self._signs), self._last_known(readings * self._to_si)
        t_s = self._placed(t_s, out)
        dt_s, self._last_s = (0.0 if np.isnan(self._last_s) else t_s - self._last_s), t_s
        force_n = float(pressure.ravel() @ self._area_m2) / 2
        slipping, velocity, ready = np.zeros(pads, dtype=np.bool_), np.full((pads, 3), np.nan), out is None
        covariance, detail_m = np.full((pads, 3, 3), np.nan), np.full(pads, np.nan)
        place_m, place_std_m, by_taxel_m2 = np.full((pads, 2), np.nan), np.zeros(pads), np.full((pads, 2, 2), np.nan)
        if out is not None and len(out):
            slips, signs = out.slips, self._signs
            slipping = out.suspected[-1, :pads]
            velocity, ready = signs * slips.velocity[-1, :pads], True
            square_s2 = slips.span_s[-1, :pads, None, None] ** 2
            both = signs[:, :, None] * signs[:, None, :]
            variance = both * slips.displacement_covariance[-1, :pads]
            covariance = variance / square_s2
            turns = np.isfinite(velocity[:, 2])
            place_m = signs[:, :2] * np.where(
                turns[:, None], slips.pose[-1, :pads, :2], out.contacts.centroid[-1, :pads]
            )
            spread_m = np.sqrt((out.contacts.axes[-1, :pads] ** 2).mean(axis=1)) / 4
            place_std_m = np.where(turns, 0.0, _MIDDLE * spread_m)
            share = out.contacts.force[-1, :pads] / out.contacts.force_std[-1, :pads]
            by_taxel_m2 = (share**2 / self._loaded(pressure))[:, None, None] * variance[:, :2, :2] / 2
            detail_m = share * np.sqrt(_least(variance) if self._down is None else _along(variance, axes @ self._down))
        felt = Touch(t_s, dt_s, pressure, force_n, slipping, velocity, axes, covariance, detail_m, place_m)
        return replace(felt, ready=ready, place_std_m=place_std_m, by_taxel_m2=by_taxel_m2)

    def _last_known(self, pressure: Floats) -> Floats:
        """Pressures without those missing; 0 of a taxel that has never had one."""
        before = self._pressure if self._pressure.shape == pressure.shape else np.zeros_like(pressure)
        self._pressure = np.where(np.isfinite(pressure), pressure, before)
        return self._pressure

    def _placed(self, t_s: float, out: Output | None) -> float:
        """The time of a scan, not before that of the last one. A repeated or late scan has no output, and no time."""
        if out is None or np.isnan(self._last_s):
            return float(np.fmax(t_s, self._last_s))
        return float(out.slips.t_s[-1]) if len(out) else self._last_s

    def _loaded(self, pressure: Floats) -> Floats:
        """(pads,), number of taxels that share a pad's load, at least 1: the squared sum over the sum of squares."""
        own = np.maximum(pressure.ravel(), 0.0)
        total, squares = (np.add.reduceat(one, self._starts) for one in (own, own**2))
        number: Floats = np.divide(total**2, squares, out=np.ones_like(total), where=squares > 0.0)
        return number


def _least(variance: Floats) -> Floats:
    """(pads,), m^2: half of the smallest eigenvalue of the variance of a displacement.

    variance: (pads, 3, 3), of a displacement between two scans.
    """
    xx, xy, yy = variance[:, 0, 0], variance[:, 0, 1], variance[:, 1, 1]
    least: Floats = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    return least.clip(0.0) / 2


def _along(variance: Floats, direction: Floats) -> Floats:
    """The same along a direction in space, given by its components (pads, 2) in the pads' planes; infinite if 0."""
    along = np.einsum("pi,pij,pj->p", direction, variance[:, :2, :2], direction) / 2
    seen = (direction**2).sum(axis=1) ** 2
    return np.asarray(np.divide(along, seen, out=np.full(len(seen), np.inf), where=seen > 0.0))


class TouchStream:
    """The estimator in the loop."""

    def __init__(self, sensor: Sensor, estimator: Estimator | str | None, down: Floats | None = None) -> None:
        """estimator: None for pressures only. down: unit vector (n,) of the load that is to be borne, in the grip's
        frame; None if it is unknown. Raises ParameterInvalid for a sensor without a hand or two pads alike.
        """
        self._grip, self._run = OnHand(sensor, down) if sensor.hand else Facing(sensor, down), None
        if estimator is not None:
            part = registry.find("estimator", estimator)() if isinstance(estimator, str) else estimator
            pipeline = Pipeline(part, "stream", Conditioner(tare="none"))
            self._run = pipeline.start(Recording.live(sensor))

    def step(self, t_s: float, readings: Floats, joints: Floats) -> Touch:
        """readings: (2, taxels) or of a hand (taxels,), in the sensor's unit. joints: angles of a hand."""
        out = None if self._run is None else self._run.step(RawScans(np.array([t_s]), readings.reshape(1, -1)))
        if isinstance(self._grip, OnHand):
            return self._grip.touch(t_s, readings, out, joints)
        return self._grip.touch(t_s, readings, out)
