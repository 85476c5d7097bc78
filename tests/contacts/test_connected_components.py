from __future__ import annotations

import numpy as np
import pytest

from compiled import compiled
from drawn import layout_of, reading
from taxelflow.contacts.adjacency import adjacency
from taxelflow.contacts.connected_components import label_components as _label_components
from taxelflow.contacts.tracks import SegmentedPad, Taxel
from taxelflow.numerics.records import records

label_components = compiled(_label_components)


def components(image: str, masked: tuple[int, ...] = (), *, incomplete: bool = False) -> str:
    """The component of each taxel, drawn like the image, `.` for none."""
    values = reading(image)
    noise = np.ones(len(values))
    noise[list(masked)] = 0.0
    pads, taxels = records(SegmentedPad, 1), records(Taxel, len(values))
    pads["stop"], pads["contact_off"] = len(values), 4.0
    count = label_components(values, noise, incomplete, pads[0], taxels, adjacency(layout_of(image), np.array([0])))
    assert count == taxels["component"].max()
    cols = len(image.split(maxsplit=1)[0])
    text = "".join(".123456789"[k] for k in taxels["component"])
    return " ".join(text[start : start + cols] for start in range(0, len(text), cols))


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        ("99.9 9..9", "11.2 1..2"),
        ("9... .9.. ..9. ...9", "1... .1.. ..1. ...1"),  # corners connect
        ("99999 9...9 9.9.9 9...9 99999", "11111 1...1 1.2.1 1...1 11111"),  # a ring and what is within it
        ("9.9 9.9 999", "1.1 1.1 111"),  # found from two ends, one component
        ("...", "..."),
    ],
)
def test_connected_loaded_taxels_have_one_number(image: str, expected: str) -> None:
    assert components(image) == expected


def test_a_taxel_is_loaded_above_four_standard_deviations() -> None:
    assert components("e.e") == "1.2"


def test_a_masked_taxel_between_two_loaded_ones_is_bridged() -> None:
    assert components("9.9", masked=(1,)) == "111"
    assert components("99. ...", masked=(5,)) == "11. ..."  # beside one only
    assert components("9..9", masked=(1, 2)) == "1..2"  # a gap of two stays


def test_a_missing_taxel_is_bridged_only_in_an_incomplete_scan() -> None:
    assert components("9.9") == "1.2"
    assert components("9.9", incomplete=True) == "111"
