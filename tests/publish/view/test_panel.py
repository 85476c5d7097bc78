from __future__ import annotations

import pytest

from taxelflow.publish.view.panel import marked
from taxelflow.publish.view.placement import ON_LINKS, placed
from taxelflow.sensors.catalogue import load_sensor


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("barretthand-162", {"laid flat (assumed)": 7}),
        ("icub-forearm", {"with a pose in space (published)": 24}),
        ("inspire-rh56dftp@3.0mm", {"set out: their places are not known": 17}),
    ],
)
def test_each_pad_is_marked_by_where_its_place_comes_from(name: str, expected: dict[str, int]) -> None:
    sensor = load_sensor(name)
    assert {words: len(own) for words, own in marked(sensor, placed(sensor.layout).how).items()} == expected


def test_pads_on_links_are_marked_by_the_note_of_the_hand() -> None:
    sensor = load_sensor("schunk-sdh2")
    assert [*marked(sensor, (ON_LINKS,) * 6)] == ["on the links of the hand's model (mounting assumed)"]
    assert [*marked(sensor, placed(sensor.layout).how)] == ["laid flat (as the sensor file has it)"]
