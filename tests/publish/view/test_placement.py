from __future__ import annotations

import numpy as np
import pytest

from taxelflow.publish.view.placement import IN_A_ROW, IN_SPACE, LAID_FLAT, placed, spots_of
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.layout import Layout


def layout_of(name: str) -> Layout:
    return load_sensor(name).layout


@pytest.mark.parametrize(
    ("name", "how"),
    [("barretthand-162", LAID_FLAT), ("inspire-rh56dftp@3.0mm", IN_A_ROW), ("icub-forearm", IN_SPACE)],
)
def test_pads_stand_where_the_sensor_file_puts_them(name: str, how: int) -> None:
    layout = layout_of(name)
    found = placed(layout)
    assert set(found.how) == {how}
    assert found.flat == (how == LAID_FLAT)
    assert np.isfinite(found.place).all()
    assert np.linalg.norm(found.normal, axis=1) == pytest.approx(1.0)


def test_pads_in_rows_do_not_overlap() -> None:
    layout = layout_of("inspire-rh56dftp@3.0mm")
    found = placed(layout)
    boxes = [found.place[layout.of_pad(pad), :2] for pad in range(layout.pad_count)]
    low, high = np.array([box.min(axis=0) for box in boxes]), np.array([box.max(axis=0) for box in boxes])
    for pad in range(layout.pad_count):
        apart = (low > high[pad] + 0.002) | (high < low[pad] - 0.002)
        assert np.delete(apart.any(axis=1), pad).all()


@pytest.mark.parametrize("name", ["barretthand-162", "icub-forearm"])
def test_tangents_map_small_steps_on_a_pad_to_the_scene(name: str) -> None:
    layout = layout_of(name)
    found = placed(layout)
    xy = np.stack([layout.x_m, layout.y_m], axis=1)
    errors = []
    for pad in range(layout.pad_count):
        first = layout.of_pad(pad).start
        for one, other in layout.neighbours(pad) + first:
            step = found.tangent[one] @ (xy[other] - xy[one])
            errors.append(np.linalg.norm(found.place[other] - found.place[one] - step))
    assert np.median(errors) < 0.02 * layout.pitch_m.min()


def test_marks_of_pads_stand_beside_all_taxels() -> None:
    layout = layout_of("barretthand-162")
    found = placed(layout)
    spots, _ = spots_of(layout, found, 0.002)
    for spot in spots:
        apart = np.hypot(*(found.place[:, :2] - spot[:2]).T)
        assert apart.min() > 0.5 * layout.pitch_m.min()
