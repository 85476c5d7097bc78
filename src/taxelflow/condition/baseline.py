"""Baseline of a sensor: tare offset, noise, masked and faulty taxels, estimated from a sample of its scans."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.health import Finding, find_faults
from taxelflow.condition.noise import MIN_NOISE_SHARE, estimate_noise
from taxelflow.condition.tare import estimate_offset
from taxelflow.condition.units import SATURATED_SHARE, full_scale
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Bools, Floats

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.condition.base import ConditionSettings
    from taxelflow.condition.sample import Sample
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """What a session knows of its sensor, in SI units.

    offset, noise: (taxels,), of readings before any filter. tared: (pads,), groups left out. masked: (taxels,),
    declared off, without any reading, or masked by option. findings: faulty taxels, masked or not.
    """

    offset: Floats
    noise: Floats
    tared: Bools
    masked: Bools
    findings: tuple[Finding, ...]


def estimate_baseline(
    parameters: ConditionSettings, sensor: Sensor, sample: Sample, masked: Bools, *, causal: bool
) -> Baseline:
    """Baseline from a sample. masked: (taxels,) declared off. causal: the sample is the first window of a stream."""
    layout, windows = sensor.layout, sample.windows
    silent = ~np.isfinite(windows).any(axis=(0, 1)) if len(windows) else np.zeros(layout.taxels, dtype=np.bool_)
    noise, masked, findings = _noise_and_faults(parameters, sensor, sample, masked | silent)
    offset = np.zeros(layout.taxels)
    tared = np.zeros(layout.pad_count, dtype=np.bool_)
    reference = (sensor.full_scale or 0.0) * sensor.to_si
    if not causal:  # the largest reading is known only where the future is
        reference = max(reference, float(np.max(windows, initial=0.0, where=np.isfinite(windows))))
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        if parameters.tare == "none" or masked[own].all() or not len(windows):
            continue
        if parameters.tare == "start":
            found: Floats | None = _known_mean(sample.first[:, own])
        else:
            found = estimate_offset(windows[:, :, own], noise[own], masked[own], layout.neighbours(pad), reference)
        if found is not None:
            offset[own], tared[pad] = found, True
    return Baseline(offset, noise, tared, masked, findings)


def update_baseline(parameters: ConditionSettings, sensor: Sensor, sample: Sample, before: Baseline) -> Baseline:
    """The same tare with noise and faults from a larger sample: loaded taxels show their noise only under load."""
    noise, masked, findings = _noise_and_faults(parameters, sensor, sample, before.masked)
    return replace(before, noise=noise, masked=masked, findings=findings)


def with_masked(masked: Bools, taxels: Iterable[int]) -> Bools:
    """A copy of masked (taxels,) with more taxels. Raises ParameterInvalid if the sensor has none of that number."""
    more = masked.copy()
    for taxel in taxels:
        if taxel >= len(masked):
            raise ParameterInvalid("mask", taxel, f"list taxels between 0 and {len(masked) - 1}")
        more[taxel] = True
    return more


def _noise_and_faults(
    parameters: ConditionSettings, sensor: Sensor, sample: Sample, masked: Bools
) -> tuple[Floats, Bools, tuple[Finding, ...]]:
    """Noise, masks and findings. Masked taxels are not judged; with `mask` auto faulty ones are masked as well."""
    noise = _noise(sensor, sample, masked)
    findings = find_faults(sample.windows, noise, masked, sensor.layout)
    if parameters.mask == "auto" and findings:
        masked = with_masked(masked, (finding.taxel for finding in findings))
        noise = _noise(sensor, sample, masked)
    return noise, masked, findings


def _noise(sensor: Sensor, sample: Sample, masked: Bools) -> Floats:
    largest_gain = max(sensor.gain, default=1.0)
    step = sensor.to_si * largest_gain if sensor.unit == "count" else 0.0  # a count is a whole number
    unknown = MIN_NOISE_SHARE * (sensor.full_scale or 0.0) * sensor.to_si
    return estimate_noise(sample.windows, masked, step, unknown, SATURATED_SHARE * full_scale(sensor))


def _known_mean(scans: Floats) -> Floats:
    """(taxels,), mean over the known readings of scans (scans, taxels)."""
    known = np.isfinite(scans)
    mean: Floats = np.where(known, scans, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return mean
