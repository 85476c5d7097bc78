"""Slips of one pad that rests and slides, made up for tests, and what the slip detector makes of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from taxelflow.evaluation.slip_scoring import still_slips
from taxelflow.messages import Bools, Event, Floats, Slips
from taxelflow.slip.parameters import SlipMonitor
from taxelflow.slip.session import SlipSession

STD = np.array([2e-5, 2e-5, 1e-3])
RATE_HZ = 100.0
NAN = float("nan")


def noise(scans: int, seed: int = 0) -> Floats:
    drawn: Floats = STD * np.random.default_rng(seed).standard_normal((scans, 3))
    return drawn


def slips_of(pose: Floats, *, load: Any = None, theta: bool = True, t_s: Any = None) -> Slips:
    """One pad's slips from its poses (scans, 3), whose noise is STD."""
    times = np.arange(len(pose)) / RATE_HZ if t_s is None else t_s
    slips = still_slips(times, pose, STD, np.full(3, NAN))
    if load is not None:
        slips = replace(slips, load=np.asarray(load, dtype=float)[:, np.newaxis])
    if not theta:
        slips.displacement[..., 2] = NAN
        slips.displacement_covariance[..., 2, :] = slips.displacement_covariance[..., :, 2] = NAN
    return slips


def slid(velocity: tuple[float, float, float], *, scans: int = 300, begin: int = 100, end: int = 200) -> Floats:
    """Poses that move from scan `begin` to scan `end`, with noise."""
    moved = np.clip(np.arange(scans) - begin, 0, end - begin)[:, np.newaxis] / RATE_HZ * velocity
    return noise(scans) + moved


def watched(*blocks: Slips, monitor: SlipMonitor | None = None) -> tuple[Bools, list[Event], SlipSession]:
    session = (monitor or SlipMonitor()).begin(tuple(f"pad{k}" for k in range(blocks[0].contact.shape[1])))
    found = [session.step(block) for block in blocks]
    flags = np.concatenate([one.slipping for one in found])
    return flags, [event for one in found for event in one.events], session


def kinds(events: list[Event]) -> list[str]:
    return [event.event for event in events]
