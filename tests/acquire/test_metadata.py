from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest

from synthetic import grid_sensor, recorded
from taxelflow.acquire.metadata import texts_of
from taxelflow.errors import RecordingCorrupt
from taxelflow.pipeline.api import convert, read

if TYPE_CHECKING:
    from pathlib import Path


SENSOR = grid_sensor(2, 3)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("sensor", "{", "its sensor: Input data was truncated"),
        ("masked", "[6]", "masked lists numbers beyond the 6 taxels of the sensor"),
        ("masked", '"all"', "its masked: Expected `array`"),
        ("truth", '{"pad": "hand"}', "its truth: Object missing required field `t_s`"),
        ("truth", '{"pad": "hand", "t_s": [1], "pose": [[1, 2]]}', "give a pad of the sensor or hand"),
        ("truth", '{"pad": "hand", "t_s": [1], "pose": [[1, 2, 3], [1]]}', "truth: .*inhomogeneous"),
        ("truth", '{"pad": "x", "t_s": [1], "pose": [[1, 2, 3]]}', "truth_pad 'x'"),
        ("truth", '{"pad": "hand", "t_s": [1], "pose": [[1, 2, 3]], "slipping": []}', "a flag for each of the 1 times"),
    ],
)
@pytest.mark.parametrize("suffix", [".parquet", ".mcap"])
def test_broken_texts_in_a_file_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, name: str, text: str, match: str
) -> None:
    module = "taxelflow.acquire.parquet" if suffix == ".parquet" else "taxelflow.acquire.ros.write"
    monkeypatch.setattr(f"{module}.texts_of", lambda recording: texts_of(recording) | {name: text})
    convert(recorded(np.zeros((2, 6)), SENSOR), tmp_path / f"a{suffix}")
    with pytest.raises(RecordingCorrupt, match=match) as caught:
        read(tmp_path / f"a{suffix}")
    assert "\n" not in str(caught.value)


def test_the_sensor_in_a_file_is_the_whole_sensor(tmp_path: Path) -> None:
    sensor = msgspec.structs.replace(
        SENSOR, full_scale=12.5, note="of mine", delay_s=tuple((np.arange(6) / 1e3).tolist())
    )
    convert(recorded(np.zeros((3, 6)), sensor), tmp_path / "a.mcap")
    assert read(tmp_path / "a.mcap").sensor == sensor
