from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bagged import SDH, SDH_CELLS, scans_of, write_bag
from taxelflow.errors import TopicUnclear
from taxelflow.pipeline.api import read

if TYPE_CHECKING:
    from pathlib import Path


def test_of_several_topics_that_fit_one_is_to_be_chosen(tmp_path: Path) -> None:
    one, other = scans_of(*SDH_CELLS), scans_of(*SDH_CELLS)
    path = write_bag(
        tmp_path / "a.bag", {"/left": (SDH, one), "/right": (SDH, other), "/log": ("std_msgs/msg/String", [["x"]])}
    )
    with pytest.raises(
        TopicUnclear, match=r"2 topics fit; choose one with --topic: /left \(schunk_sdh/msg/Tac.*, /right"
    ):
        read(path)
    chosen = read(path, topic="right")
    assert chosen.format == "ros1 bag, /right"
    assert chosen.load().values.max() == max(part.max() for parts in other for part in parts)


def test_a_topic_that_is_not_there_is_answered_with_those_that_are(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/left": (SDH, scans_of(*SDH_CELLS))})
    with pytest.raises(TopicUnclear, match=r"no topic /middle; .*: /left \(schunk_sdh/msg/TactileSensor\)"):
        read(path, topic="/middle")


@pytest.mark.parametrize("topic", [None, "/log"])
def test_an_unknown_message_is_answered_with_topics_and_types(tmp_path: Path, topic: str | None) -> None:
    path = write_bag(tmp_path / "a.bag", {"/log": ("std_msgs/msg/String", [["x"]])})
    match = (
        r"/log \(std_msgs/msg/String\)"
        if topic is None
        else r"/log \(std_msgs/msg/String\) is of no known type \(Scan, Tactile"
    )
    with pytest.raises(TopicUnclear, match=match) as caught:
        read(path, topic=topic)
    assert "; record the readings as std_msgs/Float32MultiArray or" in str(caught.value)
    assert "choose one" not in str(caught.value)
