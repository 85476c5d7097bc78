"""Cases of the score hard: how a trial differs from those of Table I, and how it is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from taxelflow.simulation.parameters import Sensing

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.estimation.base import Mode
    from taxelflow.messages import Scans
    from taxelflow.simulation.scenario import Scenario

INNER_TAXELS = (*range(144, 149), *range(151, 156))
"""Of the palm's two middle rows, between which the object slides, without those at the rows' ends."""
_QUIET_PA, _STEP_PA = 250.0, Sensing.full_scale_pa / 1023
"""Noise of a sensor better than the paper's, and its quantisation step."""


def _as_it_is(scans: Scans) -> Scans:
    return scans


@dataclass(frozen=True)
class Case:
    """A case. change: of the trial's scenario. rows: names of the rows, and which strokes each has. prepared: what is
    done to the conditioned scans.
    """

    change: Callable[[Scenario], Scenario]
    rows: tuple[tuple[str, slice], ...]
    mode: Mode = "batch"
    prepared: Callable[[Scans], Scans] = _as_it_is


def _plain(scenario: Scenario) -> Scenario:
    return scenario


def _repeated(scenario: Scenario) -> Scenario:
    return replace(scenario, motion=replace(scenario.motion, strokes=4))


def with_dead(scenario: Scenario) -> Scenario:
    """Two dead taxels under the object, drawn by the scenario's seed."""
    dead = np.random.default_rng([scenario.seed, 2]).choice(INNER_TAXELS, 2, replace=False)
    return replace(scenario, sensing=replace(scenario.sensing, dead=tuple(dead.tolist())))


def _small(scenario: Scenario) -> Scenario:
    """Eight millimetres across, on taxels of ten."""
    return replace(scenario, contact=replace(scenario.contact, radius_m=0.004))


def _rolling(scenario: Scenario) -> Scenario:
    return replace(scenario, sensing=replace(scenario.sensing, scan_share=1.0))


def _saturating(scenario: Scenario) -> Scenario:
    """Above the full scale, `Sensing.full_scale_pa`."""
    return replace(scenario, contact=replace(scenario.contact, peak_pa=200e3))


def _unrested(scenario: Scenario, scans: int = 28, travel_m: float = 0.05) -> Scenario:
    """Moving from the first to the last scan, so that there is none to learn noise and tare from.

    scans: of both speeds. travel_m: at its ends the object covers other taxels of the palm, and never leaves it.
    """
    motion = scenario.motion
    moving_m = scans / scenario.sensing.rate_hz * motion.speed_m_s
    strokes = round(moving_m / travel_m)
    return replace(scenario, motion=replace(motion, rest_s=0.0, travel_m=travel_m, strokes=strokes))


def _quiet(scenario: Scenario) -> Scenario:
    return replace(_unrested(scenario), sensing=replace(scenario.sensing, noise_pa=_QUIET_PA, baseline_pa=(0.0, 0.0)))


def _known(scans: Scans) -> Scans:
    """Scans with the noise of `_quiet` known, that of quantisation included."""
    return replace(scans, noise=np.where(scans.noise > 0, np.hypot(_QUIET_PA, _STEP_PA / 12**0.5), 0.0))


def dropped(scans: Scans) -> Scans:
    """Scans in which saturated readings are missing instead."""
    saturated = scans.pressure >= scans.ceiling
    return replace(
        scans,
        pressure=np.where(saturated, 0.0, scans.pressure),
        complete=scans.complete & ~saturated.any(axis=1, keepdims=True),
    )


def _all(name: str) -> tuple[tuple[str, slice], ...]:
    return ((name, slice(None)),)


CASES = (
    Case(_plain, _all("as in Table I")),
    Case(_repeated, (("stream, 1st stroke", slice(1)), ("stream, 2nd to 4th", slice(1, None))), "stream"),
    Case(with_dead, _all("2 unknown dead taxels")),
    Case(_small, _all("smaller than a taxel")),
    Case(_rolling, _all("rolling scan")),
    Case(_saturating, _all("saturated, censored")),
    Case(_saturating, _all("saturated, dropped"), prepared=dropped),
    Case(_unrested, _all("no idle scans")),
    Case(_quiet, _all("no idle scans, clipped")),
    Case(_quiet, _all("the same, noise known"), prepared=_known),
)
