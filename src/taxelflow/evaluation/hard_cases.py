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

_STREAMED = 4
"""Strokes of one object in a stream."""
_SMALL_M = 0.004
"""Radius: eight millimetres across, on taxels of ten."""
_SATURATING_PA = 200e3
"""Largest pressure of a contact that saturates: above the full scale, `Sensing.full_scale_pa`."""
INNER_TAXELS = (*range(144, 149), *range(151, 156))
"""Of the palm's two middle rows, between which the object slides, without those at the rows' ends."""
_DEAD = 2
"""Dead taxels, and the stream of random numbers that chooses them."""
_QUIET_PA, _STEP_PA = 250.0, Sensing.full_scale_pa / 1023
"""Noise of a sensor better than the paper's, and its quantisation step."""
_UNRESTED_M = 0.05
"""Travel, m: at its ends the object covers other taxels of the palm, and never leaves it."""
_UNRESTED_SCANS = 28
"""Scans at both speeds, all of them moving."""


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
    return replace(scenario, motion=replace(scenario.motion, strokes=_STREAMED))


def with_dead(scenario: Scenario) -> Scenario:
    """Two dead taxels under the object, drawn by the scenario's seed."""
    dead = np.random.default_rng([scenario.seed, _DEAD]).choice(INNER_TAXELS, _DEAD, replace=False)
    return replace(scenario, sensing=replace(scenario.sensing, dead=tuple(dead.tolist())))


def _small(scenario: Scenario) -> Scenario:
    return replace(scenario, contact=replace(scenario.contact, radius_m=_SMALL_M))


def _rolling(scenario: Scenario) -> Scenario:
    return replace(scenario, sensing=replace(scenario.sensing, scan_share=1.0))


def _saturating(scenario: Scenario) -> Scenario:
    return replace(scenario, contact=replace(scenario.contact, peak_pa=_SATURATING_PA))


def _unrested(scenario: Scenario) -> Scenario:
    """Moving from the first to the last scan, so that there is none to learn noise and tare from."""
    motion = scenario.motion
    moving_m = _UNRESTED_SCANS / scenario.sensing.rate_hz * motion.speed_m_s
    strokes = round(moving_m / _UNRESTED_M)
    return replace(scenario, motion=replace(motion, rest_s=0.0, travel_m=_UNRESTED_M, strokes=strokes))


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
