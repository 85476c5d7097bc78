"""A smooth round object that spins leaves the pressure where it is: recordings of it are those of one at rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from costly import mostly_long
from taxelflow.acquire.base import Recording
from taxelflow.messages import Floats, RawScans, SpatialMotions
from taxelflow.numerics.geometry import quaternion_of
from taxelflow.pipeline import api
from taxelflow.publish.spatial import in_words
from taxelflow.sensors.pads import Pad
from taxelflow.sensors.sensor import Sensor

RATE_HZ, IDLE, SCANS = 100.0, 20, 70
RADIUS_M, SIDE, PITCH_M = 0.04, 6, 0.004
SIDES = ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))
Pattern = Callable[[int, Floats, Floats], Floats]


def hand(normals: tuple[tuple[int, int, int], ...]) -> Sensor:
    """Pads about the origin, which face it."""
    pads = []
    for number, side in enumerate(normals):
        z = -np.array(side, dtype=np.float64)
        y = np.array([0.0, 0.0, 1.0]) if not side[2] else np.array([0.0, 1.0, 0.0])
        R = np.column_stack([np.cross(y, z), y, z])
        pose = tuple((-RADIUS_M * z).tolist() + quaternion_of(R[np.newaxis])[0].tolist())
        pads.append(Pad(name=f"pad{number}", rows=SIDE, cols=SIDE, pitch_m=(PITCH_M, PITCH_M), pose=pose))
    return Sensor(name="hand", unit="Pa", pads=tuple(pads), full_scale=2e5, unseen_error=0.0)


def held(sensor: Sensor, pattern: Pattern, speed_m_s: float = 0.0) -> Recording:
    """An object whose patterns stay, or move along y of the pads after a while."""
    layout, random = sensor.layout, np.random.default_rng(0)
    values = 2e3 + random.normal(0.0, 300.0, (SCANS, layout.taxels))
    for pad in range(len(sensor.pads)):
        own = layout.of_pad(pad)
        for scan in range(IDLE, SCANS):
            moved = speed_m_s * max(scan - 2 * IDLE, 0) / RATE_HZ
            values[scan, own] += pattern(pad, layout.x_m[own], layout.y_m[own] - moved)
    raw = RawScans(np.arange(SCANS) / RATE_HZ, np.maximum(values, 0.0))

    def read() -> Iterator[RawScans]:
        yield raw

    return Recording("held", "memory", sensor, read, scans=SCANS)


def sphere(_pad: int, x: Floats, y: Floats) -> Floats:
    """Hertz."""
    return 6e4 * np.sqrt(np.maximum(1 - (x**2 + y**2) / 0.007**2, 0.0))


def cylinder(_pad: int, x: Floats, _y: Floats) -> Floats:
    """Hertz, its axis along y of the pads."""
    return 6e4 * np.sqrt(np.maximum(1 - x**2 / 0.006**2, 0.0))


def cloth(pad: int, x: Floats, y: Floats) -> Floats:
    """Waves about two pitches and a half long."""
    random = np.random.default_rng(pad)
    waves = random.normal(0.0, 2 * np.pi / 0.011, (14, 2))
    phase = np.outer(x, waves[:, 0]) + np.outer(y, waves[:, 1]) + random.uniform(0, 2 * np.pi, 14)
    return np.maximum(3e4 + 2.2e4 * np.cos(phase).sum(axis=1) / np.sqrt(7), 0.0)


def moved_by(recording: Recording, method: str) -> SpatialMotions:
    spatial = api.estimate(recording, method).spatial
    assert spatial is not None
    return spatial


def is_blind(found: SpatialMotions, motion: Floats) -> bool:
    """Whether a twist (6,) lies in what the last scan does not observe."""
    basis = found.blind[-1][np.abs(found.blind[-1]).max(axis=1) > 0].T
    rest = motion - basis @ np.linalg.lstsq(basis, motion, rcond=None)[0]
    return bool(np.abs(rest).max() < 0.05)


@pytest.mark.parametrize("method", mostly_long(["convolution", "template"], "convolution"))
def test_a_smooth_sphere_has_no_observable_turn(method: str) -> None:
    found = moved_by(held(hand((*SIDES, (0, 0, 1))), sphere), method)
    late = slice(2 * IDLE, None)
    assert (found.rank[late] <= 3).all()
    assert (found.pose_rank[late] <= 3).all()
    assert np.isnan(found.twist[late, 3:]).all()
    np.testing.assert_allclose(found.twist[late, :3], 0.0, atol=2e-3)
    assert (np.sqrt(np.diagonal(found.twist_covariance, axis1=1, axis2=2))[late, 3:] > 3.0).all()  # rad/s
    for axis in np.eye(6)[3:]:
        assert is_blind(found, axis)
    assert sum(words.startswith("turn about") for words in in_words(found.blind[-1])) == 3


@pytest.mark.parametrize("method", mostly_long(["convolution", "template"], "convolution"))
def test_a_smooth_cylinder_may_spin_and_slide_along_its_axis(method: str) -> None:
    found = moved_by(held(hand(SIDES), cylinder), method)
    late = slice(2 * IDLE, None)
    assert np.isnan(found.twist[late][:, [2, 5]]).all()
    assert np.isfinite(found.twist[late, :2]).all()
    assert is_blind(found, np.eye(6)[2])
    assert is_blind(found, np.eye(6)[5])


@pytest.mark.parametrize("method", mostly_long(["convolution", "template"], "convolution"))
def test_a_textured_object_at_rest_is_known_to_rest(method: str) -> None:
    found = moved_by(held(hand(SIDES), cloth), method)
    assert (found.rank[2 * IDLE :] == 6).all()
    assert np.abs(found.twist[2 * IDLE :]).max() < 0.05


def test_a_smooth_object_that_moves_is_followed() -> None:
    found = moved_by(held(hand(SIDES), sphere, 0.01), "convolution")
    assert found.twist[-1, 2] == pytest.approx(0.01, rel=0.3)
    assert np.isnan(found.twist[-1, 5])


def test_knobs_that_go_round_with_an_object_show_its_turn() -> None:
    def knob(pad: int, x: Floats, y: Floats) -> Floats:
        return sphere(pad, y, x)

    sensor = hand(SIDES)
    layout = sensor.layout
    recording = held(sensor, knob)
    (raw,) = recording.read()
    values = raw.values.copy()
    for pad in range(len(sensor.pads)):
        own = layout.of_pad(pad)
        for scan in range(IDLE, SCANS):
            along = 0.01 * max(scan - 2 * IDLE, 0) / RATE_HZ  # all along x, which goes round
            values[scan, own] += knob(pad, layout.x_m[own] - along, layout.y_m[own]) - knob(
                pad, layout.x_m[own], layout.y_m[own]
            )
    turning = Recording("knobs", "memory", sensor, lambda: iter((RawScans(raw.t_s, values),)), scans=SCANS)
    found = moved_by(turning, "convolution")
    assert abs(found.twist[-1, 5]) == pytest.approx(0.01 / RADIUS_M, rel=0.3)
