from __future__ import annotations

import pytest

from drawn import labels

OLD = 5
"""Scans after which contacts that meet stay two."""


def test_a_shared_component_is_cut_in_the_valley() -> None:
    assert labels(*["9....8"] * OLD, "975468")[-1] == "111222"
    assert labels(*["9....8"] * OLD, "953678")[-1] == "112222"


def test_the_highest_taxel_is_assigned_first() -> None:
    """The second contact comes to the plateau over 6, the first one over 2."""
    assert labels(*["9.....8"] * OLD, "9255568")[-1] == "1122222"


def test_a_taxel_goes_to_its_highest_neighbours_contact() -> None:
    assert labels(*["9...8 ....."] * OLD, "95.68 ..4..")[-1] == "11.22 ..2.."
    assert labels(*["9...8 ....."] * OLD, "96.58 ..4..")[-1] == "11.22 ..1.."


@pytest.mark.parametrize(("flank", "expected"), [("4", "122222"), ("5", "112222")])
def test_markers_are_above_half_of_a_contacts_former_peak(flank: str, expected: str) -> None:
    """The second taxel now lies on the second contact's slope, and goes to it unless it is a marker of the first."""
    assert labels(*[f"9{flank}...8"] * OLD, "567898")[-1] == expected


def test_a_component_of_one_contact_is_all_its_own() -> None:
    assert labels(*["9....8"] * OLD, "99..88")[-1] == "11..22"


@pytest.mark.parametrize(("scans", "expected"), [(2, True), (3, False)])
def test_a_contact_without_a_peak_of_its_own_ends_after_three_scans(scans: int, expected: bool) -> None:
    found = labels(*["9...8"] * OLD, *["98765"] * scans)
    assert ("2" in found[-1]) == expected
    assert "2" in found[OLD]


def test_a_contact_whose_peak_comes_back_stays() -> None:
    found = labels(*["9...8"] * OLD, *["98765"] * 2, "95258", *["98765"] * 2)
    assert "2" in found[-1]


def test_nor_do_scans_without_a_peak_count_from_before_it_stood_alone() -> None:
    found = labels(*["9...8"] * OLD, *["98765"] * 2, "9...8", *["98765"] * 2)
    assert "2" in found[-1]
