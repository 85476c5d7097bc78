from __future__ import annotations

import numpy as np

from taxelflow.messages import Floats
from taxelflow.sensors.projection import SphereMap

RADIUS = 0.08


def ball(count: int = 60) -> tuple[Floats, Floats]:
    """Places on the lower part of a sphere around (0, 0, 0.1), with normals inwards."""
    random = np.random.default_rng(0)
    polar, azimuth = random.uniform(0, 2.0, count), random.uniform(-np.pi, np.pi, count)
    polar[:8] = 0.05
    way = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), -np.cos(polar)], axis=1)
    return np.array([0, 0, 0.1]) + RADIUS * way, -way


def test_the_centre_is_where_the_normals_meet_and_distances_from_the_pole_are_true() -> None:
    places, normals = ball()
    shown = SphereMap(places, normals)
    np.testing.assert_allclose(shown.centre_m, [0, 0, 0.1], atol=1e-9)
    flat = shown.project(places)
    lowest = places[np.argsort(places[:, 2])[:8]].mean(axis=0) - shown.centre_m
    pole = lowest / np.linalg.norm(lowest)
    angle = np.arccos((places - shown.centre_m) @ pole / RADIUS)
    np.testing.assert_allclose(np.linalg.norm(flat, axis=1), RADIUS * angle, atol=1e-9)


def test_a_turn_about_the_pole_is_a_turn_on_the_map_and_vectors_keep_their_length() -> None:
    places, normals = ball()
    shown = SphereMap(places, normals)
    pole = -shown._axes[2]
    vectors = np.cross(0.5 * pole, places - shown.centre_m)
    carried, flat = shown.carry(places, vectors), shown.project(places)
    np.testing.assert_allclose(np.linalg.norm(carried, axis=1), np.linalg.norm(vectors, axis=1), rtol=1e-9)
    np.testing.assert_allclose(np.sum(carried * flat, axis=1), 0, atol=1e-7)


def test_a_flat_hand_is_its_own_map() -> None:
    random = np.random.default_rng(1)
    places = np.column_stack([random.uniform(-0.05, 0.05, (30, 2)), np.zeros(30)])
    shown = SphereMap(places, np.tile([0.0, 0.0, 1.0], (30, 1)))
    pairs = [(k, k + 1) for k in range(29)]
    np.testing.assert_allclose(shown.distortion(places, pairs), 1.0, atol=1e-4)


def test_taxels_without_neighbours_have_the_distortion_of_the_nearest_ones() -> None:
    places, normals = ball()
    shown = SphereMap(places, normals)
    apart = np.linalg.norm(places[:, np.newaxis] - places, axis=2) + np.diag(np.full(len(places), np.inf))
    nearest = list(enumerate(np.argmin(apart, axis=1).tolist()))
    assert shown.distortion(places, []) == shown.distortion(places, nearest)
    assert shown.distortion(places, [])[1] > 1.0
    assert shown.distortion(places[:1], []) == (1.0, 1.0)
    assert shown.distortion(places[[0, 0]], [(0, 1)]) == (1.0, 1.0)
