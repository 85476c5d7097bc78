from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

from taxelflow.publish.plots.marks import draw_scale, show_box
from taxelflow.publish.plots.style import pressure_unit, styled, three_digits


@pytest.mark.parametrize(("wide_mm", "words"), [(3.9, "0.5 mm"), (64.0, "10 mm"), (250.0, "50 mm")])
def test_the_scale_is_a_round_length_of_an_eighth_of_the_width_or_more(wide_mm: float, words: str) -> None:
    with styled():
        figure, axis = plt.subplots()
        box = (-wide_mm / 2, wide_mm / 2, 0.0, wide_mm)
        show_box(axis, box)
        draw_scale(axis, box)
        assert axis.texts[0].get_text() == words
        assert np.ptp(axis.lines[0].get_xdata()) == pytest.approx(float(words.removesuffix(" mm")))
        plt.close(figure)


def test_thousands_of_pascals_are_shown_in_kilopascals() -> None:
    assert pressure_unit("Pa", 5e3) == (1e3, "kPa")
    assert pressure_unit("Pa", 1.46e3) == (1e3, "kPa")
    assert pressure_unit("Pa", 999.0) == (1.0, "Pa")
    assert pressure_unit("count", 5e3) == (1.0, "counts")
    assert [three_digits(value) for value in (8192.4, 123.4, 12.345, 0.5)] == ["8192", "123", "12.3", "0.5"]
