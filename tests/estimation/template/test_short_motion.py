"""Motions that are too short for a map to show their length: how much shorter the centre of pressure finds them."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.template.short_motion import stretched
from taxelflow.messages import Floats


def line(length: float, direction: tuple[float, float] = (0.8, 0.6)) -> Floats:
    """(41, 2), places along a line of a length, in pitches."""
    places: Floats = np.linspace(-0.5, 0.5, 41)[:, np.newaxis] * length * np.array(direction)
    return places


def doubt(motion: float, of_centre: float, *, border: float = 0.0) -> float:
    """Distance at the end of a motion from where the centre of pressure puts it, both in pitches."""
    apart = stretched(line(motion), line(of_centre), np.ones(41), np.full(41, border))
    return float(np.hypot(*apart[-1]))


def test_a_short_motion_is_as_uncertain_as_the_centre_finds_it_shorter() -> None:
    assert doubt(1.2, 0.8) == pytest.approx(0.2)


@pytest.mark.parametrize(("motion", "of_centre"), [(0.5, 0.5), (0.4, 0.6), (3.0, 2.0), (0.0, 0.3)])
def test_no_doubt_of_motions_that_are_not_longer_or_not_short(motion: float, of_centre: float) -> None:
    assert doubt(motion, of_centre) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("border", [0.5, 1.0])
def test_load_at_the_border_does_not_shorten_a_motion(border: float) -> None:
    assert doubt(1.2, 0.6, border=border) == pytest.approx(0.0, abs=1e-12)


def test_scans_without_a_centre_do_not_count() -> None:
    places, centres, weights = line(1.2), line(0.8), np.ones(41)
    places[3], centres[3], weights[3] = 50.0, -50.0, 0.0
    apart = stretched(places, centres, weights, np.zeros(41))
    assert not apart[3].any()
    assert np.hypot(*apart[-1]) == pytest.approx(0.2, abs=0.02)
