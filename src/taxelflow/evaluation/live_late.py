"""Error of the template against the delay with which it adopts its maps, as on a busy machine."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from taxelflow.estimation.template.parameters import Template
from taxelflow.evaluation.pose_errors import contacts_of, without_frame
from taxelflow.evaluation.strokes import ungrouped
from taxelflow.messages import LOST, OK, joined
from taxelflow.pipeline.stages import Pipeline
from taxelflow.runtime.adoption import Late
from taxelflow.simulation.motion import move
from taxelflow.simulation.scenario import SCENARIOS, Scenario
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from taxelflow.messages import Floats

_SCENARIOS = ("stroke", "slide-and-turn", "feet-on-grid")


class LateRow(msgspec.Struct, frozen=True):
    """Errors of position against the rig's truth, of poses that are `ok`, each contact's frame taken off."""

    scenario: str
    delay_s: float
    rms_mm: float
    ratio: float
    """To that without delay."""
    posed: float
    """Share of the scans in contact whose pose is `ok`."""


def late_rows(seeds: Sequence[int], delays_s: Sequence[float] = (0.0, 0.1, 0.5, 2.0)) -> Iterator[LateRow]:
    """A row for each scenario and delay, over these seeds. The first delay is what the others are compared with."""
    for name in _SCENARIOS:
        first = None
        for delay_s in delays_s:
            found = [_squares(replace(SCENARIOS[name], seed=seed), delay_s) for seed in seeds]
            squares = np.concatenate(found)
            known = squares[np.isfinite(squares)]
            rms_m = float(np.sqrt(np.mean(known))) if len(known) else np.nan
            first = first or rms_m
            yield LateRow(name, delay_s, 1e3 * rms_m, rms_m / first, len(known) / len(squares))


def _squares(scenario: Scenario, delay_s: float) -> Floats:
    """(scans in contact,), squared errors of position, m^2; NaN without a pose."""
    recording = ungrouped(simulate(scenario))
    pad = recording.layout.pads.index(recording.known_truth.pad)
    run = Pipeline(Template(), "stream").start(recording, Late(delay_s))
    slips = joined(list(run)).slips
    pose, quality = slips.pose[:, pad], slips.quality[:, pad]
    true = move(scenario.motion, slips.t_s - np.nan_to_num(slips.lag_s[:, pad]), scenario.seed).pose
    known = np.isfinite(pose[:, :2]).all(axis=1) & (quality == OK)
    squares = np.full(len(slips), np.nan)
    for own in contacts_of(known, np.cumsum(~slips.contact[:, pad] | (quality == LOST))):
        error = without_frame(pose[own], true[own], np.ones((len(own), 3)))
        squares[own] = np.sum(error[:, :2] ** 2, axis=1)
    return squares[slips.contact[:, pad]]
