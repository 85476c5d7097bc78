"""Whether a pattern explains a scan: by what is left of the readings, not by chi-square alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimation.template.test_residual_process import (
    ERROR,
    LATTICE,
    NEVER,
    PLACES,
    STATE_0,
    TAXELS,
    VARIANCE,
    WHOLE,
    pattern,
    track,
    values,
)
from rigged import rigged
from synthetic import dome, grid_sensor, recorded
from taxelflow.estimation.template.linearization import Frame, Packed, frame_of, look_up, pack_scan
from taxelflow.estimation.template.map import Surface
from taxelflow.estimation.template.online.explained import UNEXPLAINED, fits, unexplained, unexplained_and_doubted
from taxelflow.estimation.template.online.hand import PadScan
from taxelflow.estimation.template.online.relocalization import relocalise
from taxelflow.estimation.template.online.starting import FirstScan, first_pattern
from taxelflow.estimation.template.online.track_state import Track
from taxelflow.messages import LOST, OK, UNRESOLVED
from taxelflow.numerics.centroid import LOADED
from taxelflow.numerics.records import record
from taxelflow.numerics.robust import gate
from taxelflow.pipeline import api
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.messages import Floats

SURFACE = Surface(pattern(), np.zeros((25, 25)), LATTICE)
BESIDE = STATE_0 + np.array([40.0, 0.0, 0.0, 0.0, 0.0])


def left(reading: Floats, state: Floats = STATE_0, variance: Floats = VARIANCE, ceiling: Floats = NEVER) -> float:
    return compared(reading, state, variance, ceiling)[0]


def compared(
    reading: Floats, state: Floats, variance: Floats = VARIANCE, ceiling: Floats = NEVER
) -> tuple[float, Floats]:
    """What is left, and where the pattern has its centre (2,)."""
    centre = np.zeros(2)
    frame, taxels = looked_up(reading, state, variance, ceiling)
    return unexplained(frame, taxels, ERROR, centre), centre


def looked_up(
    reading: Floats, state: Floats, variance: Floats = VARIANCE, ceiling: Floats = NEVER
) -> tuple[Frame, Packed]:
    frame, taxels = frame_of(LATTICE, state), pack_scan(PLACES, WHOLE, reading, variance, ceiling, ERROR)
    look_up(SURFACE, frame, taxels)
    return frame, taxels


def test_a_pattern_has_its_centre_where_what_taxels_read_of_it_has() -> None:
    shown = values()
    np.testing.assert_allclose(compared(shown, STATE_0)[1], PLACES @ shown / shown.sum(), atol=1e-9)
    few = np.where(PLACES[0] > STATE_0[0], 0.0, VARIANCE)  # one half masked, as beyond a border
    part = np.where(few > 0.0, shown, 0.0)
    np.testing.assert_allclose(compared(shown, STATE_0, few)[1], PLACES @ part / part.sum(), atol=1e-9)
    np.testing.assert_allclose(compared(shown, BESIDE)[1], BESIDE[:2])  # nothing of it is on the pad


def test_nothing_is_left_where_the_object_is_and_all_beside_it() -> None:
    noisy = values() + np.random.default_rng(0).normal(0.0, 0.5, TAXELS)
    assert left(values()) == 0.0
    assert left(noisy) < 1e-3
    assert left(values(), BESIDE) == pytest.approx(1.0, abs=0.01)


def test_what_noise_leaves_of_a_faint_scan_is_explained() -> None:
    faint = STATE_0 * np.array([1.0, 1.0, 1.0, 0.01, 1.0])
    reading = 0.01 * values() + np.random.default_rng(0).normal(0.0, 0.5, TAXELS)
    assert left(reading, faint) < UNEXPLAINED.most
    assert left(reading, faint, VARIANCE / 100.0) > UNEXPLAINED.most


def test_masked_and_saturated_taxels_leave_nothing() -> None:
    peak = int(np.argmax(values()))
    wrong, masked, ceiling = values(), VARIANCE.copy(), NEVER.copy()
    wrong[peak] = 10.0 * wrong[peak]
    assert left(wrong) > UNEXPLAINED.most
    masked[peak] = 0.0
    assert left(wrong, variance=masked) == 0.0
    cut = values()
    cut[peak] = ceiling[peak] = 0.1 * cut[peak]
    assert left(cut, ceiling=ceiling) == 0.0
    assert left(np.zeros(TAXELS)) == 0.0


def test_a_small_chi_square_is_not_enough() -> None:
    m = record(Track, track(), 0)
    m.chi, m.count, m.unexplained = 0.1, 49.0, 0.9
    assert not fits(m)
    m.unexplained = 0.1
    assert fits(m)


@pytest.mark.parametrize(("share", "strange"), [(0.04, False), (0.4, True)])
def test_what_the_sensor_may_have_unseen_is_no_misfit(share: float, strange: bool) -> None:
    """Chi-square of the readings in the contact, with the sensor's error in their variance: silent taxels add none."""
    level, unseen = float(values().max()), 0.05 * float(values().max())
    reading = values() * np.where(np.arange(TAXELS) % 2, 1.0 + share, 1.0 - share)
    frame, taxels = looked_up(reading, STATE_0)
    more, least = unseen**2 - ERROR**2, LOADED.skirt * level
    _, chi, count = unexplained_and_doubted(frame, taxels, ERROR, more, least, np.zeros(2), np.zeros((5, 5)))
    loaded = np.maximum(reading, values()) > least
    assert count == loaded.sum() < TAXELS
    np.testing.assert_allclose(chi, np.sum((reading - values())[loaded] ** 2 / (VARIANCE[loaded] + unseen**2)))
    assert (chi > gate(1.0, count) * count) == strange


