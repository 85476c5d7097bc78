from __future__ import annotations

import numpy as np
import pytest

from drawn import drawn, labels, layout_of, segmented
from synthetic import grid_sensor, pieces, scans_of
from taxelflow.contacts.segmentation import ABSENT, NEAR, SEPARATE, TOUCHING, ContactTracker

OLD = 5


def test_unloaded_taxels_beside_a_contact_have_its_number_negative() -> None:
    assert labels("9....8", beside=True) == ["1a..b2"]
    assert labels("9.8", beside=True) == ["1a2"]  # of the more loaded one
    assert labels("8.9", beside=True) == ["2a1"]


@pytest.mark.parametrize(
    ("image", "clearance"),
    [
        ("9...8", [SEPARATE, SEPARATE]),
        ("9..8.", [SEPARATE, SEPARATE]),
        ("9.8..", [SEPARATE, NEAR]),  # the taxel between is the more loaded one's
        ("97568", [TOUCHING, TOUCHING]),
        ("9....", [SEPARATE, ABSENT]),
    ],
)
def test_clearance_is_how_near_other_contacts_are(image: str, clearance: list[int]) -> None:
    assert segmented(*["9...8"] * OLD, image).contacts["clearance"][-1, 0].tolist() == clearance


def test_a_contact_is_connected_if_it_is_one_component() -> None:
    found = segmented("78889", "78.89", "78889")
    assert found.contacts["connected"][:, 0].tolist() == [[True, False], [False, False], [True, False]]


def test_a_pad_with_one_contact_at_most_needs_no_tracking() -> None:
    assert labels("9.e.8", ".....", slots=1) == ["1.1.1", "....."]


def test_a_pad_without_contact_forgets_its_contacts() -> None:
    images = ["9....8", "......", "8....9"]
    found = segmented(*images, contact=[True, False, True])
    assert not found.labels[1].any()
    assert (found.contacts["clearance"][1] == ABSENT).all()
    assert found.labels[2][[0, 5]].tolist() == [2, 1]
    assert (found.contacts["clearance"][2] == SEPARATE).all()  # no number waits


def test_a_missing_reading_does_not_split_a_contact() -> None:
    assert labels("99999", "99.99", complete=[True, False])[1] == "11111"
    assert labels("99999", *["99.99"] * 6, complete=[True, *[False] * 6])[-1] == "11111"


def test_pads_are_segmented_each_by_itself() -> None:
    layout = grid_sensor(1, 6, pads=3).layout
    tracker = ContactTracker(layout, np.array([0, 2]), np.array([2, 3]), 6.0, 4.0)
    values = np.array([[90, 0, 0, 0, 0, 80.0] * 3])
    found = tracker.step(scans_of(grid_sensor(1, 6, pads=3), values, noise=1.0))
    assert found.labels[0].tolist() == [1, -1, 0, 0, -2, 2, *[0] * 6, 1, -1, 0, 0, -2, 2]
    assert found.contacts.shape == (1, 2, 3)


def test_contacts_do_not_depend_on_how_scans_are_cut_into_blocks() -> None:
    images = [*["9....8"] * 6, *["975468"] * 3, *["9....8"] * 3, *["......"] * 2, "..9..."]
    scans = drawn(images)
    whole = segmented(*images)
    tracker = ContactTracker(layout_of(images[0]), np.array([0]), np.array([2]), 6.0, 4.0)
    parts = [tracker.step(piece) for piece in pieces(scans, [1, 7, 8])]
    np.testing.assert_array_equal(whole.labels, np.concatenate([part.labels for part in parts]))
    np.testing.assert_array_equal(whole.contacts, np.concatenate([part.contacts for part in parts]))
