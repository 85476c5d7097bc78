from __future__ import annotations

import pytest

from drawn import labels, segmented


def test_the_most_loaded_new_contact_takes_the_lowest_number() -> None:
    assert labels("5....9") == ["2....1"]
    assert labels("5..7..9", slots=3) == ["3..2..1"]


def test_a_contact_keeps_its_number_whatever_the_load() -> None:
    assert labels("5....9", "9....5")[1] == "2....1"


def test_a_faint_component_starts_no_contact_but_belongs_to_the_nearest() -> None:
    assert labels("e.....") == ["......"]
    assert labels("9..e......9") == ["1..1......2"]
    assert labels("9......e..8") == ["1......2..2"]


def test_one_component_too_many_belongs_to_the_nearest_contact() -> None:
    assert labels("9..5......8") == ["1..1......2"]


@pytest.mark.parametrize(("before", "expected"), [("3333.9", "11.122"), ("3322.9", "11.222")])
def test_a_component_continues_each_contact_that_had_a_quarter_of_its_load_there(before: str, expected: str) -> None:
    """The fourth taxel held 1/4 or 1/5 of the first contact; it joins the second one, the third vanishes."""
    assert labels(*[before] * 5, "33.339")[-1] == expected


def test_a_component_with_less_of_a_contact_continues_it_if_no_other_has_more() -> None:
    assert labels("29999", "2.999")[-1] == "1.111"


def test_a_lost_contact_is_looked_for_within_three_pitches_if_there_are_others() -> None:
    near = segmented("9.......8 ......... .........", "........8 ......... ..9......")
    assert near.labels[1].reshape(3, 9)[2, 2] == 1
    assert near.contacts["clearance"][1].all()
    far = segmented("9.........8", "...9......8")
    assert far.labels[1][3] == 1  # the lowest free number, which was in use: a scan without contact
    assert far.contacts["clearance"][:, 0].tolist() == [[3, 3], [0, 3]]


def test_the_only_contact_is_looked_for_anywhere() -> None:
    found = segmented("9..........", "..........9")
    assert found.contacts["clearance"][:, 0].tolist() == [[3, 0], [3, 0]]


@pytest.mark.parametrize(("age", "expected"), [(4, "11111"), (5, "11222")])
def test_contacts_that_meet_while_one_is_new_merge(age: int, expected: str) -> None:
    apart, met = "95.58", "95168"
    assert labels(*[apart] * age, met)[-1] == expected


def test_the_older_contact_takes_all_of_a_new_one_it_meets() -> None:
    first, second, met = ".....9.", "9....9.", "999999."
    assert labels(*[first] * 6, second, met)[-1] == "111111."


def test_the_older_contact_takes_the_separate_parts_of_a_new_one_too() -> None:
    assert labels(*["9......."] * 6, "9..7777.", "99997.77")[-1] == "11111.11"


def test_of_equally_old_contacts_the_lower_number_stays() -> None:
    assert labels("5...9", "55599") == ["2...1", "11111"]


def test_a_contact_whose_parts_are_separate_for_three_scans_becomes_two() -> None:
    together, apart = "78889", "78.89"
    assert labels(together, apart, apart) == ["11111", "11.11", "11.11"]
    found = labels(together, apart, apart, apart, apart)
    assert found[3:] == ["22.11", "22.11"]  # the larger part keeps its number


def test_parts_that_meet_again_in_between_stay_one() -> None:
    together, apart = "78889", "78.89"
    assert labels(together, *[apart] * 2, together, *[apart] * 2)[-1] == "11.11"


def test_parts_stay_one_without_a_free_number() -> None:
    together, apart = "78889....6", "78.89....6"
    assert labels(together, *[apart] * 5)[-1] == "11.11....2"


def test_a_faint_part_is_no_contact_of_its_own() -> None:
    together, apart = "ee999", "ee.99"
    assert labels(together, *[apart] * 5)[-1] == "11.11"


def test_a_number_in_use_in_the_scan_before_waits_for_one_scan() -> None:
    found = segmented("9.....8.....", "......8....9", "......8....9")
    assert found.contacts["clearance"][:, 0].tolist() == [[3, 3], [0, 3], [3, 3]]
    assert found.labels[1].tolist()[-1] == 1
