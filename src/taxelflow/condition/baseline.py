"""Baseline of a sensor: tare offset, noise, masked and faulty taxels, estimated from a sample of its scans."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.condition.converter import MIN_NOISE_SHARE, are_whole, levels_of, lowest_reading, step_of
from taxelflow.condition.dead_lines import find_dead_lines
from taxelflow.condition.health import Finding, find_faults
from taxelflow.condition.held_load import holds_load
from taxelflow.condition.noise import estimate_noise
from taxelflow.condition.resting import near_taxels
from taxelflow.condition.tare import Offsets, find_offsets
from taxelflow.condition.units import SATURATED_SHARE, full_scale
from taxelflow.errors import ParameterInvalid
from taxelflow.messages import Bools, Floats
from taxelflow.numerics.rounding import CERTAIN, ROUNDING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from taxelflow.condition.base import ConditionSettings
    from taxelflow.condition.sample import Sample
    from taxelflow.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """Offsets, noise and faults of a sensor, in SI units.

    offset, noise: (taxels,), of readings before any filter. offset_std: (taxels,), standard deviation of the offset's
    error; inf where the offset is unknown. known: (taxels,), whether the offset is from the taxel's own scans. tared:
    (pads,), without groups, whether any offset of a pad is. masked: (taxels,), declared off, without any reading, stuck
    at a load, or masked by option. findings: faulty taxels, masked or not. withdrawn: (pads,), without groups, whether
    a stream's first offsets of a pad turned out to hold a load.
    """

    offset: Floats
    offset_std: Floats
    known: Bools
    noise: Floats
    tared: Bools
    masked: Bools
    findings: tuple[Finding, ...]
    withdrawn: Bools


def estimate_baseline(
    parameters: ConditionSettings, sensor: Sensor, sample: Sample, masked: Bools, *, causal: bool
) -> Baseline:
    """Baseline from a sample. masked: (taxels,) declared off. causal: the sample is the first window of a stream."""
    layout = sensor.layout
    silent: Bools = np.zeros(layout.taxels, dtype=np.bool_)
    if len(sample):
        silent = np.asarray(~np.isfinite(sample.windows).any(axis=(0, 1)), dtype=np.bool_)
    noise, masked, findings = _noise_and_faults(parameters, sensor, sample, masked | silent)
    nothing = Baseline(
        offset=np.zeros(layout.taxels),
        offset_std=np.where(masked, 0.0, np.inf),
        known=np.zeros(layout.taxels, dtype=np.bool_),
        noise=noise,
        tared=np.zeros(layout.pad_count, dtype=np.bool_),
        masked=masked,
        findings=findings,
        withdrawn=np.zeros(layout.pad_count, dtype=np.bool_),
    )
    return _with_offsets(parameters, sensor, sample, nothing, causal=causal)


def update_baseline(parameters: ConditionSettings, sensor: Sensor, sample: Sample, before: Baseline) -> Baseline:
    """The baseline of a stream from a larger sample: noise, faults, and the offsets that were unknown before."""
    noise, masked, findings = _noise_and_faults(parameters, sensor, sample, before.masked)
    again = {found.taxel for found in findings}  # of what is masked, only silent taxels are judged again
    kept = [found for found in before.findings if before.masked[found.taxel] and found.taxel not in again]
    findings = tuple(sorted([*kept, *findings], key=attrgetter("taxel")))
    same = replace(before, noise=noise, masked=masked, findings=findings)
    return _with_offsets(parameters, sensor, sample, same, causal=True)


def _with_offsets(
    parameters: ConditionSettings, sensor: Sensor, sample: Sample, before: Baseline, *, causal: bool
) -> Baseline:
    """The baseline with offsets for the taxels whose offset was unknown.

    Offsets that would change by less than the noise stay: a new offset interrupts the motion of its pad.
    """
    layout, windows = sensor.layout, sample.windows
    if parameters.tare == "none" or not len(windows):
        return before
    if causal:
        before = _without_loads(parameters, sensor, windows, before)
    if (before.known | before.masked).all():
        return before
    scale = sensor.full_scale * sensor.to_si if sensor.full_scale else np.inf
    reference = scale
    if not causal:  # a stream does not know its largest reading yet
        largest = float(np.max(windows, initial=0.0, where=np.isfinite(windows)))
        reference = max(largest, scale if np.isfinite(scale) else 0.0) or np.inf
    offset, std, known, tared = before.offset.copy(), before.offset_std.copy(), before.known.copy(), before.tared.copy()
    near, cut = near_taxels(layout), _clipped(sensor, windows)
    for pad in range(layout.pad_count):
        own = layout.of_pad(pad)
        if (known | before.masked)[own].all():
            continue
        pad_windows = windows[:, :, own]
        if parameters.tare == "start":
            found: Offsets | None = _declared(sample.first[:, own], before.noise[own])
        else:
            found = find_offsets(
                pad_windows,
                before.noise[own],
                before.masked[own],
                near[own] - own.start,
                layout.neighbours(pad),
                scale=scale,
                reference=reference,
                cut=cut[own],
            )
        if found is not None:
            new = ~known[own] & ~(tared[pad] & (np.abs(found.offset - offset[own]) <= before.noise[own]))
            offset[own], std[own] = np.where(new, found.offset, offset[own]), np.where(new, found.std, std[own])
            known[own] |= found.known & new
            tared[pad] = True
    if np.array_equal(offset, before.offset):
        offset = before.offset
    return replace(before, offset=offset, offset_std=std, known=known, tared=tared)


def _without_loads(parameters: ConditionSettings, sensor: Sensor, windows: Floats, before: Baseline) -> Baseline:
    """The baseline without the offsets of pads that hold a load, by what the stream has read since.

    Where offsets follow the drift, windows of before say nothing about them.
    """
    if parameters.tare != "auto" or parameters.drift == "follow" or not before.tared.any():
        return before
    withdrawn: Bools = np.zeros_like(before.tared)
    for pad in np.flatnonzero(before.tared):
        own = sensor.layout.of_pad(int(pad))
        withdrawn[pad] = holds_load(before.offset[own], windows[:, :, own], before.noise[own], before.masked[own])
    if not withdrawn.any():
        return before
    taxels = np.repeat(withdrawn, np.diff(sensor.layout.starts[: sensor.layout.pad_count + 1]))
    return replace(
        before,
        offset=np.where(taxels, 0.0, before.offset),
        offset_std=np.where(taxels & ~before.masked, np.inf, before.offset_std),
        known=before.known & ~taxels,
        tared=before.tared & ~withdrawn,
        withdrawn=before.withdrawn | withdrawn,
    )


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
    """Noise, masks and findings. Masked taxels are not judged; with `mask` auto faulty ones are masked as well.

    Those stuck at a load always are: it would count as a contact that never ends, and stop the tare of its pad.
    """
    noise = _noise(sensor, sample, masked)
    by_taxel = find_dead_lines(sample.windows, noise, masked, sensor.layout)
    for found in find_faults(sample.windows, noise, masked, sensor.layout):
        if found.fault != "gain" or found.taxel not in by_taxel:  # the line is why
            by_taxel[found.taxel] = found
    findings = tuple(by_taxel[taxel] for taxel in sorted(by_taxel))
    least = _clipped(sensor, sample.windows) + CERTAIN * noise
    held = np.stack([least, SATURATED_SHARE * full_scale(sensor)])  # at the lowest or largest reading it may be clipped
    off = [found.taxel for found in findings if parameters.mask == "auto" or _is_stuck_within(found, held)]
    if off:
        masked = with_masked(masked, off)
        noise = _noise(sensor, sample, masked)
    return noise, masked, findings


def _is_stuck_within(found: Finding, limits: Floats) -> bool:
    """Whether a taxel is stuck between the limits (2, taxels) of its readings."""
    least, most = limits[:, found.taxel]
    return found.fault == "stuck" and bool(least < found.value < most)


def _noise(sensor: Sensor, sample: Sample, masked: Bools) -> Floats:
    largest_gain = max(sensor.gain, default=1.0)
    counts = sensor.unit == "count" and are_whole(_sent(sample.windows, sensor))
    step = sensor.to_si * largest_gain if counts else 0.0
    unknown = MIN_NOISE_SHARE * (sensor.full_scale or 0.0) * sensor.to_si
    layout = sensor.layout
    pads = np.repeat(np.arange(layout.pad_count), np.diff(layout.starts[: layout.pad_count + 1]))
    near, ceiling = near_taxels(layout), SATURATED_SHARE * full_scale(sensor)
    lowest = _clipped(sensor, sample.windows) if np.ptp(sensor.channel_map.offset) else None
    windows = sample.windows
    return estimate_noise(windows, masked, pads, near, step=step, unknown=unknown, ceiling=ceiling, lowest=lowest)


def _clipped(sensor: Sensor, windows: Floats) -> Floats:
    """(taxels,), readings that would be lower are clipped: numbers end at one value, which offsets of the taxels shift.

    windows: (windows, scans, taxels).
    """
    source = sensor.channel_map
    if not np.ptp(source.offset):
        return np.full(windows.shape[2], lowest_reading(windows))
    unit, numbers = sensor.to_si * source.gain, source.polarity * _sent(windows, sensor)
    levels = levels_of(numbers)
    if not len(levels):
        return np.zeros(windows.shape[2])
    step = 1.0 if sensor.unit == "count" and are_whole(numbers) else step_of(levels)
    lowest = levels[0] + 0.5 * step + ROUNDING * np.abs(levels).max()
    clipped: Floats = unit * (lowest - source.polarity * source.offset)
    return clipped


def _sent(windows: Floats, sensor: Sensor) -> Floats:
    """Numbers as the source sent them, of windows (windows, scans, taxels) in SI."""
    source = sensor.channel_map
    return windows / (sensor.to_si * source.gain * source.polarity) + source.offset


def _declared(scans: Floats, noise: Floats) -> Offsets:
    """Offsets of the taxels of a pad, from scans (scans, taxels) that the user declares idle."""
    known = np.isfinite(scans)
    count = np.maximum(known.sum(axis=0), 1)
    mean: Floats = np.where(known, scans, 0.0).sum(axis=0) / count
    return Offsets(mean, noise / np.sqrt(count), np.ones(len(noise), dtype=np.bool_))
