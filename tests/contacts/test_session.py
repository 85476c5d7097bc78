from __future__ import annotations

import numpy as np
import pytest

from synthetic import assert_same, dome, grid_sensor, pieces, scans_of
from taxelflow.contacts.features import ContactFeatures
from taxelflow.contacts.session import ContactSession
from taxelflow.messages import Floats, Scans, joined, no_scans
from taxelflow.sensors.sensor import Sensor, with_contacts

GRID = grid_sensor(6, 16, pitch_m=(0.004, 0.004))
NOISE = 100.0
SCANS = 40


def two_domes() -> Floats:
    """(scans, taxels): one dome rests, the other moves away from it by 16 mm."""
    way = np.linspace(0.0, 0.016, SCANS)
    still = dome(GRID, -0.02, radius_m=0.003)
    return np.array([still + dome(GRID, 0.004 + x, radius_m=0.003, peak=40e3) for x in way])


def session(sensor: Sensor) -> ContactSession:
    return ContactFeatures().start(sensor, 6.0, 4.0)


def scans(sensor: Sensor) -> Scans:
    """The same scans as the conditioner gives them: a split contact still holds all of its pad's taxels."""
    layout = sensor.layout
    values = np.take(two_domes(), layout.source, axis=1)
    blank = no_scans(layout.entries, len(layout.pads), SCANS)
    noise = np.full(layout.entries, NOISE)
    return Scans(np.arange(SCANS) / 25.0, values, noise, blank.ceiling, np.ones_like(blank.contact), blank.complete)


def test_a_pad_as_one_contact_keeps_its_scans_and_is_found_to_move_apart() -> None:
    given = scans_of(GRID, two_domes(), noise=NOISE)
    contacts = session(GRID)
    segmented = contacts.step(given)
    assert segmented.scans is given
    assert segmented.moved_apart[-1].tolist() == segmented.unfit[-1].tolist() == [True]
    assert not segmented.remembered.any()
    assert len(contacts.notes) == 1
    assert segmented.contacts.force[:, 0] == pytest.approx(given.pressure.sum(axis=1) * 0.004**2)


def test_split_contacts_hold_their_own_taxels_and_are_described_by_them() -> None:
    sensor = with_contacts(GRID, 2)
    given = scans(sensor)
    before = given.pressure.copy()
    contacts = session(sensor)
    segmented = contacts.step(given)
    np.testing.assert_array_equal(given.pressure, before)  # the conditioner's scans stay as they are
    assert segmented.scans.contact.all()
    assert segmented.unfit[-1].tolist() == [True, False, False]
    assert contacts.notes == []
    whole, first, second = segmented.contacts.force.T
    np.testing.assert_allclose(first + second, whole, rtol=1e-3)
    np.testing.assert_allclose(segmented.contacts.centroid[:, 1, 0], -0.02, atol=2e-4)
    np.testing.assert_allclose(segmented.contacts.centroid[-1, 2, 0], 0.02, atol=2e-4)


def test_what_a_skin_may_remember_is_unfit_and_is_no_motion_of_contacts() -> None:
    left = np.where(np.arange(SCANS) < 30, 1.0, 0.05)  # a load that goes, and what is left of it
    contacts = session(GRID)
    segmented = contacts.step(scans_of(GRID, left[:, np.newaxis] * dome(GRID, 0.0, radius_m=0.003), noise=NOISE))
    assert segmented.remembered[:, 0].tolist() == segmented.unfit[:, 0].tolist() == [k >= 30 for k in range(SCANS)]
    assert not segmented.moved_apart.any()
    assert contacts.notes == ["scans without an ok pose, as the skin may remember a load that has left: 10 of pad0"]


@pytest.mark.parametrize("split", [1, 2])
def test_results_do_not_depend_on_how_scans_are_cut_into_blocks(split: int) -> None:
    sensor = with_contacts(GRID, split)
    whole = session(sensor).step(scans(sensor))
    running = session(sensor)
    parts = [running.step(piece) for piece in pieces(scans(sensor), [1, 7, 7, 30])]
    assert_same(whole.scans, joined([part.scans for part in parts]))
    assert_same(whole.contacts, joined([part.contacts for part in parts]))
    np.testing.assert_array_equal(whole.unfit, np.concatenate([part.unfit for part in parts]))
