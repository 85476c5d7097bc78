"""Objects that turn on the spot, on a skin whose taxels differ by more than its errors say."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from synthetic import grid_sensor, recorded
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from collections.abc import Callable

    from taxelflow.acquire.base import Recording
    from taxelflow.messages import Floats

SIDE, FINE, RATE_HZ = 12, 5, 50.0
_LINE = np.arange(SIDE) - (SIDE - 1) / 2
_PLACES = np.column_stack([np.tile(_LINE, SIDE), np.repeat(-_LINE, SIDE)])
_INSIDE = 1.8 * ((np.arange(FINE) + 0.5) / FINE - 0.5)  # neighbours read a part of a taxel's load
_POINTS = _PLACES[:, np.newaxis, np.newaxis] + np.stack(np.meshgrid(_INSIDE, _INSIDE), axis=-1)
_SENSOR = grid_sensor(SIDE, SIDE, pitch_m=(0.004, 0.004))


def square(x: Floats, y: Floats) -> Floats:
    """A square of 4.2 pitches."""
    pressed: Floats = np.asarray((np.abs(x) < 2.1) & (np.abs(y) < 2.1), np.float64)
    return pressed


def gear(x: Floats, y: Floats) -> Floats:
    """A gear of nine teeth and 6 pitches, with a bore and a keyway."""
    distance, keyway = np.hypot(x, y), (np.abs(y) < 0.25) & (x > 0.0) & (x < 1.5)
    edge = 3.0 * (1.0 + 0.12 * np.tanh(4.0 * np.cos(9.0 * np.arctan2(y, x))))
    pressed: Floats = np.asarray((distance < edge) & (distance > 1.0) & ~keyway, np.float64)
    return pressed


def bar(x: Floats, y: Floats) -> Floats:
    """A bar of 6.5 by 2 pitches."""
    pressed: Floats = np.asarray((np.abs(x) < 3.25) & (np.abs(y) < 1.0), np.float64)
    return pressed


def turning(shape: Callable[[Floats, Floats], Floats], turn: Floats) -> Recording:
    """A shape that turns on the spot (scans,), after half a second without contact."""
    random = np.random.default_rng(0)
    gains = np.clip(1.0 + 0.2 * random.standard_normal(SIDE**2), 0.5, 1.6)
    scans = [np.zeros(SIDE**2)] * round(0.5 * RATE_HZ)
    for angle in turn:
        cos, sin = np.cos(angle), np.sin(angle)
        body = cos * _POINTS[..., 0] + sin * _POINTS[..., 1], cos * _POINTS[..., 1] - sin * _POINTS[..., 0]
        scans.append(2e4 * gains * shape(*body).mean(axis=(1, 2)) ** 0.6)
    values = np.array(scans) + random.normal(0.0, 20.0, (len(scans), SIDE**2))
    return recorded(values, _SENSOR, np.arange(len(values)) / RATE_HZ)


def turn_by(degrees: float, seconds: float) -> Floats:
    """(scans,), at rest for half a second before and after."""
    share = np.clip(np.arange(round((seconds + 1.0) * RATE_HZ)) / RATE_HZ - 0.5, 0.0, seconds) / seconds
    turn: Floats = np.radians(degrees) * share**2 * (3.0 - 2.0 * share)
    return turn


@pytest.mark.parametrize("shape", [square, gear])
def test_what_seems_to_turn_by_a_part_of_its_turn_has_no_angle(shape: Callable[[Floats, Floats], Floats]) -> None:
    turn = turn_by(90.0, 3.0)
    found = api.estimate(turning(shape, turn), "template")["pad0"]
    theta = found.pose[-len(turn) :, 2]
    known = np.isfinite(theta)
    np.testing.assert_allclose(theta[known], turn[known], atol=np.radians(10.0))
    assert np.mean(found.quality[-len(turn) :] == "ok") > 0.5  # it does not move


def test_a_bar_that_turns_as_far_keeps_its_angle() -> None:
    turn = turn_by(90.0, 3.0)
    theta = api.estimate(turning(bar, turn), "template")["pad0"].pose[-len(turn) :, 2]
    np.testing.assert_allclose(theta, turn, atol=np.radians(5.0))
