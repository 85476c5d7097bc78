"""What is learned of a sensor from a sample of its scans: noise, tare, masks, taxels that are not well."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.health import Finding, examine
from taxelflow.condition.noise import RANGE_FLOOR, learn_noise
from taxelflow.condition.tare import learn_offset
from taxelflow.condition.units import SATURATED, full_scale
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.condition.parameters import Conditioner
    from taxelflow.condition.sample import Sample
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What a session knows of its sensor, in SI units.

    offset, noise: (taxels,), of readings before any filter. tared: (pads,), groups left out. masked: (taxels,),
    declared off, never heard from, or masked as told. findings: taxels that are not well, masked or not.
    """

    offset: Floats
    noise: Floats
    tared: Bools
    masked: Bools
    findings: tuple[Finding, ...]


def learn(asked: Conditioner, sensor: Sensor, sample: Sample, masked: Bools, *, causal: bool) -> Learned:
    """All of it. masked: (taxels,) declared off. causal: the sample is the first window of a stream."""
    layout, windows = sensor.layout, sample.windows
    silent = ~np.isfinite(windows).any(axis=(0, 1)) if len(windows) else np.zeros(layout.taxels, dtype=np.bool_)
    noise, masked, findings = _judge(asked, sensor, sample, masked | silent)
    offset = np.zeros(layout.taxels)
    tared = np.zeros(layout.pad_count, dtype=np.bool_)
    reference = (sensor.full_scale or 0.0) * sensor.to_si  # what an offset must be small against,
    if not causal:  # and, where the future is known, the largest reading
        reference = max(reference, float(np.max(windows, initial=0.0, where=np.isfinite(windows))))
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        if asked.tare == "none" or masked[own].all() or not len(windows):
            continue
        if asked.tare == "start":
            found: Floats | None = _mean(sample.first[:, own])
        else:
            found = learn_offset(windows[:, :, own], noise[own], masked[own], layout.neighbours(pad), reference)
        if found is not None:
            offset[own], tared[pad] = found, True
    return Learned(offset, noise, tared, masked, findings)


def relearn(asked: Conditioner, sensor: Sensor, sample: Sample, before: Learned) -> Learned:
    """Noise of a loaded taxel shows only under load, and a bad one only in time; the tare stays."""
    noise, masked, findings = _judge(asked, sensor, sample, before.masked)
    return replace(before, noise=noise, masked=masked, findings=findings)


def masked_too(masked: Bools, taxels: Iterable[int]) -> Bools:
    """Masks and these taxels besides. Raises ParameterInvalid if the sensor has none of that number."""
    more = masked.copy()
    for taxel in taxels:
        if taxel >= len(masked):
            raise ParameterInvalid("mask", taxel, f"list taxels between 0 and {len(masked) - 1}")
        more[taxel] = True
    return more


def _judge(
    asked: Conditioner, sensor: Sensor, sample: Sample, masked: Bools
) -> tuple[Floats, Bools, tuple[Finding, ...]]:
    """Noise, masks and findings: what is masked goes unjudged, what `mask` asks for is masked besides."""
    noise = _noise(sensor, sample, masked)
    findings = examine(sample.windows, noise, masked, sensor.layout)
    if asked.mask == "auto" and findings:
        masked = masked_too(masked, (finding.taxel for finding in findings))
        noise = _noise(sensor, sample, masked)
    return noise, masked, findings


def _noise(sensor: Sensor, sample: Sample, masked: Bools) -> Floats:
    largest = max(sensor.gain, default=1.0)
    step = sensor.to_si * largest if sensor.unit == "count" else 0.0  # a count is a whole number
    unknown = RANGE_FLOOR * (sensor.full_scale or 0.0) * sensor.to_si
    return learn_noise(sample.windows, masked, step, unknown, SATURATED * full_scale(sensor))


def _mean(start: Floats) -> Floats:
    """Of (scans, taxels), over what was heard."""
    heard = np.isfinite(start)
    mean: Floats = np.where(heard, start, 0.0).sum(axis=0) / np.maximum(heard.sum(axis=0), 1)
    return mean
