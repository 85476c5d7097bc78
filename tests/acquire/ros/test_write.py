from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from mcap.reader import make_reader

from synthetic import grid_sensor, recorded
from taxelflow.acquire.ros.write import TOPIC, write_mcap

if TYPE_CHECKING:
    from pathlib import Path


def test_messages_are_logged_at_their_scans_times_and_none_before_1970(tmp_path: Path) -> None:
    recording = recorded(np.arange(18.0).reshape(3, 6), grid_sensor(2, 3), t_s=[-0.5, 0.25, 1.7e9])
    write_mcap(recording, tmp_path / "a.mcap", recording.source_blocks())
    with (tmp_path / "a.mcap").open("rb") as file:
        read = list(make_reader(file).iter_messages())
    assert [message.log_time for _, _, message in read] == [0, 250_000_000, 1_700_000_000_000_000_000]
    assert {(schema.name, channel.topic) for schema, channel, _ in read if schema} == {
        ("taxelflow_msgs/msg/Scan", TOPIC)
    }


def test_sensor_masks_and_truth_precede_the_messages(tmp_path: Path) -> None:
    recording = recorded(np.zeros((2, 6)), grid_sensor(2, 3))
    write_mcap(recording, tmp_path / "a.mcap", recording.source_blocks())
    with (tmp_path / "a.mcap").open("rb") as file:
        (metadata,) = make_reader(file).iter_metadata()
    assert set(metadata.metadata) == {"sensor", "masked"}
    content = (tmp_path / "a.mcap").read_bytes()
    assert content.index(b"masked") < content.index(TOPIC.encode())
