from __future__ import annotations

import time
from pathlib import Path

import pytest

from taxelflow.acquire.columns import Columns
from taxelflow.errors import CalibrationInvalid, ParameterInvalid, SensorFileInvalid
from taxelflow.sensors.calibration import load_calibration
from taxelflow.sensors.catalogue import load_sensor
from taxelflow.sensors.toml_text import MOST_BYTES, parse_toml, read_limited

HOSTILE = {
    "nested too deeply": b"a = " + b"[" * 10_000,
    "more than 32 parts": b"a." * 20_000 + b"a = 1",
    "bytes, and may have": b"#" * (MOST_BYTES + 1),
    "utf-8": b"a = '\xff'",
}


@pytest.mark.parametrize("seen", HOSTILE)
def test_hostile_toml_is_an_error_at_once_wherever_it_is_read(tmp_path: Path, seen: str) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(HOSTILE[seen])
    begin = time.process_time()
    with pytest.raises(SensorFileInvalid, match=seen):
        load_sensor(str(path))
    with pytest.raises(CalibrationInvalid, match=seen):
        load_calibration(path)
    with pytest.raises(ParameterInvalid, match=seen):
        Columns(file=path).resolved()
    assert time.process_time() - begin < 2


def test_a_device_is_no_file() -> None:
    with pytest.raises(ValueError, match="not a regular file"):
        read_limited(Path("/dev/zero"))


def test_dots_outside_of_keys_are_no_parts_of_keys() -> None:
    text = "numbers = [" + "0.5, " * 1000 + "]\nnote = '" + "." * 100 + "'\n"
    assert len(parse_toml(text.encode())["numbers"]) == 1000


def test_the_mark_of_windows_editors_is_no_text() -> None:
    assert parse_toml(b"\xef\xbb\xbfname = 'hand'\r\n") == {"name": "hand"}
