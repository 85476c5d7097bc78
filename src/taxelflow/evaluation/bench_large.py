"""Processor time of batches of `template` on contacts that cover a large pad."""

from __future__ import annotations

from dataclasses import replace
from time import process_time
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from taxelflow.pipeline import api
from taxelflow.simulation.scenario import Contact, Load, Motion, Scenario, Sensing
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.evaluation.bench_effort import Effort


class _Case(NamedTuple):
    """What all contacts have in common."""

    pitch_mm: float = 2.0
    pitches: float = 5.0
    """Length of the slide."""
    rate_hz: float = 50.0
    rest_s: float = 0.1
    unseen: tuple[float, float] = (0.0, 0.05)
    """Unseen errors of the sensor: of the rig, and what sensor files have that declare none."""


_CASE = _Case()


class LargePad(msgspec.Struct, frozen=True):
    """One batch of `template`."""

    pad: str
    taxels: int
    scans: int
    unseen_error: float
    cpu_s: float
    """Of all threads."""


def large_pads(rows: int, cols: int, scans: int, effort: Effort) -> list[LargePad]:
    """Batches of one contact that covers a pad of rows x cols, by unseen error; the fastest of several each."""
    recording = simulate(_covering(rows, cols, scans))
    found = []
    for unseen in _CASE.unseen:
        sensor = msgspec.structs.replace(recording.sensor, unseen_error=unseen)
        own = replace(recording, sensor=sensor)
        cpu_s = min(_seconds(own) for _ in range(effort.large_rounds))
        found.append(LargePad(f"{rows}x{cols}", rows * cols, recording.scans or 0, unseen, cpu_s))
    return found


def _covering(rows: int, cols: int, scans: int) -> Scenario:
    """A textured object that covers the pad and slides."""
    pitch_m, moving_s = 1e-3 * _CASE.pitch_mm, (scans + 0.5) / _CASE.rate_hz - 2.0 * _CASE.rest_s
    travel_m = _CASE.pitches * pitch_m
    return Scenario(
        sensor=f"grid:{rows}x{cols}@{_CASE.pitch_mm:g}mm,kPa",
        pad="grid",
        contact=Contact("textured", radius_m=max(rows, cols) * pitch_m),
        motion=Motion(
            speed_m_s=travel_m / moving_s,
            direction_rad=0.5,
            travel_m=travel_m,
            strokes=1,
            middle_m=(0.0, 0.0),
            rest_s=_CASE.rest_s,
        ),
        load=Load(lift_s=_CASE.rest_s),
        sensing=Sensing(rate_hz=_CASE.rate_hz),
    )


def _seconds(recording: Recording) -> float:
    start = process_time()
    api.estimate(recording, "template")
    return process_time() - start