def test_a_known_pattern_is_not_recognised_where_it_explains_nothing() -> None:
    """A wide pad: the pattern may lie on silent taxels, all of which it explains."""
    places = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(-9.0, 10.0), np.arange(-9.0, 10.0))])
    variance, never, still = np.ones(places.shape[1]), np.full(places.shape[1], np.inf), np.zeros(places.shape[1])

    def scan_of(reading: Floats) -> PadScan:
        count = places.shape[1]
        return PadScan(reading, variance, never, reading, places, np.zeros(count, np.bool_), np.zeros((4, count)))

    bump = scan_of(100.0 * np.exp(-0.5 * (places[0] ** 2 + places[1] ** 2)))
    first = FirstScan(0.0, bump, bump, np.ones(len(still)), np.zeros(len(still), np.bool_), 0.05, still, np.zeros(2))
    known = first_pattern(first)
    far = scan_of(np.where((places[0] == 9.0) & (np.abs(places[1]) < 1.5), 30.0, 0.0))
    assert relocalise(known, np.zeros(2), bump) is not None
    assert relocalise(known, np.zeros(2), far) is None


@pytest.mark.long
def test_a_pattern_that_explains_nothing_is_given_up_after_two_scans() -> None:
    """Another object comes, all points, at the other end of the pad."""
    sensor = grid_sensor(8, 16, pitch_m=(0.005, 0.005))
    slides = [dome(sensor, x, radius_m=0.006) for x in np.linspace(-0.03, -0.02, 20)]
    points = np.where((sensor.layout.x_m > 0.0) & ((sensor.layout.row + sensor.layout.col) % 3 == 0), 3e4, 0.0)
    readings = np.concatenate([np.zeros((20, 128)), slides, np.tile(points, (12, 1))])
    noise = np.random.default_rng(0).normal(0.0, 200.0, readings.shape)
    quality = api.estimate(recorded(readings + noise, sensor), "template", mode="stream").slips.quality[40:, 0]
    assert LOST in quality[:2]
    assert LOST not in quality[2:]


def test_the_first_pose_on_a_pattern_of_one_scan_is_not_resolved() -> None:
    """The highest of three domes touches first: the object is 6 mm from where its first scan shows it."""
    sensor = grid_sensor(8, 16, pitch_m=(0.005, 0.005))
    first = dome(sensor, -0.012, radius_m=0.006)
    whole = first + dome(sensor, 0.012, 0.006, radius_m=0.006) + dome(sensor, 0.006, -0.008, radius_m=0.006)
    contacts = [np.zeros((20, 128)), 0.4 * first[np.newaxis], np.tile(whole, (12, 1))] * 2
    readings = np.concatenate(contacts)
    noise = np.random.default_rng(0).normal(0.0, 200.0, readings.shape)
    slips = api.estimate(recorded(readings + noise, sensor), "template", mode="stream").slips
    quality = slips.quality[:, 0]
    assert np.hypot(*(slips.pose[30, 0, :2] - slips.pose[20, 0, :2])) > 0.006
    assert quality[[20, 53]].tolist() == [UNRESOLVED] * 2
    assert quality[30] == OK
    assert quality[63] < UNRESOLVED


@pytest.mark.long
def test_a_rigid_object_is_never_lost() -> None:
    slips = api.estimate(simulate(rigged("slide-and-turn")), "template", mode="stream").slips
    assert not (slips.quality == LOST).any()
