"""From where a fit begins: states registered scan after scan, on a coarse map where the contact is large."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.template import hypotheses
from taxelflow.estimation.template.hypotheses import solve
from taxelflow.estimation.template.initialization import IncrementalMapper, start_scan
from taxelflow.estimation.template.map import LATTICE
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.rivals import any_agrees

STEP = 0.2
"""Pitches by which the texture moves along x from scan to scan."""


def texture(side: int, *, scans: int = 12, step: float = STEP) -> Scanned:
    """A texture that covers a pad of side x side taxels and slides along x."""
    places = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(float(side)), np.arange(float(side)))])
    random = np.random.default_rng(3)
    waves = random.uniform(-1.2, 1.2, (12, 2)), random.uniform(0.0, 2.0 * np.pi, 12)
    x = places[0] - step * np.arange(scans)[:, np.newaxis]
    phase = np.multiply.outer(x, waves[0][:, 0]) + np.multiply.outer(places[1], waves[0][:, 1])
    readings = 1.0 + 0.1 * np.sin(phase + waves[1]).sum(axis=2) + 1e-3 * random.standard_normal(x.shape)
    each = np.full(readings.shape, 1e-6), np.full(side**2, np.inf), np.zeros(side**2)
    return Scanned.of(0.02 * np.arange(scans), places, readings, *each)


@pytest.mark.parametrize(
    ("side", "spacing"), [(8, LATTICE.spacing), (18, LATTICE.coarse_spacing)], ids=["usual", "coarse"]
)
def test_a_large_contact_is_registered_to_a_coarse_map(side: int, spacing: float) -> None:
    scanned = texture(side)
    mapper = IncrementalMapper(scanned, start_scan(scanned), turns=False, coarse=True)
    mapper.register_all()
    assert mapper.pattern.lattice[0] == spacing
    moved = mapper.states[:, :2] - mapper.states[0, :2]
    assert moved[:, 0] == pytest.approx(STEP * np.arange(12), abs=0.1)
    assert moved[:, 1] == pytest.approx(np.zeros(12), abs=0.1)


def test_a_fit_from_a_coarse_map_is_as_exact_as_the_readings_allow() -> None:
    """0.1 % of noise on 324 taxels: the states that the fit begins from may be off by a tenth of a pitch."""
    solved = solve(texture(18))
    moved = solved.states[:, 0] - solved.states[:, 0].mean()
    assert moved == pytest.approx(STEP * (np.arange(12) - 5.5), abs=0.002)


def test_odometry_keeps_the_fine_map_as_its_poses_are_given_out() -> None:
    scanned = texture(18)
    assert IncrementalMapper(scanned, 0, turns=True).pattern.lattice[0] == LATTICE.spacing


@pytest.mark.parametrize(("step", "starts"), [(STEP, [2, 1]), (0.0, [2, 2])], ids=["slides", "rests"])
def test_centroids_that_are_far_worse_places_are_no_start_of_a_turn(step: float, starts: list[int]) -> None:
    """The centroid of what covers the pad stays where it is, whether the object slides or rests."""
    fits = hypotheses._coarse_fits(texture(12, step=step), [False, True])
    assert [sum(one.turns == turns for one in fits) for turns in (False, True)] == starts


def test_fits_agree_by_where_they_report_the_object_whatever_the_frame() -> None:
    scanned = texture(8)
    one = hypotheses._coarse_fits(scanned, [False])[0]
    shifted, other = one.copy(), one.copy()
    shifted.states[:, :2] += 3.0
    other.states[-1, 0] += 0.2
    assert any_agrees(one, [other, shifted], scanned)
    assert not any_agrees(one, [other], scanned)
    assert not any_agrees(one, [], scanned)
